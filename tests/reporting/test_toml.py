"""A TOML file of any layout is read back as it was written."""

import json
import tomllib
from pathlib import Path

import numpy as np

import stiction_envs
from stiction_envs.reporting.toml import toml_text

SHIPPED = sorted(Path(stiction_envs.__file__).parent.rglob("*.toml"))


def test_shipped_tables_come_back():
    for path in SHIPPED:
        table = tomllib.loads(path.read_text("utf-8"))
        again = tomllib.loads(toml_text(table, head="two\nlines"))
        # as text, in which one nan is another
        assert json.dumps(again, sort_keys=True) == json.dumps(table, sort_keys=True), path


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
