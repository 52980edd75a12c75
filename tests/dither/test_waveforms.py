"""A waveform from outside the package works wherever a built-in one does, or is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.cli import main
from stiction_envs.dither.dither import Dither
from stiction_envs.dither.waveforms import WAVEFORMS, Waveform, register_waveform
from stiction_envs.envs.agents import ConstantTable
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job
from stiction_envs.measured import AmplitudeRow, read_amplitudes, write_final
from tests.envs.helpers import KINDS
from tests.robots.arms import chain
from tuning.search.bounds import bounds_of


class Sawtooth(Waveform):
    """0, +1, −1, 0: rises by 2 per period and falls at once."""

    name = "sawtooth"

    def value(self, angle, drawn, bandwidth):
        """w = 2(x − round x), x = θ/2π."""
        x = angle / (2 * np.pi)
        return 2 * (x - np.rint(x))


@pytest.fixture(scope="module", autouse=True)
def sawtooth() -> None:
    register_waveform(Sawtooth())


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "two.xml"
    path.write_text(chain(2, extra='<geom pos="0.15 0 0.1" size="0.05" mass="1"/>'))
    return path


def test_dither_has_its_torque():
    """A·w(2πft), gated and shifted as any other; beside sines, whose bits stay."""
    d = Dither(amplitude=[[1.5, 1.0]], frequency=10.0, waveform=["sawtooth", "sine"], offset=0.2)
    for t, w in ((0.0, 0.0), (0.02, 0.4), (0.04, 0.8), (0.06, -0.8), (0.12, 0.4)):
        assert d.torque(t)[0, 0] == pytest.approx(0.2 + 1.5 * w)
    alone = Dither(amplitude=[[1.0]], frequency=10.0, offset=0.2)
    assert d.torque(0.013)[0, 1] == alone.torque(0.013)[0, 0]
    assert repr(d) == "Dither(N=1, n=2, sine+sawtooth)"


def test_a_joint_breaks_away_under_it(arm):
    """One job of the experiment: less torque than without, and not what a sine makes of it."""
    bench = SingleJointExperiment(arm, scatter=False)
    where = Configuration(2, "load", "+")
    jobs = [Job(where), *(Job(where, 15.0, 0.5, waveform=w) for w in ("sawtooth", "sine"))]
    found = {m.job: m.mean for m in bench.run(jobs, iterations=1)}
    base, saw, sine = (found[job] for job in jobs)
    assert 0 < saw < base
    assert saw != sine


@pytest.mark.parametrize("kind", ["sje", pytest.param("gte", marks=pytest.mark.slow)])
def test_an_environment_dithers_with_it(kind):
    """By name, alone and in a batch of the same bits; an agent's table may name it too."""
    single, batch, arguments, options, *_ = KINDS[kind]
    arguments = {**arguments, "fixed_options": options}
    rows = [AmplitudeRow(6, 20.0, 0.5, waveform="sawtooth")]
    seen = {}
    for waveform in ("sawtooth", "sine"):
        env = single(waveform=waveform, **arguments)
        many = batch(2, waveform=waveform, **arguments)
        env.reset(seed=3)
        many.reset(seed=[3, 4])
        action = ConstantTable(env, [replace(rows[0], waveform=waveform)]).predict(
            env.core.observe(np.arange(1))[0]
        )[0]
        for _ in range(3):
            seen[waveform] = env.step(action)[0]
            together = many.step(np.stack([action, action]))[0]
        assert repr(env.core.rig.dither).endswith(f"{waveform})")
        np.testing.assert_array_equal(seen[waveform], together[0])
    assert not np.array_equal(seen["sawtooth"], seen["sine"])
    with pytest.raises(StictionError, match=r"sawtooth .*: expected sine without offset"):
        ConstantTable(env, rows)
    with pytest.raises(StictionError, match="unknown waveform 'saw': expected one of sine, sq"):
        single(waveform="saw", **arguments)


def test_a_table_and_the_tuner_name_it(tmp_path):
    """It is written and read back, and is one of those that are searched."""
    rows = [AmplitudeRow(2, 15.0, 0.5, waveform="sawtooth")]
    write_final(tmp_path, rows, ["a", "b"])
    assert read_amplitudes(tmp_path / "final.csv", n_joints=2) == rows
    space = bounds_of(SingleJointExperiment("panda")).space(1, ("waveform",))
    assert "sawtooth" in space["waveform"].choices


def test_the_command_line_takes_it_from_a_table(arm, tmp_path, capsys):
    table = tmp_path / "dither.csv"
    table.write_text("joint,frequency_hz,amplitude_nm,waveform,offset_nm\n2,15,0.5,sawtooth,0\n")
    words = ["--joint", "2", "--load", "load", "--direction", "+", "--iterations", "1", "--json"]
    assert (
        main(["sje", str(arm), *words, "--dither", str(table), "--out", str(tmp_path / "a")]) == 0
    )
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [row["amplitude_nm"] for row in rows] == [0.0, 0.5]
    assert abs(rows[1]["tau_nm"]) < abs(rows[0]["tau_nm"])
    table.write_text(table.read_text().replace("sawtooth", "sawtoothed"))
    assert main(["sje", str(arm), "--dither", str(table), "--out", str(tmp_path / "b")]) == 2
    assert f"expected one of {', '.join(WAVEFORMS)}" in capsys.readouterr().err
    assert list(WAVEFORMS)[-1] == "sawtooth"


class Bad(Waveform):
    """A shape that is refused."""

    def __init__(self, name: str, shape) -> None:
        self.name, self._shape = name, shape  # type: ignore[misc]

    def value(self, angle, drawn, bandwidth):
        """Whatever it was given."""
        return self._shape(angle)


@pytest.mark.parametrize(
    ("name", "shape", "message"),
    [
        ("sine", np.sin, "waveform name 'sine': expected one not in sine, square"),
        ("two words", np.sin, "waveform name 'two words': expected letters, digits and _"),
        ("loud", lambda x: 2 * np.sin(x), "'loud': peak 2, mean .*expected a peak of at most 1"),
        ("push", lambda x: 0.5 + 0 * x, "'push': peak 0.5, mean 0.5: expected"),
        ("pole", lambda x: np.log(x - 1), "'pole': expected a finite float64"),
        ("steps", lambda x: np.sign(np.sin(x)).astype(int), "'steps': expected a finite float64"),
        ("one", lambda x: 0.0 * x[0], "'one': expected a finite float64"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_bad_waveforms_are_refused(name, shape, message):
    before = list(WAVEFORMS)
    with pytest.raises(StictionError, match=message) as error:
        register_waveform(Bad(name, shape))
    assert "\n" not in str(error.value)
    assert list(WAVEFORMS) == before
