"""Logs and tables as commands read them: ``stiction check``, robots' own logs, other formats."""

import json
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest

import stiction_envs as st
from stiction_envs.hidden.examples import log_csv
from stiction_envs.measured.logs.formats import registry
from stiction_envs.measured.logs.formats.base import Header
from stiction_envs.measured.logs.reader import read_logs
from tests.gap.small_logs import hidden
from tests.measured.checks.test_checks import sje, write_sje
from tests.measured.logs.ros_bags import joint_states, write_bag
from tests.refusal import refusal


@pytest.fixture
def clean(inputs):
    path = inputs / "sje.csv"
    write_sje(path, sje(np.random.default_rng(0)))
    return path


def test_nothing_wrong(cli, work, clean, log, two):
    ran = cli("check", clean, log, "--robot", two)
    assert ran.code == 0, ran.out
    page, wrong = ran.out.rsplit("\n\n", 1)
    assert wrong == "nothing wrong\n"
    assert page.startswith("log.csv: 3000 rows, 15.0 s, 200 rows/s")
    assert ran.err == ""
    assert list(work.iterdir()) == []
    # the number of joints is told from the columns
    assert cli("check", log).code == 0


def test_a_mounting_that_was_found_is_stated(cli, inputs):
    hanging = hidden(st.load_arm("panda", tilt=(np.pi, 0.0)), lambda q, dq, ddq: np.sign(dq))
    log = inputs / "hanging.csv"
    log.write_text(log_csv(hanging.t, q=hanging.q, tau=hanging.tau))
    assert "mounted on a ceiling? `--tilt 3.14159 0`" in cli("check", log, "--robot", "panda").out
    assert "ceiling" not in cli("check", log, "--robot", "panda", "--tilt", 3.14159, 0).out
    assert cli("check", log, "--tilt", 3.14159, 0).code == 2


def test_a_log_says_what_was_corrected_and_what_was_not(cli, inputs, log, two):
    """A repeated row, an unknown column, a torque at its limit."""
    header, *rows = log.read_text().splitlines()
    rows[100:100] = rows[99:100]
    cells = [row.split(",") for row in rows]
    for k in range(300, 330):
        cells[k][4] = "9.0"
    text = "\n".join([header + ",mood", *(",".join([*c, "1"]) for c in cells)])
    log.write_text(text + "\n")
    ran = cli("check", log, "--robot", two)
    assert ran.code == 1
    kinds = [line.split(": ")[1] for line in ran.out.split("\n\n")[-1].splitlines()]
    assert sorted(kinds) == ["corrected", "remark", "warning"]
    assert "'mood'" in ran.out
    assert "tau2 stays at its largest value" in ran.out


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,q1,q2,tau1,tau2\n0,0,0,0,0\n1,9,9,9,9\n0.5,0,0,0,0\n", "unreadable: line 4: t falls"),
        ("t,x\n0,0\n", "unreadable: no column q1"),
        ("", "unreadable: empty file"),
        ("robot,joint,load,direction,tau_base_Nm\narm,1,load,+,x\n", "unreadable: line 2: tau_bas"),
    ],
)
def test_a_file_that_nothing_can_be_done_with_is_a_defect(cli, inputs, clean, text, says):
    """The other files are checked all the same."""
    path = inputs / "bad.csv"
    path.write_text(text)
    ran = cli("check", path, clean)
    assert ran.code == 1
    (line,) = ran.out.splitlines()
    assert line.startswith(f"{path}: {says}"), line
    assert ran.lines == ["error: 1 defect found"]


# ---- logs as robots write them -------------------------------------------------------------------


@pytest.fixture
def values(log):
    """Numbers of the log, t, q, dq, tau, as the text rounds them."""
    t, q, tau = np.split(np.loadtxt(log, delimiter=",", skiprows=1), [1, 3], axis=1)
    return np.column_stack([t, q, np.gradient(q, t[:, 0], axis=0), tau])


@pytest.mark.slow
def test_diagnose_and_identify_a_bag(cli, two, log, values, inputs, work):
    """As ROS 2 records the same numbers, under names of joints that only have the arm's numbers."""
    states = joint_states(values, ("my_joint1", "my_joint2"), speeds=False)
    bag = write_bag(inputs / "bag", "folder", states)
    for command, name in (("diagnose", "diagnosis"), ("identify", "identification")):
        found = {}
        for path in (log, bag):
            options = ["--robot", two, "--torque", "link", "--out", path.name, "--force"]
            ran = cli(command, path, *options)
            assert ran.code == 0, ran.err
            found[path.name] = json.loads((work / path.name / f"{name}.json").read_text())
        a, b = (found[path.name] for path in (log, bag))
        shown = ("causes", "extended", "nominal", "verdict", "links", "friction")
        assert {k: a[k] for k in shown if k in a} == {k: b[k] for k in shown if k in b}
        made = json.loads((work / bag.name / "provenance.json").read_text())
        assert len(made["inputs"]["log1"]["sha256"]) == 64
    assert "my_joint1, my_joint2" in (work / "bag/report.md").read_text()


# ---- a kind of log from outside the package ------------------------------------------------------


OURS = {"time_us": "t", "angle1": "q1", "angle2": "q2", "torque1": "tau1", "torque2": "tau2"}
MINE = Header(
    mark="time_us",
    column=lambda name: OURS.get(name, name),
    per_second=1e6,
    side="link",
    note="a log of mine",
)


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The cause comes from the entry points of another package; afterwards it is forgotten."""
    points = [SimpleNamespace(load=lambda: MINE)]
    before = [*registry.HEADERS]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)
    registry._load_entry_points.cache_clear()
    yield
    registry.HEADERS[:] = before
    registry._load_entry_points.cache_clear()


@pytest.mark.usefixtures("known")
def test_a_format_from_outside_is_read_by_library_and_commands(cli, inputs, two, log) -> None:
    (own,) = read_logs([log], 2)
    mine = inputs / "mine.csv"
    table = np.column_stack([1e6 * own.t, own.q, own.tau])
    np.savetxt(mine, table, delimiter=",", header=",".join(OURS), comments="", fmt="%.17g")
    (read,) = read_logs([mine], 2)
    assert read.side == "link"
    np.testing.assert_allclose(read.t, own.t, atol=1e-9)
    np.testing.assert_array_equal(read.tau, own.tau)
    assert not st.check(mine, robot=two).defects
    for new in (MINE, registry.CsvFile()):
        refusal(lambda new=new: registry.register(new), "expected")
    assert cli("check", mine, "--robot", two).code == 0


# ---- servo logs, and angles in other units -------------------------------------------------------


def test_units_reach_the_reader(cli, inputs, values, two, work):
    t, q, _, tau = np.split(values, [1, 3, 5], axis=1)
    path = inputs / "degrees.csv"
    path.write_text(log_csv(t[:, 0], digits=9, q=np.degrees(q), tau=tau))
    ran = cli("check", path, "--robot", two)
    assert ran.code == 1
    assert "looks like degrees" in ran.out
    assert "or units deg (percent, ticks)" in ran.out
    ran = cli("check", path, "--robot", two, "--units", "deg", "--out", "found")
    assert ran.code == 0, ran.out
    assert "remark: joints 1, 2: degrees" in ran.out
    made = json.loads((work / "found" / "provenance.json").read_text())
    assert made["arguments"]["units"] == "deg"
    for command in (("check", path), ("identify", path, "--robot", two)):
        ran = cli(*command, "--units", "ticks", "--calibration", "gone.json", "--out", "none")
        assert ran.code == 2
        assert "gone.json: no such file" in ran.out + ran.err
