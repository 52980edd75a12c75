"""Ask, measure, tell on an arm of two joints; the measured robot is not the simulated one."""

import shutil

import pytest

from stiction_envs.measured.tables import read_amplitudes
from tests.command_line import csv_rows
from tests.refusal import refusal
from tests.tuning.conftest import small
from tests.tuning.robot.made_up import COLUMNS, fill, write
from tuning.robot.session import Session

SETTINGS = {"robot.frequencies": 3, "robot.amplitudes": 2, "robot.iterations": 1}


def ask(arm, **options):
    return Session(arm, **options).ask()


def tell(arm, table, **options):
    return Session(arm, **options).tell(table)


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """A folder in which was asked once, and the options of its session."""
    folder = tmp_path_factory.mktemp("asked")
    arm, protocol = small(folder)
    options = {"protocol": protocol, "settings": SETTINGS, "threads": 1}
    state = ask(arm, out=folder / "out", **options)
    return arm, folder / "out", options, state


@pytest.fixture
def session(asked, tmp_path):
    """The arm, and options with a copy of that folder."""
    arm, folder, options, state = asked
    shutil.copytree(folder, tmp_path / "out")
    return arm, {**options, "out": tmp_path / "out"}, state


def contents(out):
    names = ("ask.csv", "measure.csv", "final.csv", "final.yaml", "report.md")
    return {name: (out / name).read_bytes() for name in names if (out / name).exists()}


def test_the_first_ask_is_an_amplitude_table_and_a_form_to_fill_in(session):
    arm, options, state = session
    rows = read_amplitudes(options["out"] / "ask.csv", n_joints=2)
    assert [r.joint for r in rows] == [1, 2]
    for row, j in zip(rows, state.joints, strict=True):
        assert row == j.candidates.row(int(j.candidates.predicted.mean(axis=1).argmin()))
    form = csv_rows(options["out"] / "measure.csv")
    assert len(form) == 2 * 4 * 2, "base torques and one setting, four cells each"
    assert {r["tau_nm"] for r in form} == {""}
    table = options["out"] / "measure.csv"
    refusal(lambda: tell(arm, table, **options), "every tau_nm is empty")


def test_it_finds_the_robots_best_and_stops(session):
    """A robot that the simulation's best frequency frees less, and all others more."""
    arm, options, state = session
    out = options["out"]
    first = {row["joint"]: row["frequency_hz"] for row in state.asked}

    def left(joint, f):
        return 0.99 if f == first[joint] else 0.90

    told = 0
    while (out / "ask.csv").exists():
        told += 1
        assert told < 9, "it never stopped"
        tell(arm, fill(out, f"{told}.csv", left=left), **options)
        state = ask(arm, **options)
    assert not (out / "measure.csv").exists()
    rows = read_amplitudes(out / "final.csv", n_joints=2)
    assert [left(r.joint, r.frequency_hz) for r in rows] == [0.90, 0.90]
    assert all(x["stop"] for x in state.to_json()["joints"])
    for x in state.to_json()["joints"]:
        assert x["believed_reduction"] == pytest.approx(0.10, abs=x["half_interval"])
    assert "**Stop: no joint is worth another measurement.**" in (out / "report.md").read_text()


def test_the_same_table_told_twice_counts_once(session):
    arm, options, _ = session
    table = fill(options["out"])
    assert tell(arm, table, **options).told == 4, "base torques and a setting of two joints"
    before = contents(options["out"])
    assert tell(arm, table, **options).told == 0
    assert contents(options["out"]) == before
    assert len((options["out"] / "study.jsonl").read_text().splitlines()) == 2


def test_a_setting_that_was_not_asked_for_counts_too(session):
    arm, options, state = session
    c = next(iter(state.joints)).candidates
    f = 0.5 * float(c.frequency_hz.min() + c.frequency_hz.max())
    a = 0.5 * float(c.amplitude_nm.max())
    rows = [
        dict(zip(COLUMNS, ("small", 1, load, d, f, a, s * 0.3), strict=True))
        for load in ("load", "no_load")
        for d, s in (("+", 1), ("-", -1))
    ]
    found = tell(arm, write(options["out"].parent / "extra.csv", rows), **options)
    j = next(iter(found.joints))
    assert len(j.candidates) == len(c) + 1
    assert j.readings.measured[-1]
    assert j.candidates.row(len(c)).frequency_hz == f
    # typed with three digits it is the same setting
    rounded = [{**r, "frequency_hz": f"{f:.4g}", "amplitude_nm": f"{a:.4g}"} for r in rows]
    found = tell(arm, write(options["out"].parent / "rounded.csv", rounded), **options)
    j = next(iter(found.joints))
    assert len(j.candidates) == len(c) + 1
    assert len(j.readings.rows) == 8


def test_a_stuck_joint_is_not_asked_for_that_again(session):
    arm, options, _ = session
    rows = csv_rows(fill(options["out"]))
    rows = [r | ({"tau_nm": "nan"} if float(r["amplitude_nm"]) else {}) for r in rows]
    before = read_amplitudes(options["out"] / "ask.csv", n_joints=2)
    tell(arm, write(options["out"].parent / "stuck.csv", rows), **options)
    ask(arm, **options)
    after = read_amplitudes(options["out"] / "ask.csv", n_joints=2)
    assert not set(before) & set(after)


def test_torques_are_held_against_the_base_torques_of_their_day(session):
    """If all torques rise by a quarter overnight, the ratios stay."""
    arm, options, _ = session
    today = csv_rows(fill(options["out"]))
    tell(arm, options["out"].parent / "told.csv", **options)
    later = [r | {"tau_nm": 1.25 * float(r["tau_nm"])} for r in today]
    found = tell(arm, write(options["out"].parent / "later.csv", later), **options)
    for j in found.joints:
        assert len(j.readings.rows) == 8
        assert j.readings.ratio == pytest.approx(0.9)
    # without any of that day: the mean of all days
    dithered = [r for r in today if float(r["amplitude_nm"])]
    found = tell(arm, write(options["out"].parent / "third.csv", dithered), **options)
    assert next(iter(found.joints)).readings.ratio[-1] == pytest.approx(0.9 * 0.8 / 0.9)
