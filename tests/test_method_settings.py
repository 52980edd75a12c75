"""Constants of methods: read from one TOML per room, changed by name, and known by their hash."""

import ast
import dataclasses
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stiction_envs.identification.settings import excitation_settings
from stiction_envs.method_settings import Count, Positive, Share, flat, load_settings, override
from tests.command_line import ROOT
from tests.refusal import refusal
from tuning.policies.settings import policy_settings
from tuning.settings import tuning_settings

ROOMS = {
    "identification": excitation_settings,
    "tuning": tuning_settings,
    "tuning/policies": policy_settings,
}


EXPERIMENTS = ROOT / "stiction_envs" / "experiments"


def folder(room: str) -> Path:
    return ROOT / room if room.startswith("tuning") else ROOT / "stiction_envs" / room


TOMLS = [
    *(folder(room) / "settings.toml" for room in ROOMS),
    *(EXPERIMENTS / kind / f"{kind}.toml" for kind in ("sje", "gte")),
]


@dataclass(frozen=True, kw_only=True)
class Inner:
    """Nested."""

    times: tuple[float, ...]
    share: Share


@dataclass(frozen=True, kw_only=True)
class Outer:
    """Settings of a room."""

    rows: Count
    speed: Positive
    inner: Inner


GOOD = """
rows = { value = 20, unit = "1", assumed = true }
speed = { value = 2, unit = "rad/s", source = "a book" }
[inner]
times = { value = [-1, 0.5], unit = "s", assumed = true, source = "assumed: room" }
share = { value = 0.5, unit = "1", assumed = true }
"""


def load(tmp_path: Path, text: str, table: str = "") -> Outer:
    path = tmp_path / "settings.toml"
    path.write_text(text, "utf-8")
    load_settings.cache_clear()
    return load_settings(Outer, path, table)


def test_what_stands_in_the_file_is_read(tmp_path):
    s = load(tmp_path, GOOD)
    assert s == Outer(rows=20, speed=2.0, inner=Inner(times=(-1.0, 0.5), share=0.5))
    assert [type(s.speed), type(s.rows)] == [float, int]
    text = "".join(f"{x}\n" for x in GOOD.splitlines()).replace("[inner]", "[a.b.inner]")
    assert load(tmp_path, "[a.b]\n" + text, "a.b") == s


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("rows =", "row =", "settings.toml: row: no such setting: expected one of rows, "),
        ('speed = { value = 2, unit = "rad/s", source = "a book" }\n', "", "speed is missing"),
        ("value = 20", "value = 20.5", "rows is 20.5: expected `int`, got `float`"),
        ("[-1, 0.5]", "0.5", "inner.times is 0.5: expected `array`, got `float`"),
        ("value = 20", "value = 0", "rows is 0: expected `int` >= 1"),
        ("value = 2,", "value = nan,", "speed is nan: expected finite"),
        ("value = 2,", f"value = {9 * '9' * 50},", "speed: a number of hundreds of digits"),
        ("[inner]", "[inner", "not a TOML file"),
    ],
)
def test_a_bad_file_is_one_clear_line(tmp_path, old, new, said):
    assert old in GOOD
    assert said in refusal(lambda: load(tmp_path, GOOD.replace(old, new, 1)))


def test_no_table_and_no_file(tmp_path):
    refusal(lambda: load(tmp_path, GOOD, "elsewhere"), "elsewhere: expected a table")
    refusal(lambda: load_settings(Outer, tmp_path / "none.toml"), "no such file")


def test_users_change_some_by_name(tmp_path):
    s = load(tmp_path, GOOD)
    assert override(s, None) is s
    by_name = override(s, {"inner.share": 1, "rows": 3})
    assert (by_name.rows, by_name.inner) == (3, dataclasses.replace(s.inner, share=1.0))
    assert by_name == override(s, {"inner": {"share": 1.0}, "rows": 3})
    own = tmp_path / "own.toml"
    own.write_text("rows = 3\n[inner]\nshare = { value = 1.0, unit = '1' }\n", "utf-8")
    assert override(s, own) == override(s, str(own)) == by_name
    both = override(s, {"inner": {"share": 0.25}, "inner.times": (2,)})
    assert both.inner == Inner(times=(2.0,), share=0.25)


def test_numpys_numbers_are_numbers(tmp_path):
    s = load(tmp_path, GOOD)
    given = {"inner.share": np.float32(0.25), "rows": np.int64(3), "inner.times": np.array([2.0])}
    found = override(s, given)
    assert found == override(s, {"inner.share": 0.25, "rows": 3, "inner.times": (2.0,)})
    assert type(found.rows) is int


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"row": 3}, "settings: row: no such setting: expected one of rows, speed, inner"),
        ({"inner": 3}, "inner is 3: expected a table of times, share"),
        ({"rows": 2.5}, "rows is 2.5: expected `int`, got `float`"),
        ({"rows.x": 2}, "rows.x: no such setting: rows is 20, no table"),
        ("none.toml", "none.toml: no such file"),
    ],
)
def test_a_bad_change_is_one_clear_line(tmp_path, changes, said):
    settings = load(tmp_path, GOOD)
    assert said in refusal(lambda: override(settings, changes))


@pytest.mark.parametrize("room", ROOMS)
def test_every_table_of_a_room_is_read(room):
    """Code reads every number of a room's TOML as a default."""
    path = folder(room) / "settings.toml"
    values = dict(flat(ROOMS[room]()))

    for name, entry in entries(tomllib.loads(path.read_text("utf-8"))):
        for key, expected in flat({name: entry["value"]}):
            found = values.pop(key)
            assert (list(found) if isinstance(found, tuple) else found) == expected
    assert not values


def entries(node: dict[str, Any], above: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the dotted name and the entry of every constant in a TOML."""
    for name, entry in node.items():
        if "value" in entry:
            yield f"{above}{name}", entry
        else:
            yield from entries(entry, f"{above}{name}.")


@pytest.mark.parametrize("path", TOMLS, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_every_constant_has_a_unit_and_a_source_or_is_assumed(path):
    for name, entry in entries(tomllib.loads(path.read_text("utf-8"))):
        assert {"value", "unit"} <= set(entry) <= {"value", "unit", "source", "assumed"}, name
        assert isinstance(entry["unit"], str), name
        assert entry.get("assumed") is True or isinstance(entry["source"], str), name


@cache
def attributes_read() -> set[str]:
    """Names of all attributes in the project's code but for settings."""
    code = "\n".join(
        p.read_text("utf-8")
        for top in ("stiction_envs", "tuning", "benchmarks")
        for p in (ROOT / top).rglob("*.py")
        if p.name != "settings.py"
    )
    return {n.attr for n in ast.walk(ast.parse(code)) if isinstance(n, ast.Attribute)}


@pytest.mark.parametrize("room", ROOMS)
def test_every_setting_is_used_and_documented(room):
    """Every field has a docstring under it, and some code of the project reads it."""
    tree = ast.parse((folder(room) / "settings.py").read_text("utf-8"))
    read = attributes_read()
    for node in (n for n in tree.body if isinstance(n, ast.ClassDef)):
        for i, field in enumerate(node.body):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                below = node.body[i + 1]
                assert isinstance(below, ast.Expr), f"{node.name}.{field.target.id}"
                assert isinstance(below.value, ast.Constant)
                assert field.target.id in read, f"{node.name}.{field.target.id} is read by nobody"
