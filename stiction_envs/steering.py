"""Any model under a feedback law, step by step, and what becomes of it where it is unstable.

`plant.Plant` steps the project's own arms and stops with an error where the engine does. Here the
model may be a bad one, which is an answer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

Array = NDArray[np.float64]


@contextmanager
def silent_engine() -> Iterator[None]:
    """Keep MuJoCo from writing warnings to the console and to a MUJOCO_LOG.TXT.

    For those who look at the engine's warning counters themselves. The switch is the process's: its
    other threads are as silent meanwhile.
    """
    before, silent = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    silent.logto_console = silent.logto_file = False
    silent.set()
    try:
        yield
    finally:
        before.set()


def steer(
    model: mujoco.MjModel,
    start: Mapping[str, Array],
    law: Callable[[int, Batch], Array],
    steps: int,
    *,
    fastest: float = np.inf,
    nthread: int = 0,
) -> Array:
    """Step N simulations of any model, each step under the controls of a feedback law.

    Args:
        model: the model.
        start: `MjData` state fields to start from, such as qpos (N, nq) and qvel (N, nv).
        law: of a step's number and the batch, its (N, nu) controls.
        steps: steps in all.
        fastest: speed that is no joint's any more [rad/s].
        nthread: threads, 0 for all processors.

    Returns:
        (N, steps, nq) positions after each step; NaN from the step on at which the engine stopped a
        simulation (NaN, divergence) or it passed ``fastest``. The engine says nothing of it.
    """
    nsim = len(next(iter(start.values())))
    batch = Batch(model, nsim, nthread)
    for name, value in start.items():
        batch.bind(name)[:] = value
    qpos, qvel, control = (batch.bind(x) for x in ("qpos", "qvel", "ctrl"))
    out = np.full((nsim, steps, model.nq), np.nan)
    going = np.arange(nsim)
    with silent_engine():
        for k in range(steps):
            control[:] = law(k, batch)
            batch.step(ids=going)
            stopped = batch.warning[going, :, 1].any(axis=1)
            slow = (np.abs(qvel[going]) <= fastest).all(axis=1)  # false for NaN too
            going = going[~stopped & slow]
            if not len(going):
                break
            out[going, k] = qpos[going]
    return out
