"""``stiction excite``: files, what they hold, same bytes twice, exit codes."""

import json

import numpy as np
import pytest

from stiction_envs.identification import settings
from stiction_envs.method_settings import override
from stiction_envs.robots import load_arm

FILES = {"trajectory.csv", "excitation.json", "excitation.png", "provenance.json"}
QUICK = ["--harmonics", 3, "--base-frequency", 0.2]


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Few iterations: what is tested here is what becomes of the motion."""
    few = {"excitation": {"iterations": 6, "randoms": 3, "starts": 1}}
    quick = override(settings.identification_settings(), few)
    monkeypatch.setattr(settings, "identification_settings", lambda: quick)


def test_files_and_what_they_hold(cli, two, work):
    ran = cli("excite", two, "--out", "a", "--json", "--sweeps", "--rate", 100, *QUICK)
    assert ran.code == 0, ran.err
    assert {p.name for p in (work / "a").iterdir()} == FILES
    said = json.loads(ran.out)
    assert said["condition"] < said["random_condition"]["median"]
    assert (
        json.loads((work / "a" / "excitation.json").read_text())["condition"] == (said["condition"])
    )
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


def test_the_same_run_gives_the_same_bytes_another_seed_does_not(cli, two, work):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert cli("excite", two, "--out", name, "--seed", seed, "--rate", 50, *QUICK).code == 0
    a, b, c = ((work / name / "trajectory.csv").read_bytes() for name in "abc")
    assert a == b != c
    assert (work / "a" / "excitation.png").read_bytes() == (
        work / "b" / "excitation.png"
    ).read_bytes()


def test_never_over_another_runs_files(cli, two, work):
    assert cli("excite", two, "--out", "a", "--rate", 50, *QUICK).code == 0
    before = (work / "a" / "trajectory.csv").read_bytes()
    other = ["excite", two, "--out", "a", "--seed", 3, "--rate", 50, *QUICK]
    assert cli(*other).code == 2
    assert (work / "a" / "trajectory.csv").read_bytes() == before
    assert cli(*other, "--force").code == 0
    assert (work / "a" / "trajectory.csv").read_bytes() != before


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["ur5"], "iiwa14, iiwa7, panda"),
        (["panda", "--harmonics", 1], "whole numbers from 2"),
        (["panda", "--periods", 0], "whole numbers from 1"),
        (["panda", "--base-frequency", 0], "above 0"),
        (["panda", "--rate", "nan"], "above 0"),
        (["panda", "--clearance", -1], "from 0"),
        (["panda", "--payload", -1, 0, 0, 0], "negative"),
    ],
)
def test_bad_input(cli, work, options, text):
    ran = cli("excite", *options)
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert text in ran.err
    assert list(work.iterdir()) == []


def test_no_motion_fits(cli, work, two):
    ran = cli("excite", two, "--clearance", 30, *QUICK)
    assert ran.code == 1
    assert "clearance" in ran.err
    assert list(work.iterdir()) == []
