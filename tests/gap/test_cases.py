"""Kinds of logs that mislead a diagnosis: the right values, and nothing false beside them.

A case is made here, without the diagnosis: torques are MuJoCo's along Fourier motions, with dry
friction that builds up over 0.2 mrad, noise, and what is wrong.
"""

from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.accuracy.imperfect_arms import presliding
from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs, model_of
from stiction_envs.gap.signals.angles import angle_error
from stiction_envs.gap.validation.check import check_model
from stiction_envs.hidden.hidden_motions import MOTIONS
from stiction_envs.hidden.worlds import inverse_torque, with_scattered_links
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm, load_arm
from tests.gap.small_logs import motion
from tests.other_arms.arms import ROBOTS, WHEEL

Array = NDArray[np.float64]
MIDDLE = np.array([0.5, -1.2, 1.2, -0.5, 0.2, 0.3])
"""Middle of the UR10's motions [rad]."""
DRY = np.array([8.0, 10.0, 6.0, 2.0, 2.0, 1.5])
"""Dry friction of the UR10 [N·m]."""
SLOPE = np.array([10.0, 12.0, 6.0, 2.0, 1.5, 1.5])
"""Viscous friction of the UR10 [N·m·s/rad]."""
FRICTION = {"coulomb_friction", "viscous_friction"}
Truth = dict[str, dict[int, float]]
"""True values of causes by joint, from 1; joint 0 is the arm."""


def ur10(mass: float = 0.0) -> Arm:
    """The arm with a mass on its flange [kg]."""
    path = Path(str(metadata.distribution(WHEEL).locate_file(ROBOTS)))
    payload = (mass, 0.0, 0.0, 0.058) if mass else None
    return load_arm(path / "ur_description/urdf/ur10_robot.urdf", payload=payload)


@dataclass
class Recording:
    """A motion, and the torque that it takes."""

    arm: Arm
    t: Array
    q: Array
    dq: Array
    ddq: Array
    tau: Array

    def gravity(self) -> Array:
        """(T, n) torque that holds the arm [N·m]."""
        still = np.zeros_like(self.q)
        return inverse_torque(self.arm.model(), self.q, still, still)

    def log(self, noise: float | Array, seed: int = 0) -> JointLog:
        """Return a robot's log, with noise of torque [N·m] and angles in steps."""
        rng = np.random.default_rng(seed)
        tau = self.tau + noise * rng.normal(size=self.q.shape)
        q = np.round(self.q / 1e-5) * 1e-5
        return JointLog(source="case.csv", t=self.t, q=q, dq=None, tau=np.round(tau, 3))


def recorded(
    arm: Arm,
    dry: Array | float = DRY,
    slope: Array | float = SLOPE,
    *,
    middle: Array = MIDDLE,
    reach: float = 0.6,
    seconds: float = 30.0,
    seed: int = 1,
    one_way: tuple[int, ...] = (),
) -> Recording:
    """A motion of an arm with friction; joints (from 0) that turn one way."""
    t, q, dq, ddq = motion(arm.n, seconds, seed, reach)
    for j in one_way:  # faster than it would turn back
        speed = 1.2 * np.abs(dq[:, j]).max()
        q[:, j] += speed * (t - seconds / 2)
        dq[:, j] += speed
    q = q + middle
    tau = inverse_torque(arm.model(), q, dq, ddq) + dry * presliding(q, 2e-4) + slope * dq
    return Recording(arm, t, q, dq, ddq, tau)


def of_joints(values: Array) -> dict[int, float]:
    return dict(enumerate(values.tolist(), 1))


def named_alone(
    log: JointLog, robot: Arm | str, *also: str, truth: Truth, **within: float
) -> Diagnosis:
    """Diagnose; the causes of ``truth`` are named with their values, ``also``, and nothing else.

    Values are ``within`` a share of the truth, by default a tenth.
    """
    found = diagnose_logs([log], robot)
    named = {c.name: c for c in found.causes}
    assert set(named) == {*truth, *also}
    for name, values in truth.items():
        key = cause_named(name).parameters[0].name
        assert 0 in values or named[name].joints == tuple(values)
        for joint, true in values.items():
            estimate = named[name].parameters[joint][key]
            low, high = np.ravel(estimate.ci95)
            assert low <= true <= high, f"{name} {joint}: {true} not in {low:.4g} to {high:.4g}"
            assert estimate.value == pytest.approx(true, rel=within.get(name, 0.1))
    return found


UR_FRICTION = {"coulomb_friction": of_joints(DRY), "viscous_friction": of_joints(SLOPE)}


@pytest.mark.slow
def test_a_heavy_payload_is_weighed_along_a_small_motion() -> None:
    """±0.25 rad, along which its weight hardly changes."""
    log = recorded(ur10(10.0), reach=0.25, seconds=60.0).log(noise=0.3)
    truth = {"payload": {0: 10.0}, **UR_FRICTION}
    named_alone(log, ur10(), truth=truth, payload=0.03, viscous_friction=0.3)


def test_currents_in_place_of_torques_are_one_scale_of_all_joints() -> None:
    """Friction is in N·m all the same."""
    made = recorded(ur10())
    made.tau *= 0.08
    log, truth = made.log(noise=0.01), {"torque_scale": {0: 0.08}, **UR_FRICTION}
    found = named_alone(log, ur10(), truth=truth, torque_scale=0.01)
    assert ("torque_scale", (1, 2, 3, 4, 5, 6)) in [(c.name, c.joints) for c in found.causes]


@pytest.mark.slow
def test_currents_of_three_sizes_of_gears_are_three_scales() -> None:
    """The model file knows them: the same log does not differ from it."""
    gears, made = np.array([12.5, 12.5, 11.0, 9.2, 9.2, 9.2]), recorded(ur10())
    made.tau /= gears
    log = made.log(noise=0.01)
    found = diagnose_logs([log], ur10())
    causes = {c.name: c.parameters for c in found.causes}
    assert set(causes) == {*FRICTION, "torque_scale"}
    for j in range(3):  # the wrist's load is small
        assert causes["torque_scale"][j + 1]["scale"].value == pytest.approx(1 / gears[j], rel=0.02)
    for j in range(4):
        dry = causes["coulomb_friction"][j + 1]["coulomb_nm"]
        assert dry.ci95[0] <= DRY[j] <= dry.ci95[1]
        assert dry.value == pytest.approx(DRY[j], rel=0.1)
    again = diagnose_logs([log], ur10(), nominal=model_of(found))
    assert (again.verdict, again.causes) == ("no discrepancy", ())


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1000.0, 100 / np.array([45.0] * 3 + [17.0] * 4)])
def test_other_units_are_converted(unit: Array | float) -> None:
    """Torques in mN·m, or in percent of what each joint can bear; check logs are, too."""
    middle = np.array([0.1, -0.3, 0.2, -1.8, 0.3, 1.8, 0.4])
    dry = np.array([0.6, 0.7, 0.5, 0.5, 0.4, 0.3, 0.3])
    logs = []
    for seed in (1, 2):
        made = recorded(load_arm("panda"), dry, 0.6 * dry, middle=middle, reach=0.5, seed=seed)
        made.tau *= unit
        logs.append(made.log(noise=0.02 * unit))
    also = ("torque_scale", "viscous_friction")
    found = named_alone(logs[0], "panda", *also, truth={"coulomb_friction": of_joints(dry)})
    assert check_model(found, logs[1:]).verdict == "holds"


@pytest.mark.slow
def test_sensors_that_measure_nothing_are_left_out() -> None:
    """The torques of the wrist are noise: nothing is named on these joints, and all else is."""
    made = recorded(ur10(3.0))
    made.tau[:, 3:] = 0.0
    log, truth = made.log(noise=0.02), {"coulomb_friction": of_joints(DRY[:3])}
    found = named_alone(log, ur10(3.0), "viscous_friction", truth=truth)
    assert {c.joints for c in found.causes} == {(1, 2, 3)}
    assert found.verdict == "explained"
    assert "the torque of joints 4, 5 and 6 is not measured" in found.notes[0]
    assert found.gain_percent > 90  # of the joints that are measured


def test_an_arm_on_the_ceiling_is_said_to_be_there() -> None:
    """Nothing else is named: along the wrong gravity all of it would be false."""
    made = recorded(ur10())
    made.tau -= 2 * made.gravity()
    found = diagnose_logs([made.log(noise=0.1)], ur10())
    assert (found.verdict, found.causes) == ("cannot tell", ())
    assert "mounted on a ceiling? `--tilt 3.14159 0`" in found.notes[0]


@pytest.mark.slow
def test_a_zero_that_is_far_off_is_named() -> None:
    """A quarter turn, beside friction: the rest is found as without it."""
    made = recorded(ur10())
    made.q[:, 2] += 1.57
    log, also = made.log(noise=0.1), ("viscous_friction", "encoder_offset")
    found = named_alone(log, ur10(), *also, truth={"coulomb_friction": of_joints(DRY)})
    ((joint, values),) = next(x for x in found.causes if x.name == also[1]).parameters.items()
    assert (joint, values["offset_rad"].value) == (3, pytest.approx(1.57, rel=0.03))


def test_a_torque_that_wanders_is_no_cause() -> None:
    """A random walk: what is fitted to a part of the time is worse on the rest than nothing."""
    made = recorded(load_arm("panda"), 0.0, 0.0, middle=load_arm("panda").rest)
    steps = np.random.default_rng(3).normal(size=made.q.shape)
    made.tau += 0.3 * np.cumsum(steps, axis=0) / np.sqrt(200.0)
    found = diagnose_logs([made.log(noise=0.02)], "panda")
    assert (found.verdict, found.causes) == ("cannot tell", ())


def test_torques_without_gravity_are_told_from_friction_on_joints_that_turn_one_way() -> None:
    made = recorded(ur10(), 0.0, reach=0.4, one_way=(0, 5))
    made.tau -= made.gravity()
    truth = {"gravity_compensation_missing": {0: 1.0}, "viscous_friction": of_joints(SLOPE)}
    log = made.log(noise=0.3)
    found = named_alone(log, ur10(), truth=truth, gravity_compensation_missing=0.02)
    assert found.notes[0].startswith("the torques lack gravity, but not friction")


def test_an_offset_above_dry_friction_is_no_asymmetry_where_joints_never_rest() -> None:
    """Friction that drives in one direction does not exist."""
    arm = load_arm("panda")
    made = recorded(arm, 0.3, 0.2, middle=arm.rest)
    made.tau[:, [3, 6]] += [0.6, -0.35]
    truth = {"torque_offset": {4: 0.6, 7: -0.35}}
    named_alone(made.log(noise=0.03), arm, *FRICTION, truth=truth)


def test_torque_that_falls_with_speed_is_no_friction() -> None:
    """A drive's own feed-forward: friction would drive the joint."""
    arm = load_arm("panda")
    made = recorded(arm, 0.5, np.array([0.0, 0.0, 0.0, 0.0, 0.0, -0.4, 0.0]), middle=arm.rest)
    truth = {"falling_torque": {6: 0.4}}
    named_alone(made.log(noise=0.02), arm, "coulomb_friction", truth=truth)


@pytest.mark.slow
def test_a_spring_and_a_payload_that_the_model_overstates_are_told_apart() -> None:
    made = recorded(ur10(6.0))
    made.tau[:, 1] += 150.0 * (made.q[:, 1] + 1.5)
    log, truth = made.log(noise=0.3), {"external_spring": {2: 150.0}, "payload": {0: -2.0}}
    named_alone(log, ur10(8.0), *FRICTION, truth=truth, external_spring=0.05)


def test_no_two_causes_are_large_and_opposed_where_little_is_left() -> None:
    """A short log with slow wandering torques: no cause is above five times what it explains."""
    arm = load_arm("panda")
    true = with_scattered_links(arm, 0.03, np.random.default_rng(2))
    made = recorded(true, np.repeat([0.0, 0.2], [4, 3]), 0.0, middle=arm.rest, seconds=16.0)
    rng = np.random.default_rng(5)
    for j in range(arm.n):
        at = np.linspace(0, 16, 12)
        made.tau[:, j] += np.interp(made.t, at, 0.2 * rng.normal(size=12))
    log = made.log(noise=0.05)
    found = diagnose_logs([replace(log, t=log.t[::6], q=log.q[::6], tau=log.tau[::6])], arm)
    for cause in found.causes:
        size = np.sqrt(np.mean(np.square(found.cause_torque(cause.name)), axis=0))
        assert np.all(size <= 5 * found.nominal_rms), cause.name


def test_loads_may_be_late_where_friction_is_not() -> None:
    """A model whose columns lose what the one before explained is not taken."""
    arm = load_arm("panda")
    made = recorded(arm, 0.3, 0.2, middle=arm.rest)
    rigid = inverse_torque(arm.model(), made.q, made.dq, made.ddq)
    late = round(0.08 / float(made.t[1] - made.t[0]))
    made.tau += np.vstack([np.repeat(rigid[:1], late, axis=0), rigid[:-late]]) - rigid
    found = diagnose_logs([made.log(noise=0.05)], arm, torque="link")
    causes = {c.name: c for c in found.causes}
    assert set(causes) == {*FRICTION, "actuator_delay"}
    (delay,) = causes["actuator_delay"].parameters.values()
    assert delay["delay_s"].value == pytest.approx(-0.08, rel=0.1)
    for name, key, true in (("coulomb", "coulomb_nm", 0.3), ("viscous", "viscous_nms", 0.2)):
        for each in causes[f"{name}_friction"].parameters.values():
            assert each[key].value == pytest.approx(true, rel=0.2)
    assert found.extended_rms.mean() < 0.05


@pytest.mark.parametrize("distance", [0.04, 0.06])
def test_joints_that_yield_far_are_named_with_their_stiffness(distance: float) -> None:
    """Dahl's friction that builds up over 40 or 60 mrad, in a log of small reversals."""
    arm, t, joints = load_arm("panda"), np.arange(0, 20, 1 / 250), (2, 4, 6)
    q = MOTIONS["reversals"](np.random.default_rng(3), t)
    dq = np.gradient(q, t, axis=0)
    ddq = np.gradient(dq, t, axis=0)
    dry = np.isin(np.arange(1, 8), joints) * presliding(q, distance)
    made = Recording(arm, t, q, dq, ddq, inverse_torque(arm.model(), q, dq, ddq) + dry)
    stiffness = {"presliding_hysteresis": dict.fromkeys(joints, 1 / distance)}
    found = named_alone(made.log(noise=0.03), arm, "coulomb_friction", truth=stiffness)
    assert found.verdict == "explained"


@pytest.mark.parametrize(("robot", "noise"), [("panda", 0.01), ("iiwa7", 0.05), ("iiwa14", 0.5)])
def test_no_effect_is_no_discrepancy(robot: str, noise: float) -> None:
    arm = load_arm(robot)
    made = recorded(arm, 0.0, 0.0, middle=arm.rest, seconds=15.0)
    assert named_alone(made.log(noise), arm, truth={}).verdict == "no discrepancy"


def test_a_constant_torque_about_a_vertical_axis_is_no_body() -> None:
    """Only joint 1 turns, so that gravity never changes: an offset at most is named.

    1 N·m is as much as small errors of the links hold.
    """
    arm = load_arm("iiwa7")
    t, *path = motion(7, seconds=10.0)
    q, dq, ddq = (x * np.eye(7)[0] for x in path)
    q += [0.0, 0.5, 0.0, -1.2, 0.0, 1.0, 0.0]
    tau = inverse_torque(arm.model(), q, dq, ddq) + np.eye(7)[1]
    found = diagnose_logs([Recording(arm, t, q, dq, ddq, tau).log(noise=0.02)], arm)
    assert {c.name for c in found.causes} <= {"torque_offset"}


def test_a_few_independent_rows_show_no_far_zero() -> None:
    """One of a hundred zeros fits them by chance, as in a Kinova's log of two seconds."""
    made = recorded(ur10(), seconds=10.0)
    moved = made.q + 1.0 * np.eye(6)[2], made.dq, made.ddq
    for rows, found in ((3, None), (40, 3)):
        error = angle_error(moved, made.tau, ur10(), rows)
        assert (error and error.joint) == found
