"""``stiction calibrate`` and ``stiction tune`` on an arm of two joints."""

import json
import tomllib

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.experiments.settings import experiment_settings
from stiction_envs.friction.parameters import load_friction
from stiction_envs.measured import read_amplitudes
from stiction_envs.method_settings import override
from tests.cli.test_bad_input import BASE_TWO
from tuning.commands import tune as tune_command
from tuning.protocol import tune as tuner
from tuning.search import bounds, options
from tuning.study import samplers

TUNE = ["--iterations", 1, "--no-scatter", "--frequencies", 15, "--scales", 1.0]


def finished(folder) -> tuner.Tuning:
    """What a run of the protocol gives, without having run."""
    summary = {"robot": "two", "final": [], "mean_reduction_percent": None}
    return tuner.Tuning(summary=summary, final=(), folder=folder.path, provenance={})


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
    assert "or force" in again.err


@pytest.fixture
def mine(inputs):
    """A user's friction TOML: no [meta], some quantities assumed, some left out; a diagnosis."""
    values = {"stiction": 0.8, "coulomb_ratio": 0.8, "stribeck_velocity": 0.05}
    values |= {"viscous": 0.4, "bristle_stiffness": 600.0, "rotor_inertia": 0.2}
    text = "".join(f"[{k}]\nvalue = {v}\nassumed = true\n" for k, v in values.items())
    text = text.replace("0.4\nassumed = true", '0.4\nsource = "my own log"')
    path = inputs / "mine.toml"
    path.write_text(text + '[arm]\nrobot = "two"\n[[cause]]\nname = "x"\n')
    return path


def check_sources(path) -> None:
    """What was calibrated says so; all else is as the user's file has it."""
    found = tomllib.loads(path.read_text("utf-8"))
    assert found["meta"] == {}
    assert found["stiction"]["source"].startswith("calibrated: ")
    assert found["viscous"]["source"] == "my own log"
    assert found["rotor_inertia"]["source"] == "assumed"
    assert found["ripple_amplitude"]["source"] == "assumed: not in mine.toml"
    assert load_friction(path, 2).n == 2


def test_calibrate_begins_with_a_users_friction(cli, work, two, base, mine):
    ran = cli("calibrate", two, base, "--friction", mine, "--out", "friction.toml")
    assert ran.code == 0, ran.err
    check_sources(work / "friction.toml")


def test_tune_writes_the_sources_of_the_friction_it_was_given(work, two, base, mine, monkeypatch):
    class Calibrated(Exception):
        pass

    def stop(*arguments, **options):
        raise Calibrated

    monkeypatch.setattr(tuner, "ThesisTuner", stop)
    with pytest.raises(Calibrated):
        tuner.tune(two, table=base, friction=mine, out=work / "t", scatter=False)
    check_sources(work / "t" / "friction.toml")


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
    assert read_amplitudes(work / "t" / "final.yaml", n_joints=2) == final
    found = json.loads((work / "t" / "provenance.json").read_text())
    assert found["finished"]
    assert {"final.csv", "final.yaml"} <= set(found["files"])
    assert cli("tune", two, *TUNE, "--out", "t").code == 0
    other = cli("tune", two, *TUNE, "--seed", 1, "--out", "t")
    assert other.code == 2
    assert "or force" in other.err


def test_interrupted_tune_can_go_on(cli, work, two, monkeypatch):
    """The folder of the same run is gone on with, whatever the number of threads."""

    def some_work(experiment, folder, book, **options):
        (folder.path / "half.csv").write_text("half")
        raise KeyboardInterrupt

    calls = []

    def the_rest(experiment, folder, book, **options):
        calls.append((experiment, options))
        return finished(folder)

    monkeypatch.setattr(tuner, "run_protocol", some_work)
    ran = cli("tune", two, *TUNE, "--out", "t")
    assert ran.code == 1
    assert "run the same command again" in ran.err
    assert len(ran.lines) == 1
    monkeypatch.setattr(tuner, "run_protocol", the_rest)
    assert cli("tune", two, *TUNE, "--out", "t", "--threads", 1).code == 0
    assert (work / "t" / "half.csv").read_text() == "half"
    ((experiment, options),) = calls
    assert options["frequencies"] == (15.0,)
    assert experiment.scatter is False
    assert experiment.threads == 1


def test_tune_by_force_starts_anew(cli, work, two, monkeypatch):
    def killed(experiment, folder, book, **options):
        (folder.path / "plots").mkdir()
        (folder.path / "plots" / "a.png").write_text("old")
        raise RuntimeError("power went out")

    monkeypatch.setattr(tuner, "run_protocol", killed)
    ran = cli("tune", two, *TUNE, "--out", "t")
    assert ran.code == 1
    assert "RuntimeError: power went out" in ran.err
    monkeypatch.setattr(tuner, "run_protocol", lambda e, folder, b, **_: finished(folder))
    assert cli("tune", two, *TUNE, "--seed", 2, "--out", "t", "--force").code == 0
    assert {p.name for p in (work / "t").iterdir()} == {"provenance.json"}


def test_tune_that_refuses_its_input_leaves_no_folder(cli, work, two):
    ran = cli("tune", two, *TUNE[:-1], 7, "--out", "t")
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert "scale 7.0: expected above 0 up to 5" in ran.lines[0]
    assert list(work.iterdir()) == []


@pytest.mark.parametrize(
    ("storage", "message"),
    [
        ("postgresql+psycopg://tuner:s3cret@127.0.0.1:1/x", "tuner:***@127.0.0.1:1/x: cannot be"),
        ("postgresql://tuner:s3@cret@host/x", "more than one @ in the URL"),
        ("sqlite:////nowhere/x.db", "unable to open database file"),
        ("study.txt", "expected a URL, or a file that ends in .journal"),
    ],
)
def test_tune_with_a_storage_that_cannot_be_opened(cli, work, two, storage, message):
    ran = cli("tune", two, *TUNE, "--out", "t", "--storage", storage)
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert message in ran.lines[0]
    assert "cret" not in ran.err
    assert list(work.iterdir()) == []


def test_tune_that_cannot_go_on_fails_while_working(cli, work, two, monkeypatch):
    """Bad input that shows only once work has begun is exit code 1, and what was done stays."""

    def refuse(experiment, folder, book, **options):
        (folder.path / "base.csv").write_text("done")
        raise StictionError("study 'two' is\nof another run")

    monkeypatch.setattr(tuner, "run_protocol", refuse)
    ran = cli("tune", two, *TUNE, "--out", "t")
    assert ran.code == 1
    assert ran.lines == ["error: study 'two' is of another run"]
    assert (work / "t" / "base.csv").read_text() == "done"


def test_tune_warns_of_aliases_once(cli, monkeypatch):
    monkeypatch.setattr(tuner, "run_protocol", lambda e, folder, b, **_: finished(folder))
    ran = cli("tune", "iiwa7", "--frequencies", 150, "--out", "t")
    assert ran.code == 0
    (line,) = ran.lines
    assert line.startswith("warning: ")
    assert "aliases to 50 Hz" in line


def test_names_written_out_for_help_are_the_packages_own():
    assert tune_command.SAMPLERS == samplers.SAMPLERS
    assert tune_command.OBJECTIVES == options.OBJECTIVES
    assert tune_command.GATES == options.GATES
    assert tune_command.COMPENSATIONS == options.COMPENSATIONS
    assert tune_command.PRICES == options.PRICES
    assert set(tune_command.FREE) == set(bounds.OPTIONS)
