"""A batch of MuJoCo's whose simulations compiled code steps itself, one control step at a time.

A feedback law between two steps of `mujoco.batch.Batch` goes through Python, whose lock the threads
of other batches wait for. Here law and physics are one call of compiled code, which needs no lock:

    advance(i, steps, loop):  controls -> mj_step2 -> mj_step1 -> state, kinematics

That is `Batch.step` up to ``mjSTAGE_VEL``, with the same bits: the same functions of MuJoCo's
library in the same order.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import mujoco
import numpy as np
from llvmlite import binding
from numba import types
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled, inlined
from stiction_envs.plant.copies import CopiedBatch

T = TypeVar("T")
Addresses = Index
STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""State of a simulation that a batch keeps, in this order."""
FEWEST = 4  # Simulations of a part [-]: in every step it costs what half a simulation does
_ACC = int(mujoco.mjtStage.mjSTAGE_ACC)


_InC = Callable[..., None]

# compiled code finds the library's functions by their names, and can be cached
binding.load_library_permanently(str(next(Path(mujoco.__file__).parent.glob("*mujoco.*"))))
_pointer = types.intp
_of_two = types.void(_pointer, _pointer)
_of_state = types.void(_pointer, _pointer, _pointer, types.intc)
step1: _InC = types.ExternalFunction("mj_step1", _of_two)
step2: _InC = types.ExternalFunction("mj_step2", _of_two)
kinematics: _InC = types.ExternalFunction("mj_kinematics", _of_two)
fwd_position: _InC = types.ExternalFunction("mj_fwdPosition", _of_two)
fwd_velocity: _InC = types.ExternalFunction("mj_fwdVelocity", _of_two)
set_state: _InC = types.ExternalFunction("mj_setState", _of_state)
get_state: _InC = types.ExternalFunction("mj_getState", _of_state)
copy: _InC = types.ExternalFunction("memcpy", _pointer(_pointer, _pointer, _pointer))


class Loop(NamedTuple):
    """Arms for compiled code; addresses are of memory that lives as long as the batch."""

    model: int  # The address of the model that the simulations of this part use in turn
    data: Addresses  # (N,) each simulation's `MjData`
    rows: Addresses  # (N,) each simulation's state in the batch
    going: Bools  # (N,) whether a simulation is stepped; the others do not change
    inputs: Addresses
    """(I, 4): from the first simulation's values in the batch, bytes to the next one's, to the
    model, number of bytes."""
    outputs: Addresses
    """(O, N + 3): from each simulation's `MjData`; to the first simulation's values in the batch,
    bytes to the next one's, number of bytes. The first are its warnings."""


@inlined
def take_fields(i: int, a: Loop) -> None:
    """Copy the fields of simulation ``i`` that differ into the model."""
    for k in range(a.inputs.shape[0]):
        copy(a.inputs[k, 2], a.inputs[k, 0] + i * a.inputs[k, 1], a.inputs[k, 3])


@inlined
def _give_fields(i: int, a: Loop) -> None:
    """Hand out state and bound fields of simulation ``i``."""
    get_state(a.model, a.data[i], a.rows[i], STATE)
    n = a.data.shape[0]
    for k in range(a.outputs.shape[0]):
        to = a.outputs[k, n] + i * a.outputs[k, n + 1]
        copy(to, a.outputs[k, i], a.outputs[k, n + 2])


@compiled
def _begin(first: int, end: int, a: Loop) -> None:
    """Take the states of simulations from the batch, and compute their kinematics."""
    n = a.data.shape[0]
    for i in range(first, end):
        if a.going[i]:
            take_fields(i, a)
            set_state(a.model, a.data[i], a.rows[i], STATE)
            warnings = a.outputs[0, n] + i * a.outputs[0, n + 1]
            copy(a.outputs[0, i], warnings, a.outputs[0, n + 2])
            step1(a.model, a.data[i])
            _give_fields(i, a)


@inlined
def advance(i: int, steps: int, a: Loop) -> None:
    """Advance simulation ``i``, whose fields the model has, by physics steps under its controls."""
    set_state(a.model, a.data[i], a.rows[i], STATE)
    for _ in range(steps):
        step2(a.model, a.data[i])
        step1(a.model, a.data[i])
    _give_fields(i, a)


class Threads:
    """Threads that do tasks; the first tasks start them."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._pool: ThreadPoolExecutor | None = None

    def __reduce__(self) -> tuple[type["Threads"], tuple[int]]:
        return Threads, (self._count,)

    def run(self, tasks: Sequence[Callable[[], T]]) -> list[T]:
        """Do tasks; return their results, or raise the first task's error.

        All tasks end first, even if one fails. An interrupt waits for several tasks.
        """
        if len(tasks) == 1:
            return [tasks[0]()]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self._count)
        with _interrupts_wait():
            done = [self._pool.submit(task) for task in tasks]
            wait(done)
        return [task.result() for task in done]


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Delay an interrupt until the end, so that no task stops in the middle."""
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGINT) is None:
        yield  # Python interrupts the main thread only, and only if it handles the signal
        return
    came: list[int] = []
    usual = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
        if came:
            signal.raise_signal(signal.SIGINT)


class LoopBatch(CopiedBatch):
    """N simulations of a model, each with its `MjData`, in parts that threads step one by one."""

    def __init__(self, model: mujoco.MjModel, nsim: int, threads: int) -> None:
        """Make the simulations; the batch's own calls have some threads, 0 for all processors."""
        super().__init__(model, nsim, threads)
        size = max(FEWEST, -(-nsim // (threads or os.cpu_count() or 1)))
        self.parts = [slice(a, min(a + size, nsim)) for a in range(0, nsim, size)]
        """The simulations of each part."""
        self._own_models = [self.get_model(0) for _ in self.parts]
        self._own_data = [mujoco.MjData(self._own_models[0]) for _ in range(nsim)]
        self._loops: list[Loop] = []
        self._fields = 0
        self._begun = False
        self._going = np.ones(nsim, dtype=bool)

    def __reduce__(self) -> tuple[Any, ...]:
        return *super().__reduce__(), {"_going": self._going}

    def step_only(self, going: Bools) -> None:
        """Leave simulations that are not ``going`` (N,) unchanged where all are stepped."""
        self._begun &= not (going & ~self._going).any()
        self._going[:] = going

    def forward(self, ids: ArrayLike | None = None, stage: int = _ACC) -> None:
        """Compute as `Batch.forward`; `loops` begins again."""
        self._begun = False
        super().forward(ids, stage)

    def reset(
        self, ids: ArrayLike | None = None, keyframe: ArrayLike = -1, stage: int = _ACC
    ) -> None:
        """Reset as `Batch.reset`; `loops` begins again."""
        self._begun = False
        super().reset(ids, keyframe, stage)

    def rollout(self, nstep: int, **options: object) -> dict[str, Array]:
        """Roll out as `Batch.rollout`; `loops` begins again."""
        self._begun = False
        return super().rollout(nstep, **options)

    @property
    def loops(self) -> list[Loop]:
        """Arguments of `advance`, for each part; kinematics are those of the present state."""
        fields = len(self._outputs) + len(self._inputs)
        if not self._loops or self._fields != fields:
            self._fields = fields
            self._loops = [self._addresses(model) for model in self._own_models]
            self._begun = False
        if not self._begun:
            for part, loop in zip(self.parts, self._loops, strict=True):
                _begin(part.start, part.stop, loop)
            self._begun = True
        return self._loops

    def _addresses(self, model: mujoco.MjModel) -> Loop:
        data = self._own_data
        inputs = [
            (x.ctypes.data, x.strides[0], getattr(model, name).ctypes.data, x[0].nbytes)
            for name, x in self._inputs.items()
        ]
        warned = [d.warning.lastinfo for d in data], self.warning
        bound = [([getattr(d, name) for d in data], x) for name, x in self._outputs.items()]
        outputs = [
            (*(x.ctypes.data for x in own), out.ctypes.data, out.strides[0], out[0].nbytes)
            for own, out in (warned, *bound)
        ]
        return Loop(
            model=model._address,
            data=np.array([d._address for d in data], dtype=np.int64),
            rows=self.state.ctypes.data + self.state.strides[0] * np.arange(len(data)),
            going=self._going,
            inputs=np.array(inputs, dtype=np.int64).reshape(-1, 4),
            outputs=np.array(outputs, dtype=np.int64),
        )
