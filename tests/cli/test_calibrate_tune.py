"""``stiction calibrate`` and ``stiction tune`` on an arm of two joints."""

import json
import tomllib

import numpy as np
import pytest

from stiction_envs.cli import tune as tune_command
from stiction_envs.errors import StictionError
from stiction_envs.experiments.settings import experiment_settings
from stiction_envs.friction.parameters import load_friction
from stiction_envs.measured import read_amplitudes
from stiction_envs.method_settings import override
from tests.cli.test_bad_input import BASE_TWO

TUNE = ["--iterations", 1, "--no-scatter", "--frequencies", 15, "--scales", 1.0]


@pytest.fixture
def base(inputs):
    path = inputs / "base.csv"
    path.write_text(BASE_TWO)
    return path


def test_calibrate(cli, work, two, base):
    ran = cli("calibrate", two, base, "--out", "new/friction.toml", "--json")
    assert ran.code == 0
    result = json.loads(ran.out)
    assert result["largest_relative_error"] < 0.002
    measured = [r["measured_nm"] for r in result["rows"]]
    np.testing.assert_allclose([r["simulated_nm"] for r in result["rows"]], measured, rtol=0.002)
    found = tomllib.loads((work / "new" / "friction.toml").read_text("utf-8"))["provenance"]
    assert found["table"] == "base.csv"
    assert len(found["arguments_sha256"]) == 64
    assert "mujoco" in found["versions"]
    # what it wrote is what other commands read
    assert load_friction(work / "new" / "friction.toml", 2).n == 2
    assert cli("export", two, "--from", "new", "--out", "model").code == 0
    again = cli("calibrate", two, base, "--out", "new/friction.toml")
    assert again.code == 2
    assert "--force" in again.err


def test_calibrate_that_fails_writes_nothing(cli, work, two, base, monkeypatch):
    from stiction_envs.experiments.sje import calibrate

    own = {"calibration.rounds": 1, "calibration.tolerance": 0.0}
    hopeless = override(experiment_settings(), own)
    monkeypatch.setattr(calibrate, "experiment_settings", lambda: hopeless)
    ran = cli("calibrate", two, base, "--out", "friction.toml")
    assert ran.code == 1
    assert len(ran.lines) == 1
    assert "did not converge" in ran.lines[0]
    assert list(work.iterdir()) == []


@pytest.mark.slow
def test_tune_goes_on_in_its_own_folder_only(cli, work, two):
    ran = cli("tune", two, *TUNE, "--out", "t", "--json")
    assert ran.code == 0
    result = json.loads(ran.out)
    final = read_amplitudes(work / "t" / "final.csv", n_joints=2)
    assert [r["amplitude_nm"] for r in result["final"]] == [r.amplitude_nm for r in final]
    found = json.loads((work / "t" / "provenance.json").read_text())
    assert found["finished"]
    assert "final.csv" in found["files"]
    assert cli("tune", two, *TUNE, "--out", "t").code == 0
    other = cli("tune", two, *TUNE, "--seed", 1, "--out", "t")
    assert other.code == 2
    assert "--force" in other.err


def test_interrupted_tune_can_go_on(cli, work, two, monkeypatch):
    import tuning.tune

    def some_work(arm, *, out, **options):
        (out / "labbook.jsonl").write_text("half\n")
        raise KeyboardInterrupt

    calls = []
    monkeypatch.setattr(tuning.tune, "tune", some_work)
    ran = cli("tune", two, *TUNE, "--out", "t")
    assert ran.code == 1
    assert "run the same command again" in ran.err
    assert len(ran.lines) == 1
    monkeypatch.setattr(tuning.tune, "tune", lambda arm, **o: calls.append(o) or {})
    assert cli("tune", two, *TUNE, "--out", "t", "--threads", 1).code == 0
    assert (work / "t" / "labbook.jsonl").read_text() == "half\n"
    assert calls[0]["frequencies"] == (15.0,)
    assert calls[0]["scatter"] is False


def test_tune_by_force_starts_anew(cli, work, two, monkeypatch):
    import tuning.tune

    def killed(arm, *, out, **options):
        (out / "plots").mkdir()
        (out / "plots" / "a.png").write_text("old")
        (out / "labbook.jsonl").write_text("old")
        raise RuntimeError("power went out")

    monkeypatch.setattr(tuning.tune, "tune", killed)
    ran = cli("tune", two, *TUNE, "--out", "t")
    assert ran.code == 1
    assert "RuntimeError: power went out" in ran.err
    monkeypatch.setattr(tuning.tune, "tune", lambda arm, **o: {})
    assert cli("tune", two, *TUNE, "--seed", 2, "--out", "t", "--force").code == 0
    assert [p.name for p in (work / "t").iterdir()] == ["provenance.json"]


def test_tune_that_refuses_its_input_leaves_no_folder(cli, work, two, monkeypatch):
    import tuning.tune

    def refuse(arm, **options):
        raise StictionError("scale 7: allowed is\nabove 0 up to 5")

    monkeypatch.setattr(tuning.tune, "tune", refuse)
    ran = cli("tune", two, *TUNE, "--out", "t")
    assert ran.code == 2
    assert ran.lines == ["error: scale 7: allowed is above 0 up to 5"]
    assert list(work.iterdir()) == []


def test_tune_warns_of_aliases_once(cli, monkeypatch):
    import tuning.tune

    text = "dither of 150 Hz at a 200 Hz controller aliases to 50 Hz"
    monkeypatch.setattr(tuning.tune, "tune", lambda arm, **o: {"warnings": [text]})
    ran = cli("tune", "iiwa7", "--frequencies", 150, "--out", "t")
    assert ran.code == 0
    assert ran.lines == [f"warning: {text}"]


def test_everything_named_available_is_an_option():
    assert set(tune_command.AVAILABLE) == {"protocol", "sampler", "objective"}
