"""``stiction identify``: files, what they hold, same bytes twice, exit codes."""

import dataclasses
import json

import numpy as np
import pytest

from stiction_envs.hidden import excited_logs as excited
from stiction_envs.identification.identify import MODELS
from stiction_envs.robots import load_arm
from stiction_envs.robots.regressor import inertial_parameters
from tests.gap.small_logs import RATE, motion, write_csv

FILES = {
    *("identification.json", "report.md", "report.html", "model.xml", "residual.png"),
    "provenance.json",
}


@pytest.fixture
def log(two, inputs):
    """A log of an arm whose links are not the nominal ones."""
    arm = load_arm(two)
    t, q, dq, ddq = motion(2, seconds=20.0)
    made = excited.log(
        excited.perturbed(arm, 0.3, 1), (q + arm.rest, dq, ddq), RATE, noise=0.01, seed=1
    )
    path = inputs / "made.csv"
    write_csv(path, dataclasses.replace(made, t=t))
    return path


def test_files_and_what_they_hold(cli, two, log, work):
    ran = cli("identify", log, "--robot", two, "--torque", "link", "--out", "a", "--json")
    assert ran.code == 0, ran.err
    assert {p.name for p in (work / "a").iterdir()} == FILES
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


def test_the_same_run_gives_the_same_bytes(cli, two, log, work):
    for name in "ab":
        assert cli("identify", log, "--robot", two, "--out", name).code == 0
    for file in FILES - {"provenance.json"}:
        assert (work / "a" / file).read_bytes() == (work / "b" / file).read_bytes()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["missing.csv", "--robot", "panda"], "missing.csv: no such file"),
        (["LOG", "--robot", "panda"], "made.csv"),
        (["LOG", "--robot", "ur5"], "iiwa14, iiwa7, panda"),
        (["LOG", "--robot", "TWO", "--cutoff", 0], "above 0"),
        (["--robot", "panda"], "LOG"),
    ],
)
def test_bad_input(cli, two, log, work, options, text):
    given = {"LOG": log, "TWO": two}
    ran = cli("identify", *(given.get(x, x) for x in options))
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert text in ran.err
    assert list(work.iterdir()) == []
