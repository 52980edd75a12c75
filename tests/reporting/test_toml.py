"""What is written as TOML is read back as it was, whatever its layout."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

import stiction_envs
from stiction_envs.friction.parameters import QUANTITIES, dump_friction, load_friction
from stiction_envs.gap.model_file import Nominal, Part, dump
from stiction_envs.reporting.toml import toml_text

SHIPPED = sorted(Path(stiction_envs.__file__).parent.rglob("*.toml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_shipped_tables_come_back(path):
    table = tomllib.loads(path.read_text("utf-8"))
    again = tomllib.loads(toml_text(table, head="two\nlines"))
    # as text, in which one nan is another
    assert json.dumps(again, sort_keys=True) == json.dumps(table, sort_keys=True)


def test_floats_come_back_to_the_last_bit():
    rng = np.random.default_rng(0)
    values = rng.integers(0, 2**62, 500).view(np.float64)
    values = np.concatenate([values, -values, [np.inf, -np.inf, 5e-324, 0.1, -0.0]])
    back = tomllib.loads(toml_text({"a": {"x": values.tolist()}}))["a"]["x"]
    assert np.array(back).tobytes() == values.tobytes()


def test_a_single_value_stays_out_of_the_tables():
    table = {"a": {"x": 1.0}, "cause": [{"v": [1.0, 2.0]}, {"v": []}], "z": 3.0, "none": []}
    assert tomllib.loads(toml_text(table)) == table


def test_texts_that_look_like_arrays_and_quotes():
    table = {"a": {"text": ["= [\n 1\n]", 'say "no" \\ ü'], "nested": [[1.0, 2.0], [3.0, 4.0]]}}
    text = toml_text(table)
    assert tomllib.loads(text) == table
    assert "nested = [[1.0, 2.0], [3.0, 4.0]]\n" in text


def test_comments_stand_above_their_tables():
    text = toml_text({"a": {"x": 1}, "b": {"y": 2}}, head="top", comments={"b": "of b"})
    assert text == "# top\n\n[a]\nx = 1\n\n# of b\n[b]\ny = 2\n"


def test_model_file_is_the_one_that_was_written_by_hand():
    """The text that stiction 0.1 wrote line by line, for one arm with two causes."""
    friction = load_friction("panda")
    parts = (
        Part(cause="payload", joint=0, shape=(), coefficients=(1.5, *([1 / 3] * 9))),
        Part(cause="backlash", joint=3, shape=(0.1,), coefficients=(1e-300,), level=2),
    )
    nominal = Nominal(
        friction=friction,
        parts=parts,
        robot='pa"nda',
        payload=(1.0, 0.1, 0.2, 0.3),
        distance=(0.1,),
    )
    sources = {k: 'assumed: "q" \\ x' for k in QUANTITIES}
    text = dump_friction(friction, sources=sources, meta={"title": "a"}, provenance={"x": "y"})
    found = tomllib.loads(text + dump(nominal))
    assert found["meta"] == {"title": "a"}
    assert found["provenance"] == {"x": "y"}
    for name, quantity in QUANTITIES.items():
        value = getattr(friction, name)
        both = value.ndim == 2 and np.array_equal(value[:, 0], value[:, 1])
        assert found[name] == {
            "value": (value[:, 0] if both else value).tolist(),
            "unit": quantity.unit,
            "source": sources[name],
            "assumed": True,
        }
    assert found["arm"] == {
        "robot": 'pa"nda',
        "payload": [1.0, 0.1, 0.2, 0.3],
        "tilt": [0.0, 0.0],
        "distance": [0.1],
        "friction": {k: getattr(friction, k).tolist() for k in QUANTITIES},
    }
    payload, backlash = found["cause"]
    assert tuple(payload.items()) == (
        ("name", "payload"),
        ("joint", 0),
        ("shape", []),
        ("coefficients", [1.5, *([1 / 3] * 9)]),
        ("level", 1),
        ("carried", False),
    )
    assert backlash["coefficients"] == [1e-300]
    assert (backlash["shape"], backlash["level"]) == ([0.1], 2)
    assert set(found) == {"meta", "provenance", "arm", "cause", *QUANTITIES}
