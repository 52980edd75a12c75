"""Arms on paths, control step by control step: the same bits in one compiled call or many."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.control.settings import ImpedanceSettings
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.experiments.gte.rig import Sampling
from stiction_envs.measured import AmplitudeRow
from stiction_envs.robots import load_arm
from tests.experiments.gte.short_paths import STIFF, bench, following, one


def test_iiwa_holds_its_command_for_5_ms():
    """200 Hz: dither and torque change every fifth control step, and the arm follows."""
    b = bench("iiwa7")
    rows = tuple(AmplitudeRow(j, 15.0, 1.0) for j in range(1, 8))
    case = Case(trajectory="there", stiffness=STIFF, dither=rows)
    rig = following(b, case)
    seen: list[np.ndarray] = []
    rig.advance(200, lambda: seen.append(rig.dither_torque.copy()))
    changed = [k for k in range(1, 200) if not np.array_equal(seen[k], seen[k - 1])]
    assert changed == list(range(5, 200, 5))
    error = one(b, case).error[0, -1]
    assert np.linalg.norm(error[:3]) < 0.03


HEAVY = load_arm("panda", payload=(1, 0, 0, 0.1))
MIXED = ImpedanceSettings(rate_hz=1000.0, dither_after_saturation=True)


@pytest.mark.parametrize(
    ("robot", "options"),
    [
        ("panda", {}),
        ("iiwa7", {}),
        ("panda", {"settings": MIXED, "controller_model": HEAVY, "timestep": 5e-4}),
        ("iiwa14", {"compensated": "push"}),
        ("panda", {"compensated": "feedforward"}),
        ("iiwa7", {"compensated": "momentum_observer"}),
    ],
)
def test_compiled_steps_are_the_same_bits(robot, options):
    """Many control steps in one call of compiled code, as step by step through Python."""
    ids, seen, options = np.arange(3), [], dict(options)
    compensated = options.pop("compensated", None)
    for watch in (None, lambda: None):
        b = bench(robot, threads=1, **options)
        rig = b.rig(3, 2)
        paths = [b.path(p) for p in ("there", "corner", "stay")]
        rig.begin(ids, paths, np.tile((200.0, 20.0, 5.0), (3, 1)), [(k,) for k in ids])
        rig.set_dither(ids, amplitude=np.array([[1.0], [0.0], [0.5]]), frequency=30.0)
        if compensated:
            rig.compensator.set_rows(ids, [None, *[b.compensation(compensated)] * 2])
        assert rig.plant.compiled_loops
        noted = []
        for steps in (237, 100, 3):
            poses = np.empty((steps, 3, 3)), np.empty((steps, 3, 4))
            reference = np.full((-(-steps // 10), 3, 7), np.nan)
            rig.advance(steps, watch, Sampling(*poses, 10, reference))
            assert np.isfinite(reference).all()
            noted += [*poses, reference, rig.plant.state[0].copy(), rig.plant.state[1].copy()]
            noted += [rig.applied.copy(), rig.dither_torque.copy(), rig.sequencer.reached_at.copy()]
            noted += [rig.plant.bristle, rig.plant.joint_torque, rig.step.copy()]
        seen.append(noted)
    for compiled, stepped in zip(*seen, strict=True):
        np.testing.assert_array_equal(compiled, stepped)
    assert np.abs(seen[0][4]).max() > 1e-3, "arms move"


def test_slow_controller_takes_what_fell_due_between_its_cycles():
    """125 Hz: cycles every 8 ms, references every 10 ms; none may be missed."""
    b = bench(scatter=False)
    interface = b.interface.of(load_arm("panda"), controller_rate_hz=125)
    settings = ImpedanceSettings(rate_hz=125.0)
    slow = bench(scatter=False, interface=interface, settings=settings)
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
    control = rig.controller
    before, control._singular[:] = control.projector.copy(), True
    rig.advance(100)
    assert np.array_equal(before, control.projector) == (nullspace == 0)
    assert not control.flags.singular.any()
