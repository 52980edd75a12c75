"""Parameters from measurements: ``stiction excite``, ``identify`` and ``calibrate``."""

import dataclasses
import json
import tomllib

import numpy as np
import pytest

from benchmarks.accuracy import imperfect_arms as excited
from stiction_envs.experiments.sje import calibrate
from stiction_envs.friction.parameters import load_friction
from stiction_envs.identification.identify import MODELS
from stiction_envs.robots import load_arm
from stiction_envs.robots.regressor import inertial_parameters
from tests.cli.short_commands import BASE_TWO, FRICTION
from tests.gap.small_logs import RATE, motion, write_csv

# ---- excite --------------------------------------------------------------------------------------

QUICK = ["--harmonics", 3, "--base-frequency", 0.2]


@pytest.mark.usefixtures("short_motion")
def test_a_motion_and_what_its_files_hold(cli, two, work):
    ran = cli("excite", two, "--out", "a", "--json", "--sweeps", "--rate", 100, *QUICK)
    assert ran.code == 0, ran.err
    written = {"trajectory.csv", "excitation.json", "excitation.png", "provenance.json"}
    assert {p.name for p in (work / "a").iterdir()} == written
    said = json.loads(ran.out)
    assert said["condition"] < said["random_condition"]["median"]
    kept = json.loads((work / "a" / "excitation.json").read_text())
    assert kept["condition"] == said["condition"]
    text = (work / "a" / "trajectory.csv").read_text().splitlines()
    assert text[0] == "t,q1,q2,dq1,dq2"
    table = np.array([[float(v) for v in line.split(",")] for line in text[1:]])
    np.testing.assert_allclose(np.diff(table[:, 0]), 0.01, atol=1e-6)
    assert abs(table[-1, 0] - said["duration_s"]) < 0.011
    assert np.abs(table[[0, -1], 3:]).max() < 1e-6
    low, high = load_arm(two).limits.position.T
    assert (table[:, 1:3] >= low).all()
    assert (table[:, 1:3] <= high).all()
    np.testing.assert_allclose(np.gradient(table[:, 1], 0.01)[5:-5], table[5:-5, 3], atol=0.02)


@pytest.mark.usefixtures("short_motion")
def test_no_motion_fits(cli, work, two):
    ran = cli("excite", two, "--clearance", 30, *QUICK)
    assert ran.code == 1
    assert "clearance" in ran.err
    assert list(work.iterdir()) == []


# ---- identify ------------------------------------------------------------------------------------


def test_links_and_what_their_files_hold(cli, two, inputs, work):
    """The log is of an arm whose links are not the nominal ones."""
    t, q, dq, ddq = motion(2, seconds=20.0)
    arm = load_arm(two)
    moved = (q + arm.rest, dq, ddq)
    made = excited.log(excited.perturbed(arm, 0.3, 1), moved, RATE, noise=0.01, seed=1)
    log = inputs / "made.csv"
    write_csv(log, dataclasses.replace(made, t=t))
    ran = cli("identify", log, "--robot", two, "--torque", "link", "--out", "a", "--json")
    assert ran.code == 0, ran.err
    assert {p.name for p in (work / "a").iterdir()} == {
        *("identification.json", "report.md", "report.html", "model.xml", "residual.png"),
        "provenance.json",
    }
    said = json.loads(ran.out)
    held = said["held_out_rms_nm"]
    assert tuple(held) == MODELS
    assert np.all(np.array(held["consistent"]) < 0.3 * np.array(held["nominal + friction"]))
    assert np.allclose(said["friction"]["coulomb_nm"], excited.COULOMB[:2], rtol=0.1)
    assert all(link["least_eigenvalue"] > 0 for link in said["links"])
    arm = load_arm(work / "a" / "model.xml")
    found = inertial_parameters(arm.pinocchio())
    assert np.allclose(found, [list(x.values())[:10] for x in said["links"]], atol=1e-9)
    assert (work / "a" / "report.md").read_text().startswith("# two")
    assert json.loads((work / "a" / "identification.json").read_text())["links"] == said["links"]


# ---- calibrate -----------------------------------------------------------------------------------


@pytest.fixture
def base(inputs):
    path = inputs / "base.csv"
    path.write_text(BASE_TWO)
    return path


@pytest.fixture
def mine(inputs):
    """A user's friction TOML: no [meta], some quantities assumed, some left out; a diagnosis."""
    text = FRICTION.replace("0.4\nassumed = true", '0.4\nsource = "my own log"')
    path = inputs / "mine.toml"
    path.write_text(text + '[arm]\nrobot = "two"\n[[cause]]\nname = "x"\n')
    return path


def test_calibrate_begins_with_a_users_friction(cli, work, two, base, mine):
    ran = cli("calibrate", two, base, "--friction", mine, "--out", "new/friction.toml", "--json")
    assert ran.code == 0
    result = json.loads(ran.out)
    assert result["largest_relative_error"] < 0.002
    measured = [r["measured_nm"] for r in result["rows"]]
    np.testing.assert_allclose([r["simulated_nm"] for r in result["rows"]], measured, rtol=0.002)
    made = work / "new" / "friction.toml"
    found = tomllib.loads(made.read_text("utf-8"))
    assert found["provenance"]["table"] == "base.csv"
    assert len(found["provenance"]["arguments_sha256"]) == 64
    assert "mujoco" in found["provenance"]["versions"]
    # what was calibrated says so; all else is as the user's file has it
    assert found["meta"] == {}
    assert found["stiction"]["source"].startswith("calibrated: ")
    assert found["viscous"]["source"] == "my own log"
    assert found["rotor_inertia"]["source"] == "assumed"
    assert found["ripple_amplitude"]["source"] == "assumed: not in mine.toml"
    assert load_friction(made, 2).n == 2
    # other commands read the file
    assert cli("export", two, "--from", "new", "--out", "model").code == 0


def test_calibrate_that_fails_writes_nothing(cli, work, two, base, monkeypatch):
    monkeypatch.setattr(calibrate, "ROUNDS", 1)
    monkeypatch.setattr(calibrate, "CONVERGED", 0.0)
    ran = cli("calibrate", two, base, "--out", "friction.toml")
    assert ran.code == 1
    *progress, error = ran.lines
    assert progress in ([], ["calibrate: 100 % (1 of 1 rounds)"]), "printed where it takes long"
    assert "did not converge" in error
    assert list(work.iterdir()) == []
