"""Pickles of simulations in mid-motion, in which arrays go on sharing their memory.

Pickle alone copies two views of an array apart, and has no access to the memory of a batch.
"""

import ctypes
import io
import pickle
from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from stiction_envs.arrays import Array

AnyArray = NDArray[Any]


class CopiedBatch(Batch):
    """A batch of MuJoCo that can be pickled: it lists its bound and expanded arrays."""

    def __init__(self, model: mujoco.MjModel, nsim: int, threads: int) -> None:
        """Make the simulations; the batch's own calls have some threads, 0 for all processors."""
        super().__init__(model, nsim, threads)
        self._arguments = model, nsim, threads
        self._outputs: dict[str, Array] = {}
        self._inputs: dict[str, Array] = {}

    def bind(self, name: str) -> Array:
        """Bind as `Batch.bind`; note the output for pickling."""
        out: Array = super().bind(name)
        if not out.flags.writeable:
            self._outputs[name] = out
        return out

    def expand(self, name: str) -> Array:
        """Expand as `Batch.expand`; note the input for pickling."""
        self._inputs[name] = super().expand(name)
        return self._inputs[name]

    @property
    def memory(self) -> list[AnyArray]:
        """The arrays of which all other live arrays of the batch are views."""
        return [self.state, self.warning, *self._outputs.values(), *self._inputs.values()]

    def __reduce__(self) -> tuple[Any, ...]:
        names = list(self._outputs), list(self._inputs)
        values = [array.copy() for array in self.memory]
        return _batch, (type(self), self._arguments, *names, values)


def _batch(
    kind: Any, arguments: Any, outputs: list[str], inputs: list[str], values: list[AnyArray]
) -> CopiedBatch:
    batch: CopiedBatch = kind(*arguments)
    for name in outputs:
        batch.bind(name)
    for name in inputs:
        batch.expand(name)
    for array, value in zip(batch.memory, values, strict=True):
        ctypes.memmove(array.ctypes.data, value.ctypes.data, array.nbytes)  # outputs: read-only
    return batch


def dumps(obj: object, batches: Iterable[CopiedBatch]) -> bytes:
    """Return the pickle of an object whose arrays may be views of each other and of batches."""
    out = io.BytesIO()
    _Pickler(out, batches).dump(obj)
    return out.getvalue()


class _Pickler(pickle.Pickler):
    def __init__(self, file: io.BytesIO, batches: Iterable[CopiedBatch]) -> None:
        super().__init__(file, protocol=5)
        known = [(x, b, k) for b in batches for k, x in enumerate(b.memory) if x.size]
        self._batches = {x.ctypes.data: (b, k) for x, b, k in known}
        self._flat: dict[tuple[int, int], AnyArray] = {}

    def reducer_override(self, obj: object) -> Any:
        if type(obj) is not np.ndarray or obj.dtype.hasobject or not obj.size:
            return NotImplemented
        root = obj
        while isinstance(root.base, np.ndarray):
            root = root.base
        start = root.ctypes.data
        whole: tuple[object, ...] | None = self._batches.get(start)
        if whole is None:
            flat = self._flat.setdefault((start, root.nbytes), root.ravel(order="K"))
            if flat is obj or flat.ctypes.data != start:  # a copy: the root has gaps
                return NotImplemented
            whole = (flat,)
        view = obj.shape, obj.dtype, obj.ctypes.data - start, obj.strides, obj.flags.writeable
        return _view, (view, *whole)


def _view(view: tuple[Any, ...], whole: AnyArray | CopiedBatch, k: int = 0) -> AnyArray:
    """Return a view of an array, or of array ``k`` of a batch's memory."""
    shape, dtype, offset, strides, writeable = view
    memory = whole.memory[k] if isinstance(whole, CopiedBatch) else whole
    out: AnyArray = np.ndarray(shape, dtype, memory, offset, strides)
    out.flags.writeable = writeable
    return out
