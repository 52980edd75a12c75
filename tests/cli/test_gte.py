"""``stiction gte`` from end to end, on short paths."""

import json
import math

import pytest

from stiction_envs.cli import gte
from stiction_envs.control.compensation_files import write_treatment
from stiction_envs.experiments.gte import protocol as gte_protocol
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import AXES
from stiction_envs.measured.tables import AmplitudeRow
from stiction_envs.robots import load_arm
from tests.command_line import csv_rows


@pytest.fixture
def path(inputs):
    """Two goals 3 cm away: 3 s."""
    file = inputs / "hook.csv"
    file.write_text("x,y,z\n0.03,0,0\n0,0.03,0\n")
    return file


@pytest.fixture
def table(inputs):
    file = inputs / "dither.csv"
    file.write_text("joint,frequency_hz,amplitude_nm\n2,30,1.2\n4,50,2.0\n7,15,0.8\n")
    return file


STIFF = ["--stiffness", 400, 40, 0]
QUICK = [*STIFF, "--iterations", 1]


def test_with_dither(cli, work, path, table):
    options = ["--iterations", 2, "--dither", table]
    ran = cli("gte", "panda", "--trajectory", path, *STIFF, *options, "--json")
    assert ran.code == 0
    result = json.loads(ran.out)
    assert "thesis" not in ran.out
    out = work / "runs" / "gte-panda"
    assert {p.name for p in out.iterdir()} == {
        *("errors.csv", "runs.csv", "points.csv", "trace.csv", "provenance.json"),
        *("path_xy.png", "path_3d.png", "error_position.png", "error_orientation.png"),
        *("report.md", "report.html"),
    }
    rows = csv_rows(out / "errors.csv")
    assert [(r["case"], r["axis"]) for r in rows] == [
        (case, axis) for case in ("no_dither", "dither") for axis in AXES
    ]
    assert list(rows[0]) == [
        *("robot", "trajectory", "stiffness_translation", "stiffness_rotation"),
        *("stiffness_nullspace", "case", "axis", "unit", "window_sum", "window_sum_std"),
        *("mean", "rms", "max", "corner", "settling", "iterations"),
    ]
    assert [r["window_sum"] for r in result["rows"]] == [float(r["window_sum"]) for r in rows]
    assert result["failed"] is None
    plain, shaken = csv_rows(out / "runs.csv")
    assert float(plain["dither_energy_j"]) == 0 < float(shaken["dither_energy_j"])
    assert float(shaken["vibration_m"]) > float(plain["vibration_m"])
    assert {r["case"] for r in csv_rows(out / "trace.csv")} == {"no_dither", "dither"}
    assert [r["goal"] for r in csv_rows(out / "points.csv")] == ["1", "2"] * 2


@pytest.mark.slow
def test_options_reach_the_experiment(cli, work, path, table, inputs):
    """Each changes the dithered run, and what it should leave alone it does."""
    (inputs / "late.toml").write_text("[sensing]\nmeasurement_delay = 0.005\n")
    path.write_text("x,y,z\n0.02,0,0\n")
    own = ["--trajectory", path, *QUICK, "--no-scatter", "--dither", table]
    variants = {
        "plain": [],
        "start": ["--start", 0, -0.6, 0, -2.2, 0, 1.6, 0.8],
        "tool": ["--tool", 0, 0, 0.1034],
        "payload": ["--payload", 0.5, 0, 0, 0.05],
        "sensing": ["--sensing", inputs / "late.toml"],
    }
    errors = {}
    for name, options in variants.items():
        assert cli("gte", "panda", *own, *options, "--out", name).code == 0
        rows = csv_rows(work / name / "errors.csv")
        errors[name] = tuple(
            tuple(r["rms"] for r in rows if r["case"] == c) for c in ("no_dither", "dither")
        )
    assert len({e[1] for e in errors.values()}) == len(variants)
    found = json.loads((work / "payload" / "provenance.json").read_text())
    assert found["arguments"]["payload"] == [0.5, 0.0, 0.0, 0.05]
    assert set(found["inputs"]) == {"robot", "robot_table", "friction", "dither", "trajectory"}


@pytest.mark.slow
def test_compensation_of_a_file(cli, work, path):
    """The compensation of compensation.csv and of final.yaml gives equal results."""
    path.write_text("x,y,z\n0.02,0,0\n")
    found = GeneratedTrajectoryExperiment("panda").compensation("lugre_observer", 0.7)
    dither = [AmplitudeRow(7, 15.0, 0.8009660772725983)]
    write_treatment(work, dither, found, load_arm("panda").joint_names)
    rows = {}
    for name in ("compensation.csv", "final.yaml"):
        own = ["--trajectory", path, *QUICK, "--compensation", name, "--dither", "final.yaml"]
        assert cli("gte", "panda", *own, "--out", f"of-{name}").code == 0
        rows[name] = [tuple(r.values()) for r in csv_rows(work / f"of-{name}" / "runs.csv")]
        says = json.loads((work / f"of-{name}" / "provenance.json").read_text())
        assert set(says["inputs"]) >= {"compensation", "dither"}
    assert rows["compensation.csv"] == rows["final.yaml"]


@pytest.mark.slow
def test_arm_of_two_joints(cli, work, two, path):
    """The arm is always singular: the command says so, and no number is NaN."""
    ran = cli("gte", two, "--trajectory", path, *QUICK, "--out", "a")
    assert ran.code == 0
    assert "1 iteration came near a singular pose" in ran.out
    assert all(math.isfinite(float(r["rms"])) for r in csv_rows(work / "a" / "errors.csv"))


def test_names_are_those_of_the_packages():
    assert gte.TRAJECTORIES == gte_protocol.TRAJECTORIES
