"""Columns under other people's names, in other units, without names; of a whole robot."""

from pathlib import Path

import numpy as np
import pytest

from stiction_envs.measured.checks.files import check
from stiction_envs.measured.logs.aliases import Column, column_of, our_names
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.robots import load_arm
from tests.measured.logs.bad_logs import (
    GOOD,
    VALUES,
    assert_holds,
    header_of,
    put,
    refuses,
    text_of,
    torque_log,
)

LIMITS = load_arm("panda").limits
DEGREE = np.pi / 180


def header(*names: str, first: int = 1, time: str = "t") -> str:
    """Return the header of q, dq and tau by three patterns with the joint's number in them."""
    return ",".join([time, *(n.format(j) for n in names for j in range(first, first + 7))])


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("joint_a1_pos", ("q", 1, "")),
        ("position_1", ("q", 1, "")),
        ("J1 Pos", ("q", 1, "")),
        ("JointPosition1", ("q", 1, "")),
        ("actual_q_0", ("q", 0, "")),
        ("target_q_0", ("q_cmd", 0, "")),
        ("qd3", ("dq", 3, "")),
        ("q_d_3", ("q_cmd", 3, "")),
        ("q_dot_3", ("dq", 3, "")),
        ("effort[0]", ("tau", 0, "")),
        ("tau_J_d_1", ("tau_cmd", 1, "")),
        ("torque_3 [mNm]", ("tau", 3, "mNm")),
        ("vel 2 (deg/s)", ("dq", 2, "deg/s")),
        ("position (joint 2)", ("q", 2, "")),
        ("joint_1_pos_rad", ("q", 1, "rad")),
        ("dq1_rad_s", ("dq", 1, "rads")),
        ("current_torque_abs1", ("current_abs", 1, "")),
        ("Time (s)", ("t", 1, "s")),
        ("timestamp_ms", ("t", 1, "ms")),
        ("shoulder_pan_joint_position", ("q", None, "")),
        ("wrist_angle_pos", ("q", None, "")),
        ("dtau_1", None),
        ("qdd1", None),
        ("target_qd_1", None),
        ("amplitude_nm", None),
    ],
)
def test_what_a_name_says(name: str, says: tuple | None) -> None:
    found = column_of(name)
    assert (found and (found.channel, found.number, found.unit)) == says


@pytest.mark.parametrize(
    "names",
    [
        header("position_{}", "qd{}", "effort_{}", time="time"),
        header("joint_a{}_pos", "joint_a{}_vel", "joint_a{}_torque", time="Time (s)"),
        header("q{}", "dq{}", "tau{}", first=0),
        header("panda_joint{}/position", "panda_joint{}/velocity", "panda_joint{}/effort"),
    ],
)
def test_other_names_give_the_same_numbers(tmp_path: Path, names: str) -> None:
    path = put(tmp_path / "log.csv", text_of(VALUES, names))
    own = torque_log(put(tmp_path / "own.csv", GOOD), limits=LIMITS)
    log = torque_log(path, limits=LIMITS)
    for got, expected in zip(log.arrays, own.arrays, strict=True):
        np.testing.assert_array_equal(got, expected)
    for found in (check(path), check(path, robot="panda")):
        assert not found.defects
        assert names.split(",")[1] in str(found) or "units as the table says" in str(found)


def test_units_of_a_header_or_a_row_are_used(tmp_path: Path) -> None:
    """Degrees, milliseconds and mN·m; an option of angles goes before the header."""
    values = VALUES.copy()
    values[:, 0] *= 1e3
    values[:, 1:15] /= DEGREE
    values[:, 15:] *= 1e3
    names = header("q{} [deg]", "dq{} [deg/s]", "tau{} [mNm]", time="t [ms]")
    bare = header("q{}", "dq{}", "tau{}")
    units = ",".join(["ms", *["°"] * 7, *["°/s"] * 7, *["mN·m"] * 7])
    rows = text_of(values, bare).replace(bare, f"{bare}\n{units}")
    for text in (text_of(values, names), rows):
        log = torque_log(put(tmp_path / "log.csv", text), limits=LIMITS)
        assert_holds(log, VALUES, "t q tau", rtol=1e-7, atol=1e-7)
        assert any("units as the table says: t in ms, q in" in c.text for c in log.corrections)
    asked = torque_log(put(tmp_path / "log.csv", text_of(values, names)), units="deg")
    np.testing.assert_allclose(asked.q, VALUES[:, 1:8], atol=1e-7)


def test_a_german_excel(tmp_path: Path) -> None:
    """`check` reports Windows' letters, semicolons, decimal commas and degrees."""
    values = VALUES.copy()
    values[:, 1:15] /= DEGREE
    names = header("q{} [°]", "dq{} [°/s]", "tau{} [Nm]", time="Zeit [s]")
    text = text_of(values, names).replace(",", ";").replace(".", ",")
    path = put(tmp_path / "log.csv", text.encode("cp1252"))
    log = torque_log(path, limits=LIMITS)
    np.testing.assert_allclose(log.q, VALUES[:, 1:8], atol=1e-8)
    said = str(check(path, robot="panda"))
    for text in ("Zeit [s] is t", "q in °, dq in °/s", "semicolons between its cells and decimal"):
        assert text in said


@pytest.mark.parametrize(("unit", "parts"), [("ms", 1e3), ("µs", 1e6), ("ns", 1e9)])
def test_dates_say_their_unit(tmp_path: Path, unit: str, parts: float) -> None:
    rows = text_of(VALUES[:, 1:], GOOD.splitlines()[0][2:]).splitlines()
    stamps = ["t", *(str(round((1.7e9 + t) * parts)) for t in VALUES[:, 0])]
    lines = [f"{t},{row}" for t, row in zip(stamps, rows, strict=True)]
    path = put(tmp_path / "log.csv", "# a robot\n# its day\n" + "\n".join(lines) + "\n")
    log = torque_log(path)
    np.testing.assert_allclose(log.t, VALUES[:, 0], atol=1e-6)
    assert log.date == pytest.approx(1.7e9)
    assert f"remark: times are dates in {unit}" in str(check(path))


def test_currents_are_called_so(tmp_path: Path) -> None:
    path = put(tmp_path / "log.csv", text_of(VALUES, header("q{}", "dq{}", "tau{} [A]")))
    assert "tau in A, which is a current" in str(check(path))


def test_joints_by_name(tmp_path: Path) -> None:
    """By the robot's names in any order, or as the caller says; others are left out."""
    robot = ("base", "shoulder_lift", "elbow", "wrist_angle", "a", "b", "c")
    shown = [*robot[::-1], "gripper"]
    names = ["t", *(f"{x}_{c}" for c in ("pos", "vel", "effort") for x in shown)]
    block = [np.column_stack([x[:, ::-1], x[:, 0] * 0]) for x in np.split(VALUES[:, 1:], 3, axis=1)]
    table = np.column_stack([VALUES[:, :1], *block])
    path = put(tmp_path / "log.csv", text_of(table, ",".join(names)))
    for log in (torque_log(path, robot=robot), torque_log(path, joints=robot)):
        np.testing.assert_allclose(log.q, VALUES[:, 1:8], rtol=1e-8)
        assert any("joints 1 to 7 are base, shoulder_lift" in c.text for c in log.corrections)
    refuses(lambda: torque_log(path), r"its joints are .*name the joints")


def test_columns_as_a_person_names_them(tmp_path: Path) -> None:
    path = put(tmp_path / "log.csv", text_of(VALUES, header("W{}", "V{}", "M{}", time="Zeit")))
    log = torque_log(path, columns=("t=Zeit", "q=W", "dq=V", "tau=M"))
    np.testing.assert_allclose(log.tau, VALUES[:, 15:], rtol=1e-8)
    listed = ("t", "q1..q7", "dq1..dq7", "tau1..tau7")
    bare = put(tmp_path / "bare.csv", GOOD.split("\n", 1)[1])
    for file in (path, bare):
        log = torque_log(file, columns=listed)
        np.testing.assert_allclose(log.t, VALUES[:, 0], rtol=1e-8)
    refuses(lambda: torque_log(path, columns=("t=Uhr",)), "unknown column 'Uhr': expected one of Z")
    refuses(lambda: torque_log(path, columns=("t", "q1")), "2 names for 22 columns")
    refuses(lambda: torque_log(path, columns=("zeit=Zeit",)), "columns: 'zeit': expected t, q, q1")


def test_a_chain_knows_the_joints_of_its_robot(tmp_path: Path) -> None:
    """One arm of two: its own names, and all names in the file's order, in `Arm.whole`."""
    link = '<geom size="0.1" mass="1"/><joint name="{0}" axis="{1}"/>'
    arm = "<body name='{0}1' pos='{1} 0 0'>" + link.format("{0}a", "0 1 0") + "<body name='{0}2'"
    arm += " pos='0 0 .2'>" + link.format("{0}b", "1 0 0") + "</body></body>"
    text = "<mujoco><worldbody><body name='torso'>{}{}</body></worldbody></mujoco>"
    path = tmp_path / "two.xml"
    path.write_text(text.format(arm.format("left", -1), arm.format("right", 1)))
    chain = load_arm(path, chain=("torso", "right2"))
    assert chain.joint_names == ("righta", "rightb")
    assert chain.whole == ("lefta", "leftb", "righta", "rightb")
    assert load_arm("panda").whole == ()
    q = VALUES[:, [0, *range(1, 5), *range(15, 19)]]
    log = put(tmp_path / "log.csv", text_of(q, header_of("q", "tau", joints=4)))
    found = check(log, robot=path, chain=("torso", "right2"))
    assert "joints 3, 4 of the whole robot's 4 are read" in str(found)


def test_one_joint_needs_no_number() -> None:
    assert column_of("pos") == Column("q", (), "")
    assert our_names("log", ["time", "pos", "effort"], Naming(), 1).names == ["t", "q1", "tau1"]
