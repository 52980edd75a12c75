"""A waveform from outside the package works wherever a built-in one does, or is refused."""

import json

import numpy as np
import pytest

from stiction_envs.dither.waveforms import WAVEFORMS, Waveform, register_waveform
from tests.refusal import refusal
from tests.test_contributing import block


@pytest.fixture(scope="module", autouse=True)
def sawtooth() -> None:
    exec(block("A waveform", "python"), {"__name__": "contributed"})


def test_the_command_line_takes_it_from_a_table(cli, refused, two, dither):
    dither.write_text("joint,frequency_hz,amplitude_nm,waveform,offset_nm\n2,15,0.5,sawtooth,0\n")
    options = ["--joint", 2, "--load", "load", "--direction", "+", "--iterations", 1, "--json"]
    rows = json.loads(cli("sje", two, *options, "--dither", dither).out)["rows"]
    assert [row["amplitude_nm"] for row in rows] == [0.0, 0.5]
    assert abs(rows[1]["tau_nm"]) < abs(rows[0]["tau_nm"])
    dither.write_text(dither.read_text().replace("sawtooth", "sawtoothed"))
    says = refused("sje", two, "--dither", dither, "--out", "b")
    assert f"expected one of {', '.join(WAVEFORMS)}" in says
    assert list(WAVEFORMS)[-1] == "sawtooth"


class Bad(Waveform):
    """A shape that is refused."""

    def __init__(self, name: str, shape) -> None:
        self.name, self._shape = name, shape  # type: ignore[misc]

    def value(self, angle, drawn):
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
    refusal(lambda: register_waveform(Bad(name, shape)), message)
    assert list(WAVEFORMS) == before
