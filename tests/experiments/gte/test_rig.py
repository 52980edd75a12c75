"""Arms on paths, control step by control step: the same bits in one compiled call or many."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.experiments.gte.rig import blank_sampling
from stiction_envs.measured.tables import AmplitudeRow
from stiction_envs.robots import load_arm
from tests.experiments.gte.short_paths import STIFF, bench, following, one


def test_iiwa_holds_its_command_for_5_ms():
    """200 Hz: dither and torque change every fifth control step, and the arm follows."""
    b = bench("iiwa7")
    rows = tuple(AmplitudeRow(j, 15.0, 1.0) for j in range(1, 8))
    case = Case(trajectory="there", stiffness=STIFF, dither=rows)
    rig = following(b, case)
    seen = []
    for _ in range(100):
        rig.advance(1)
        seen.append(rig.dither_torque.copy())
    changed = [k for k in range(1, 100) if not np.array_equal(seen[k], seen[k - 1])]
    assert changed == list(range(5, 100, 5))
    error = one(b, case).error[0, -1]
    assert np.linalg.norm(error[:3]) < 0.03


HEAVY = load_arm("panda", payload=(1, 0, 0, 0.1))
SENSES = {"sensing": "robot", "controller_model": HEAVY, "timestep": 5e-4}


@pytest.mark.parametrize(
    ("robot", "kind", "options"),
    [
        ("panda", None, SENSES),
        ("iiwa14", "push", {}),
        ("panda", "feedforward", {}),
        ("iiwa7", "momentum_observer", {"sensing": "robot"}),
    ],
)
def test_steps_are_the_same_bits_in_one_call_or_many(robot, kind, options):
    """In blocks of many control steps or of one, with other arms and threads or without."""
    ids, found = np.arange(3), []
    for threads, parts in ((1, [237, 3]), (2, [40, *[1] * 200])):
        b = bench(robot, threads=threads, **options)
        rig = b.rig(3 + 4 * (threads - 1), 2)
        every = np.arange(rig.nsim)
        paths = [b.path(("there", "corner", "stay")[i % 3]) for i in every]
        stiffness = np.tile((200.0, 20.0, 5.0), (rig.nsim, 1))
        rig.begin(every, paths, stiffness, [(int(i) % 3,) for i in every])
        amplitude = np.array([1.0, 0.0, 0.5])[every % 3, None]
        waveform = np.array(["sine", "sine", "square"])[every % 3, None]
        gate = np.where(every % 3 == 2, 0.5, np.inf)[:, None]
        rig.set_dither(
            every, amplitude=amplitude, frequency=30.0, waveform=waveform, gate_velocity=gate
        )
        if kind:
            rig.compensator.set_rows(every[1:], [b.compensation(kind)] * (rig.nsim - 1))
        poses = []
        for steps in parts:
            sampling = blank_sampling(steps, 10, rig.nsim, rig.n, detailed=True)
            rig.advance(steps, sampling)
            poses += [sampling.position[:, ids], sampling.quaternion[:, ids]]
        together = [np.concatenate(poses[k::2]) for k in (0, 1)]
        noted = *rig.plant.state, rig.applied, rig.dither_torque, rig.sequencer.arrays.reached
        noted = *noted, rig.plant.bristle, rig.step, rig.undithered_torque, rig.seen_velocity
        found.append([*together, *(x[ids].copy() for x in noted)])
    for one_call, many in zip(*found, strict=True):
        np.testing.assert_array_equal(one_call, many)
    assert np.abs(found[0][3]).max() > 1e-3, "arms move"


def test_slow_controller_takes_what_fell_due_between_its_cycles():
    """125 Hz: cycles every 8 ms, references every 10 ms; none may be missed."""
    b = bench(scatter=False)
    interface = dataclasses.replace(b.interface, controller_rate_hz=125)
    slow = bench(scatter=False, interface=interface)
    case = Case(trajectory="there", stiffness=STIFF)
    a, c = one(b, case), one(slow, case)
    k = min(len(a.time), len(c.time))
    assert np.abs(a.reference[0, :k, 0] - c.reference[0, :k, 0]).max() < 3e-3


@pytest.mark.parametrize("nullspace", [0.0, 10.0])
def test_what_no_torque_depends_on_is_not_renewed(nullspace):
    """The nullspace projector without a nullspace torque; whether the pose is singular always."""
    b = bench("panda", threads=1)
    rig = b.rig(1, 2)
    rig.begin(np.arange(1), [b.path("there")], np.array([[200.0, 20.0, nullspace]]), [(0,)])
    a = rig.controller.arrays
    before, a.singular[:] = a.projector.copy(), True
    rig.advance(100)
    assert np.array_equal(before, a.projector) == (nullspace == 0)
    assert not a.singular.any()
