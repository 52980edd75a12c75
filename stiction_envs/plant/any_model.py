"""N simulations of any model in lockstep, without what a sticking arm's plant does besides."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch

from stiction_envs.arrays import Array
from stiction_envs.plant.plant import raise_if_stopped


def rollout(
    model: mujoco.MjModel,
    qpos: Array,
    torque: Callable[[Array], Array],
    chunks: Iterable[Array],
    *,
    record: Sequence[str] = ("qpos",),
    threads: int = 0,
) -> Iterator[dict[str, Array]]:
    """Step N simulations of any model under applied joint torques, chunk by chunk.

    Args:
        model: the model; controls stay zero.
        qpos: (N, nq) start positions, at rest.
        torque: of a chunk's times (K,) [s], (N, K, nv) [N·m or N]; called chunk by chunk.
        chunks: the times of each chunk's steps [s].
        record: `MjData` fields.
        threads: threads, 0 for all processors.

    Yields:
        Per chunk, ``time`` (K,) at the start of each step [s] and each recorded field (N, K, ...)
        after it.

    Raises:
        ExperimentError: a simulation that the engine stopped (NaN, divergence, full buffers).
    """
    batch = Batch(model, len(qpos), threads)
    batch.bind("qpos")[:] = qpos
    applied = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
    for time in chunks:
        out = batch.rollout(
            len(time), control=torque(time), control_spec=applied, record=tuple(record)
        )
        raise_if_stopped(batch)
        yield {"time": time, **out}


def steer(
    model: mujoco.MjModel,
    start: Mapping[str, Array],
    law: Callable[[int, Batch], Array],
    steps: int,
    *,
    fastest: float = np.inf,
    threads: int = 0,
) -> Array:
    """Step N simulations of any model, each step under the controls of a feedback law.

    Args:
        model: the model.
        start: `MjData` state fields to start from, such as qpos (N, nq) and qvel (N, nv).
        law: returns the (N, nu) controls of a step from its number and the batch.
        steps: steps in all.
        fastest: speed at which a simulation has diverged [rad/s].
        threads: threads, 0 for all processors.

    Returns:
        (N, steps, nq) positions after each step, NaN after a stop of the engine or ``fastest``.
    """
    nsim = len(start["qpos"])
    batch = Batch(model, nsim, threads)
    for name, value in start.items():
        batch.bind(name)[:] = value
    out, going = np.full((nsim, steps, model.nq), np.nan), np.arange(nsim)
    for k in range(steps):
        batch.bind("ctrl")[:] = law(k, batch)
        batch.step(ids=going)
        slow = (np.abs(batch.bind("qvel")[going]) <= fastest).all(axis=1)  # false for NaN too
        going = going[slow & ~batch.warning[going, :, 1].any(axis=1)]
        out[going, k] = batch.bind("qpos")[going]
    return out
