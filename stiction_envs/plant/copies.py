"""Copies of simulations in mid-motion: a batch that can be pickled, and arrays that share memory.

Pickle alone copies two views of one array apart, and has no access to the memory of a batch.
"""

from __future__ import annotations

import ctypes
import io
import pickle
from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

Array = NDArray[np.float64]
AnyArray = NDArray[Any]


class CopiedBatch(Batch):
    """A batch of MuJoCo's that knows what is bound and expanded, and so can be pickled."""

    def __init__(
        self, model: mujoco.MjModel, nsim: int, threads: int, persistent: bool = False
    ) -> None:
        """Make the simulations; the batch's own calls have some threads, 0 for all processors."""
        super().__init__(model, nsim, threads, persistent)
        self._threads = threads
        self._outputs: dict[str, Array] = {}
        self._inputs: dict[str, Array] = {}

    def bind(self, name: str) -> Array:
        """As `Batch.bind`."""
        out: Array = super().bind(name)
        if not out.flags.writeable:
            self._outputs[name] = out
        return out

    def expand(self, name: str) -> Array:
        """As `Batch.expand`."""
        self._inputs[name] = super().expand(name)
        return self._inputs[name]

    @property
    def memory(self) -> list[AnyArray]:
        """The arrays of which all other live arrays of the batch are views."""
        return [self.state, self.warning, *self._outputs.values(), *self._inputs.values()]

    def __reduce__(self) -> tuple[Any, ...]:
        made = type(self), (self.model, self.nsim, self._threads)
        return _batch, (*made, [*self._outputs], [*self._inputs], [x.copy() for x in self.memory])


def _batch(
    kind: type[CopiedBatch],
    arguments: tuple[mujoco.MjModel, int, int],
    outputs: list[str],
    inputs: list[str],
    memory: list[AnyArray],
) -> CopiedBatch:
    """Return a batch with the memory of another."""
    batch = kind(*arguments)
    for name in outputs:
        batch.bind(name)
    for name in inputs:
        batch.expand(name)
    for mine, other in zip(batch.memory, memory, strict=True):
        ctypes.memmove(mine.ctypes.data, other.ctypes.data, mine.nbytes)  # outputs are read-only
    return batch


def dumps(obj: object, batches: Iterable[CopiedBatch]) -> bytes:
    """Return the pickle of an object; arrays that share memory share it again when it is loaded.

    Args:
        obj: the object.
        batches: those whose memory its arrays may show.
    """
    out = io.BytesIO()
    _Pickler(out, batches).dump(obj)
    return out.getvalue()


class _Pickler(pickle.Pickler):
    def __init__(self, file: io.BytesIO, batches: Iterable[CopiedBatch]) -> None:
        super().__init__(file, protocol=5)
        self._batches = {
            x.ctypes.data: (batch, k)
            for batch in batches
            for k, x in enumerate(batch.memory)
            if x.size
        }
        self._flat: dict[tuple[int, int], AnyArray] = {}

    def reducer_override(self, obj: object) -> Any:
        if type(obj) is not np.ndarray or obj.dtype.hasobject or not obj.size:
            return NotImplemented
        root = obj
        while isinstance(root.base, np.ndarray):
            root = root.base
        start = root.ctypes.data
        if start in self._batches:
            where: tuple[object, ...] = self._batches[start]
        else:
            flat = self._flat.setdefault((start, root.nbytes), root.ravel(order="K"))
            if flat is obj or flat.ctypes.data != start:  # a copy: the root has gaps
                return NotImplemented
            where = (flat,)
        view = obj.ctypes.data - start, obj.shape, obj.strides, obj.dtype, obj.flags.writeable
        return _view, (view, *where)


def _view(
    view: tuple[int, tuple[int, ...], tuple[int, ...], np.dtype[Any], bool],
    memory: AnyArray | CopiedBatch,
    k: int = 0,
) -> AnyArray:
    """Return a view of an array, or of array ``k`` of a batch's memory."""
    offset, shape, strides, dtype, writeable = view
    whole = memory.memory[k] if isinstance(memory, CopiedBatch) else memory
    out: AnyArray = np.ndarray(shape, dtype, whole, offset, strides)
    out.flags.writeable = writeable
    return out
