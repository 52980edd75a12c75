"""numpy arrays and their mirrors on Warp's device, and compiled functions launched on these.

    f(a, b)      on the host      ->      mirrors.launch(f, a, b)      the same, on the mirrors

So the device runs the host's program, call by call, on arrays that stay there in between.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from stiction_envs.engines.translate import Compiled, Tree, kernel_of, kind_of

_DTYPES = {"f": wp.float64, "i": wp.int32, "b": wp.bool}


class Mirrors:
    """Mirrors of arrays of N arms, and of what all arms share."""

    def __init__(self, nsim: int) -> None:
        """Make it for N arms."""
        self._nsim = nsim
        self._pairs: dict[int, tuple[NDArray[np.generic], wp.array]] = {}
        self._kernels: dict[tuple[Compiled, tuple[Tree, ...]], wp.Kernel] = {}

    def of(self, host: NDArray[np.generic]) -> wp.array:
        """Return the mirror of an array, known by its identity; new ones have its values."""
        if id(host) not in self._pairs:
            dtype = _DTYPES[host.dtype.kind]
            # the array is kept: another one cannot take its identity
            self._pairs[id(host)] = host, wp.array(np.ascontiguousarray(host), dtype=dtype)
        return self._pairs[id(host)][1]

    def launch(self, function: Compiled, *arguments: object) -> None:
        """Launch a compiled function of N arms on the mirrors of its arguments."""
        at = function, tuple(kind_of(x) for x in arguments)
        if at not in self._kernels:
            self._kernels[at] = kernel_of(*at)
        inputs = [self.of(x) if isinstance(x, np.ndarray) else x for x in _flat(arguments)]
        wp.launch(self._kernels[at], dim=self._nsim, inputs=inputs)

    def send(self) -> None:
        """Give all mirrors the values of their arrays."""
        for host, mirror in self._pairs.values():
            mirror.assign(host)

    def fetch(self, *arguments: object) -> None:
        """Give the arrays among arguments the values of their mirrors."""
        for host in _flat(arguments):
            if isinstance(host, np.ndarray):
                host[...] = self.of(host).numpy()


def _flat(arguments: tuple[object, ...]) -> list[object]:
    """Return arguments without the tuples around them."""
    return [y for x in arguments for y in (_flat(x) if isinstance(x, tuple) else [x])]
