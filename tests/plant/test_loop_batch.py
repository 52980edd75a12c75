"""A batch that compiled code steps is MuJoCo's own batch, to the bit."""

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from stiction_envs.friction.sticking import sticking_model
from stiction_envs.plant.loop_batch import LoopBatch, advance, take_fields
from stiction_envs.robots.stated import COULOMB

VEL = int(mujoco.mjtStage.mjSTAGE_VEL)
READ = ("xanchor", "xaxis", "xquat", "subtree_com", "qacc", "qfrc_passive", "qfrc_actuator")


@pytest.fixture(scope="module")
def sticking():
    return sticking_model("panda")


def both(sticking, n: int = 3, threads: int = 1) -> tuple[Batch, LoopBatch]:
    """Return the same n arms in either batch, each with a pose and a friction of its own."""
    model = sticking.model
    batches = Batch(model, n, 1, persistent=True), LoopBatch(model, n, threads=threads)
    factor, apart = np.geomspace(0.5, 2.0, n)[:, None], 0.01 * np.arange(n)[:, None]
    for b in batches:
        for name in READ:
            b.bind(name)
        b.expand("actuator_biasprm")[:, sticking.torque_actuator, COULOMB] *= factor
        b.bind("qpos")[:, sticking.motor] = sticking.arm.rest + apart
        b.forward(stage=VEL)
    return batches


def same(one: Batch, other: Batch) -> bool:
    names = ("qpos", "qvel", "act", "time", *READ)
    return all(np.array_equal(one.bind(x), other.bind(x)) for x in names)


def drive(batches, k: int, sticking) -> None:
    for b in batches:
        phase = 0.3 * k + np.arange(len(b.bind("qpos")))
        b.bind("ctrl")[:, sticking.torque_actuator] = 20.0 * np.sin(phase)[:, None]


def step(batches: tuple[Batch, LoopBatch], nstep: int = 1) -> None:
    """Step the first as MuJoCo does, the second by compiled code, the last arms first."""
    batches[0].step(nstep=nstep, stage=VEL)
    for part, loop in reversed(list(zip(batches[1].parts, batches[1].loops, strict=True))):
        for i in range(part.start, part.stop):
            take_fields(i, loop)
            advance(i, nstep, loop)


def test_it_steps_as_mujoco_does(sticking):
    batches = both(sticking)
    for k in range(40):
        drive(batches, k, sticking)
        if k == 20:  # what plants do between steps: friction, one arm put elsewhere, loads
            for b in batches:
                b.expand("dof_damping")[1] *= 2.0
                b.bind("qfrc_applied")[2] = 0.5
                b.bind("qpos")[0] += 0.1
                b.forward(np.array([0]), stage=VEL)
        step(batches, 2)
        assert same(*batches)
    assert np.abs(batches[0].bind("qvel")).max() > 1e-3


def test_parts_are_stepped_in_any_order(sticking):
    batches = both(sticking, 9, threads=2)
    assert [s.stop - s.start for s in batches[1].parts] == [5, 4]
    for k in range(6):
        drive(batches, k, sticking)
        step(batches)
        assert same(*batches)


def test_a_stopped_simulation_is_told_of_until_it_is_reset(sticking):
    batches = both(sticking)
    for b in batches:
        b.bind("qvel")[1] = np.nan
    step(batches)
    for b in batches:
        assert (b.warning[:, :, 1].sum(axis=1) > 0).tolist() == [False, True, False]
        b.reset(np.array([1]), stage=VEL)
    step(batches)
    for b in batches:
        assert not b.warning.any()
