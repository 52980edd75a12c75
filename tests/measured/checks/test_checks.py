"""`stiction check` on torque tables of which everything is known."""

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.hidden.examples import log_csv
from stiction_envs.measured.checks.files import check
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.measured.tables import (
    BASE_COLUMNS,
    SJE_COLUMNS,
    AmplitudeRow,
    SJERow,
    write_amplitudes,
    write_sje,
)

POSES = [(load, direction) for load in ("load", "no_load") for direction in "+-"]


def sje(rng):
    rows = []
    for joint in range(1, 4):
        for load, direction in POSES:
            base = (1 if direction == "+" else -1) * rng.uniform(0.4, 3.0)
            key = dict(robot="arm", joint=joint, load=load, direction=direction, iterations=3)
            rows.append(
                SJERow(**key, frequency_hz=0, amplitude_nm=0, tau_nm=base, std_nm=0.01, reduction=0)
            )
            for f in (30.0, 50.0):
                cut = rng.uniform(0.05, 0.4)
                more = dict(frequency_hz=f, amplitude_nm=abs(base), tau_nm=base * (1 - cut))
                rows.append(SJERow(**key, **more, std_nm=0.01, reduction=cut))
    return rows


@pytest.fixture
def kinds(tmp_path):
    """Return what finds the defects of an SJE table: their places and kinds."""

    def found(rows):
        write_sje(tmp_path / "sje.csv", rows)
        return [(x.where, x.kind) for x in check(tmp_path / "sje.csv").findings]

    return found


@pytest.mark.parametrize("seed", range(2))
def test_a_hidden_defect_is_found_and_nothing_else(kinds, seed):
    rng = np.random.default_rng(seed)
    rows = sje(rng)
    assert kinds(rows) == []
    i = int(rng.choice([k for k, r in enumerate(rows) if not r.is_base]))
    r = rows[i]
    place = f"arm joint {r.joint}, {r.load} {r.direction}"
    setting = f"{place}, {r.frequency_hz:g} Hz, {r.amplitude_nm:g} N·m"

    def changed(**cells):
        return [*rows[:i], replace(r, **cells), *rows[i + 1 :]]

    assert kinds(changed(reduction=r.reduction + 0.01)) == [(setting, "percentage")]
    assert kinds(changed(tau_nm=-r.tau_nm)) == [(place, "sign")]
    for std, step, n in ((0.01, 0.05, 0), (0.01, 0.1, 1), (np.nan, 0.01, 0), (np.nan, 1.5, 1)):
        step = step if r.direction == "+" else -step
        twice = replace(r, tau_nm=r.tau_nm + step, reduction=np.nan, std_nm=std)
        assert kinds([*rows, twice]) == [(setting, "repeat")] * n
    # without its base row a reduction cannot be judged
    assert kinds([x for x in changed(reduction=0.0) if not x.is_base]) == []


def test_printed_digits_say_how_far_a_reduction_may_be_off(tmp_path):
    """0.9/1.4 are 0.6429, but 0.85/1.45 are 0.586: one digit leaves room for 1 - 0.61."""
    key = ("arm", 1, "load", "+")
    for base, tau, reduction, n in (
        *(("1.4", "0.9", "0.39", 0), ("1.40", "0.90", "0.39", 1)),
        ("1.400", "0.900", "0.357", 0),
    ):
        rows = [(*key, 0, 0, base, 0, 3, 0), (*key, 15, 1, tau, 0, 3, reduction)]
        write_lines(tmp_path / "sje.csv", SJE_COLUMNS, rows)
        assert len(check(tmp_path / "sje.csv").findings) == n


def test_base_torques_in_the_form_of_the_thesis(tmp_path):
    rows = [("arm", 1, "load", "+", 0.5), ("arm", 1, "load", "-", 0.4)]
    write_lines(tmp_path / "base.csv", BASE_COLUMNS, rows)
    (found,) = check(tmp_path / "base.csv").findings
    assert (found.where, found.kind) == ("arm joint 1, load -", "sign")
    assert found.message == "0.4, expected < 0: torque against the direction of its ramp"


def test_amplitude_tables(tmp_path):
    path = tmp_path / "final.csv"
    write_amplitudes(path, [AmplitudeRow(7, 15.0, 13.0)])
    assert not check(path).findings
    (found,) = check(path, robot="panda").findings
    assert found.message.startswith("line 2: amplitude_nm is 13: expected at most the torque limit")
    path.write_text(path.read_text() + "7,15.0,1.0\n")
    (found,) = check(path).findings
    assert (found.kind, found.message.split(":")[0]) == ("unreadable", "line 3")


CONTINUOUS = """<robot name="two">
<link name="base"><inertial><mass value="5"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0"
iyz="0"/></inertial></link>{}</robot>"""
JOINT = """<link name="{0}"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0"
ixz="0" iyz="0"/></inertial></link><joint name="j{0}" type="continuous"><parent link="{1}"/>
<child link="{0}"/><axis xyz="0 1 0"/><limit effort="{2}" velocity="3"/></joint>"""


def test_continuous_joints_have_no_limits(tmp_path):
    """Angles within one turn are a remark, not an error."""
    robot = tmp_path / "two.urdf"
    links = JOINT.format("a", "base", 60) + JOINT.format("b", "a", 30)
    robot.write_text(CONTINUOUS.format(links))
    t = np.arange(0, 8, 0.01)
    q = np.stack([1.5 * t, 0.5 * np.sin(t)], axis=1)
    tau = np.stack([np.cos(q[:, 0]), np.sin(3 * t)], axis=1)
    for angles, said in ((q, []), (np.angle(np.exp(1j * q)), ["remark"])):
        (tmp_path / "log.csv").write_text(log_csv(t, digits=15, q=angles, tau=tau))
        assert [x.kind for x in check(tmp_path / "log.csv", robot=robot).findings] == said


def test_tables_with_semicolons_and_decimal_commas(tmp_path):
    """Excel saves such tables in most of Europe."""
    path = tmp_path / "final.csv"
    write_amplitudes(path, [AmplitudeRow(7, 15.5, 13.25)])
    path.write_text(path.read_text().replace(",", ";").replace(".", ","), "utf-16")
    assert not check(path).findings
    (found,) = check(path, robot="panda").findings
    assert found.message.startswith("line 2: amplitude_nm is 13.25: expected at most the torque")
