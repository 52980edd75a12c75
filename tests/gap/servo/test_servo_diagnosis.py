import json
import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from stiction_envs import diagnose
from stiction_envs.gap.servo.motion import stretches
from stiction_envs.gap.servo.questions import Servo
from stiction_envs.gap.servo.servo_diagnosis import ServoDiagnosis, diagnose_servo
from stiction_envs.gap.servo.servo_parameters import INDEX, absent
from stiction_envs.hidden.examples import log_csv
from stiction_envs.hidden.servo_logs import HiddenServoLog, hide
from stiction_envs.hidden.servo_simulation import simulate
from stiction_envs.robots import Arm, load_arm
from tests.gap.servo.small_arm import TWO_LINKS, held, two_links

pytestmark = pytest.mark.slow
STEP = 1.5e-3  # of the encoder [rad]


def _hidden(
    arm: Arm, *causes: str, seed: int = 3, seconds: float = 45.0, only_slow: bool = False
) -> HiddenServoLog:
    start = np.array([-0.6, 0.8])
    return hide(arm, causes, seed=seed, seconds=seconds, start=start, only_slow=only_slow)


def _named(d: ServoDiagnosis) -> set[tuple[str, int]]:
    return {(c.name, j) for c in d.causes for j in c.joints}


@pytest.fixture
def arm(tmp_path: Path) -> Arm:
    return two_links(tmp_path)


def test_where_nothing_is_hidden_nothing_is_named(arm: Arm) -> None:
    for seed in (1, 2):
        h = _hidden(arm, seed=seed)
        d = diagnose_servo([h.log], arm, h.servo)
        assert d.causes == ()
        assert d.verdict == "no discrepancy"


@pytest.mark.parametrize(
    ("causes", "seed"),
    [
        (("coulomb_friction",), 3),
        (("dead_zone",), 3),
        (("speed_limit",), 3),
        (("torque_limit",), 3),
        (("coulomb_friction", "servo_stiffness"), 5),
    ],
)
def test_hidden_causes_are_found_on_their_joints(
    arm: Arm, causes: tuple[str, ...], seed: int
) -> None:
    h = _hidden(arm, *causes, seed=seed)
    assert set(h.hidden) <= _named(diagnose_servo([h.log], arm, h.servo, threads=2))


@pytest.mark.parametrize("stiffer", [1.0, 20.0])
def test_a_controller_that_compensates_all_gravity_is_no_stiff_servo(
    arm: Arm, stiffer: float
) -> None:
    """Under the stiffer servos, gravity would sag joint 2 by less than the encoder's step."""
    h = _hidden(arm)
    parameters = np.tile(absent(), (arm.n, 1))
    stiffness, damping = stiffer * h.stiffness, stiffer * h.damping
    friction = 0.02 * stiffness
    for name, values in (
        *(("stiffness", stiffness), ("damping", damping)),
        *(("stiction", friction), ("compensation", 1.0)),
    ):
        parameters[:, INDEX[name]] = values
    q = simulate(arm, parameters, h.log.t, h.log.q_cmd, h.log.q[0])
    q = STEP * np.round(q / STEP)
    d = diagnose_servo([replace(h.log, q=q)], arm, Servo(stiffness=stiffness, damping=damping))
    assert _named(d) == {
        (name, j) for name in ("gravity_compensation_missing", "coulomb_friction") for j in (1, 2)
    }
    for cause in d.causes:
        for j, found in cause.parameters.items():
            key, true = ("share", 1.0)
            if cause.name == "coulomb_friction":
                key, true = ("coulomb_nm", friction[j - 1])
            assert found[key].value == pytest.approx(true, rel=0.1)


def test_a_servo_three_times_as_stiff_as_stated_has_its_value(arm: Arm) -> None:
    """A rotor that is not named takes no part of the stiffness, nor of the friction."""
    h = _hidden(arm, seed=2, seconds=30.0)
    p = np.tile(absent(), (2, 1))
    p[:, INDEX["stiffness"]], p[:, INDEX["damping"]] = h.stiffness, h.damping
    p[0, INDEX["stiffness"]] *= 3
    p[0, INDEX["stiction"]], p[0, INDEX["armature"]] = 0.01 * h.stiffness[0], 0.03
    q = simulate(arm, p, h.log.t, h.log.q_cmd, h.log.q_cmd[0])
    d = diagnose_servo([replace(h.log, q=np.round(q / 0.0015) * 0.0015)], arm, h.servo)
    found = {c.name: c.parameters[1] for c in d.causes if 1 in c.joints}
    for name, key, column in (
        ("servo_stiffness", "stiffness_nm_per_rad", "stiffness"),
        ("coulomb_friction", "coulomb_nm", "stiction"),
    ):
        low, high = found[name][key].ci95
        assert low <= p[0, INDEX[column]] <= high < 2.5 * low


def test_stiction_is_above_the_coulomb_level_as_in_logs_of_torque(arm: Arm) -> None:
    h = _hidden(arm, "stribeck_friction")
    d = diagnose_servo([h.log], arm, h.servo)
    ((_, joint),) = h.hidden
    level = 0.75 * 0.02 * h.stiffness[joint - 1]  # both in motion and above it at rest
    for cause, key in (("coulomb_friction", "coulomb_nm"), ("stribeck_friction", "stiction_nm")):
        found = next(c for c in d.causes if c.name == cause).parameters[joint][key]
        assert found.value == pytest.approx(level, rel=0.35)
        assert found.ci95[0] < found.value < found.ci95[1]
        assert d.to_json()["servo"][key][joint - 1] == pytest.approx(found.value, rel=0.01)


def test_limits_of_the_model_do_not_hold_back_a_robot_that_went_further(
    arm: Arm, tmp_path: Path
) -> None:
    h = _hidden(arm, "coulomb_friction", seconds=30.0)
    narrow = tmp_path / "narrow.xml"
    most = float(h.log.q[:, 1].max())
    narrow.write_text(
        TWO_LINKS.replace(
            'name="elbow" axis="0 1 0" range="-2.5 2.5"',
            f'name="elbow" axis="0 1 0" range="-2.5 {most - 0.3}"',
        )
    )
    wide, narrower = (diagnose_servo([h.log], a, h.servo) for a in (arm, load_arm(narrow)))
    assert narrower.extended_rms == pytest.approx(wide.extended_rms, rel=1e-6)
    assert "joint 2 was logged from" in narrower.notes[0]
    assert not wide.notes


@pytest.mark.parametrize(("only_slow", "named"), [(True, "servo_lag"), (False, "delay")])
def test_slow_waves_show_a_lag_and_fast_ones_which_part_of_it(
    arm: Arm, only_slow: bool, named: str
) -> None:
    h = _hidden(arm, "delay", only_slow=only_slow)
    d = diagnose_servo([h.log], arm, h.servo)
    (cause,) = d.causes
    ((_, joint),) = h.hidden
    assert (cause.name, cause.joints) == (named, (joint,))
    if only_slow:
        lag = cause.parameters[joint]["lag_s"]
        # the nominal damping's 0.05 s and 30 ms, of which stamps that are 2 ms late take some off
        assert lag.value == pytest.approx(0.078, abs=2e-3)
        assert lag.ci95[0] < lag.value < lag.ci95[1]
        assert cause.confused_with == ("armature", "damping", "delay")
        assert set(d.to_json()["servo"]) >= {"delay_s", "damping_nms", "armature_kgm2"}


def test_a_perfect_servo_is_judged_where_no_stiffness_is_known(arm: Arm) -> None:
    h = _hidden(arm, "coulomb_friction")
    d = diagnose_servo([h.log], arm, Servo())
    assert d.nominal_rms == pytest.approx(
        np.sqrt(np.mean((h.log.q - h.log.q_cmd) ** 2, axis=0)), rel=1e-12
    )
    assert (d.extended_rms < 0.25 * d.nominal_rms).all()
    stiffness = next(c for c in d.causes if c.name == "servo_stiffness").parameters
    for j, found in stiffness.items():
        # links are off by 5 %, and set the scale
        assert found["stiffness_nm_per_rad"].value == pytest.approx(h.stiffness[j - 1], rel=0.25)


def test_joints_without_gravity_get_the_others_stiffness_where_servos_are_the_same(
    tmp_path: Path,
) -> None:
    path = tmp_path / "turning.xml"
    path.write_text(TWO_LINKS.replace('"shoulder" axis="0 1 0"', '"shoulder" axis="0 0 1"'))
    arm = load_arm(path)
    d = diagnose_servo([_hidden(arm, "coulomb_friction", seconds=20.0).log], arm, Servo(same=True))
    upright, other = d.parameters[:, INDEX["stiffness"]]
    assert upright == pytest.approx(other, rel=0.01)
    assert "by the servos of the other joints" in d.notes[0]


@pytest.mark.parametrize("same", [False, True])
def test_without_gravity_the_motion_of_the_other_joints_shows_a_stiffness(
    tmp_path: Path, same: bool
) -> None:
    """Both axes are upright; links are off by 5 %. There are no other servos to be the same as."""
    path = tmp_path / "scara.xml"
    path.write_text(TWO_LINKS.replace('axis="0 1 0"', 'axis="0 0 1"'))
    arm = load_arm(path)
    h = _hidden(arm, "coulomb_friction", seconds=20.0)
    d = diagnose_servo([h.log], arm, Servo(same=same))
    assert d.parameters[:, INDEX["stiffness"]] == pytest.approx(h.stiffness, rel=0.15)
    assert {c.name for c in d.causes} == {"damping", "coulomb_friction"}  # no rotor
    assert "joints 1, 2: gravity sets no scale of their torques; by the motion" in d.notes[0]


def test_a_stretch_in_which_the_arm_is_held_is_left_out_and_named(arm: Arm) -> None:
    h = _hidden(arm, "coulomb_friction")
    d = diagnose_servo([held(h.log, 30.0, 34.0)[0]], arm, h.servo)
    assert any(c.name == "external_contact" and c.joints == (2,) for c in d.causes)
    ((begin, end),) = stretches(h.log.t, d.touched[0])
    assert 28.0 < begin < 31.0
    assert 33.0 < end < 36.0
    assert h.hidden[0] in _named(d)


def test_the_current_tells_a_contact_from_a_servo_that_rests(arm: Arm) -> None:
    h = _hidden(arm, "coulomb_friction")
    log, stop = held(h.log, 30.0, 34.0)
    usual = np.abs(np.random.default_rng(0).normal(0.1, 0.02, size=log.q.shape))

    def diagnosed(while_stopped: float) -> tuple[set[str], str]:
        current = usual.copy()
        current[stop, 1] = while_stopped
        d = diagnose_servo([replace(log, current=current)], arm, h.servo)
        assert d.touched[0].any()  # left out in both cases
        return {c.name for c in d.causes}, " ".join(d.notes)

    names, notes = diagnosed(2.0)
    assert "external_contact" in names
    assert "rests" not in notes
    names, notes = diagnosed(0.0)
    assert "external_contact" not in names
    assert "joint 2 stands far from its command from 29" in notes


def test_files_of_a_diagnosis_and_the_model_it_hands_on(tmp_path: Path) -> None:
    robot = tmp_path / "two_links.xml"
    tool = (0.4, 0.25, 0.0, 0.0)
    arm = two_links(tmp_path, payload=tool)
    h, other = _hidden(arm, "coulomb_friction"), _hidden(arm, "coulomb_friction", seconds=30.0)
    path = tmp_path / "log.csv"
    path.write_text(log_csv(h.log.t, digits=9, q_cmd=h.log.q_cmd, q=h.log.q))
    found = diagnose(path, robot, check=[other.log], payload=tool, **h.options)
    found.save(tmp_path / "out")
    written = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert written["verdict"] == "explained"
    assert written["extended"]["rms_rad"][1] < 0.1 * written["nominal"]["rms_rad"][1]
    assert written["check"]["verdict"] == "holds"
    before, after = (written["check"][f"{k}_rms_rad"] for k in ("nominal", "extended"))
    assert after[0] < before[0]
    assert after[1] < 0.1 * before[1]
    (cause,) = written["causes"]
    assert [(cause["name"], j) for j in cause["joints"]] == list(h.hidden)
    coulomb = cause["parameters"]["coulomb_nm"]
    truth = 0.02 * h.stiffness[1]  # as `hidden.servo_logs` has it
    assert coulomb["value"] == pytest.approx(truth, rel=0.05)
    assert coulomb["ci95"][0] < coulomb["value"] < coulomb["ci95"][1]
    mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml"))
    report = (tmp_path / "out" / "report.md").read_text()
    pictures = re.findall(r"!\[.*?\]\((.*?)\)", report)
    assert {"plots/summary.png", "plots/joint_1.png", "plots/joint_2.png"} <= set(pictures)
    assert all((tmp_path / "out" / name).is_file() for name in pictures)
    # the model knows its tool: without it the arm would sag less
    again = diagnose(path, robot, nominal=tmp_path / "out" / "model.toml")
    assert again.verdict == "no discrepancy"
    assert again.causes == ()


def test_same_log_same_answer_on_any_number_of_threads(arm: Arm) -> None:
    h = _hidden(arm, "coulomb_friction", seconds=20.0)
    one, two = (diagnose_servo([h.log], arm, h.servo, threads=k).to_json() for k in (1, 2))
    assert one == two
