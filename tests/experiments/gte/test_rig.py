"""Arms on paths, control step by control step: the same bits in one compiled call or many."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.control.compensation import compensate
from stiction_envs.control.kernels import pass_torque
from stiction_envs.control.settings import ImpedanceSettings
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.experiments.gte.rig import GTERig, Sampling
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


def one_by_one(rig: GTERig, due: bool, row: int) -> None:
    """`GTERig._control_step` by the public calls of its parts."""
    tip, model = rig.end_effector, rig._model
    tip.read()
    if due:
        q, dq = rig.plant.position, rig.plant.velocity
        rig.dither_torque[:] = rig.dither.torque(rig.step * 1e-3, dq)
        rig.controller.torque(
            tip.position,
            tip.quaternion,
            tip.jacobian,
            q,
            dq,
            dither=rig.dither_torque + compensation_of(rig, dq),
        )
    pass_torque(rig.controller.command, *rig._path.arguments, rig.applied)
    rig._torque[:] = rig.applied + model.missing


def look_ahead_by_parts(rig: GTERig, model: bool, goals: bool) -> None:
    """`GTERig._look_ahead` by the public calls of its parts."""
    pose, t, compensator = rig.seen_end_effector, rig.step * 1e-3, rig.compensator
    pose.read()
    if model:
        rig._model.update(rig.seen_position)
        rig.controller.update_model(None, pose.jacobian, rig._model.mass)
    if goals:
        rig.sequencer.accept(pose.position, pose.quaternion, t)
        rig.controller.set_reference(*rig.sequencer.reference(t)[:2])
        if compensator.feeds:
            compensator.look_ahead(pose.jacobian, rig.sequencer.twist(t))


def compensation_of(rig: GTERig, dq: np.ndarray) -> np.ndarray:
    """Compensation of this cycle (N, n), by itself."""
    tip, (x, _) = rig.end_effector, rig.controller.reference
    compensate(
        *(tip.position, tip.quaternion, tip.jacobian, dq, x),
        *rig.controller.arguments[4:6],
        *rig.compensator.arguments,
    )
    return rig.compensator.torque


HEAVY = load_arm("panda", payload=(1, 0, 0, 0.1))
MIXED = ImpedanceSettings(rate_hz=1000.0, dither_after_saturation=True)
FILTERED = ImpedanceSettings(rate_hz=1000.0, pose_filter=0.9)


@pytest.mark.parametrize(
    ("robot", "options", "dither"),
    [
        ("panda", {}, {}),
        ("iiwa7", {}, {}),
        ("panda", {"settings": MIXED, "controller_model": HEAVY}, {}),
        ("panda", {"settings": FILTERED}, {}),
        ("panda", {}, {"gate_velocity": 0.02}),
        ("iiwa7", {}, {"waveform": "random", "offset": 0.3}),
        ("panda", {"settings": MIXED}, {"compensated": True}),
        ("iiwa7", {}, {"compensated": True}),
    ],
)
def test_control_step_in_one_call_is_the_same_bits(monkeypatch, robot, options, dither):
    """As its parts one by one: held commands, nullspace, wrong model, any dither."""
    ids, seen = np.arange(3), []
    dither = dict(dither)
    compensated = dither.pop("compensated", False)
    for other_way in (False, True):
        if other_way:
            monkeypatch.setattr(GTERig, "_control_step", one_by_one)
            monkeypatch.setattr(GTERig, "_look_ahead", look_ahead_by_parts)
        b = bench(robot, **options)
        rig = b.rig(3, 2)
        stiffness = np.array([(200, 20, 0), (400, 40, 5), (200, 20, 10)], dtype=float)
        rig.begin(
            ids, [b.path(p) for p in ("there", "corner", "stay")], stiffness, [(k,) for k in ids]
        )
        amplitude = np.ones((3, 7))
        amplitude[0, 2], amplitude[2] = 0.0, 0.0
        rig.set_dither(ids, amplitude=amplitude, frequency=30.0, **dither)
        if compensated:
            kinds = [None, *(b.compensation(k) for k in ("feedforward", "push"))]
            rig.compensator.set_rows(ids, kinds)
        rig.controller.set_stiffness([1], translational=500.0)
        rows = []
        rig.advance(
            437,
            lambda rig=rig, rows=rows: rows.append(
                [*rig.applied.copy(), *rig.dither_torque.copy(), *rig.end_effector.position.copy()]
            ),
        )
        seen.append([np.concatenate(row) for row in rows])
    np.testing.assert_array_equal(*seen)
    assert rig.dither_torque.any()


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
