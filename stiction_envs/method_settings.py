"""Constants of a method as data: frozen dataclasses whose defaults are in the room's TOML.

    @dataclass(frozen=True, kw_only=True)
    class ClockSettings:
        \"""When time stamps are a clock.\"""

        on_clock: Share
        \"""Root mean square distance from whole steps [steps]; 0.29 is chance.\"""

with, in ``settings.toml`` beside it,

    [clock]
    on_clock = { value = 0.15, unit = "steps", assumed = true }

Every entry has ``value`` and ``unit``, and a ``source`` or ``assumed = true``. msgspec checks types
and ranges. A room nests its dataclasses in one, loads it once and passes it down as an argument;
users change some numbers by name (`override`), and results carry the hash of all of them
(`fingerprint`).
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import sys
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import msgspec

from stiction_envs.errors import StictionError

T = TypeVar("T")
Changes = Mapping[str, Any] | str | os.PathLike[str]
"""Dotted names (or tables) with new values, or a TOML file of them."""
Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Share = Annotated[float, msgspec.Meta(gt=0, le=1)]
"""Above 0 and at most 1."""
Fraction = Annotated[float, msgspec.Meta(ge=0, le=1)]
"""From 0 to 1."""
Count = Annotated[int, msgspec.Meta(ge=1)]
Index = Annotated[int, msgspec.Meta(ge=0)]
ENTRY = {"value", "unit", "source", "assumed"}


@cache
def load_settings(cls: type[T], path: Path, table: str = "") -> T:
    """Return settings as a TOML file has them; the file is read once.

    Args:
        cls: keyword-only dataclass of numbers, flags, words, tuples of these, and more dataclasses.
        path: the file.
        table: dotted name of the table that holds ``cls``; its nested dataclasses are tables in it.

    Raises:
        StictionError: no such file or table, or a key that is unknown, missing or mistyped.
    """
    node: Any = _read(path)
    for part in filter(None, table.split(".")):
        node = node.get(part) if isinstance(node, dict) else None
    above = f"{table}." if table else ""
    if not isinstance(node, dict):
        raise StictionError(f"{path.name}: {above or 'the file'}: expected a table")
    settings = _converted(cls, _values(node, f"{path.name}: {above}"), f"{path.name}: {above}")
    return settings


def override(settings: T, changes: T | Changes | None) -> T:
    """Return settings with some values changed; the others stay.

    Args:
        settings: what to start from.
        changes: ``{"selection.chance": 0.02}``, ``{"selection": {"chance": 0.02}}``, or a TOML file
            of tables with plain values or ``{ value = … }``; settings of the same kind are taken as
            they are.

    Raises:
        StictionError: a file that cannot be read, a name that is none, or a value of another kind
            or out of range.
    """
    if changes is None:
        return settings
    if isinstance(changes, type(settings)):
        return changes
    if isinstance(changes, Mapping):
        return _changed(settings, _nested(changes, "settings"), "settings: ")
    if not isinstance(changes, str | os.PathLike):
        expected = f"names and values, a TOML file, or {type(settings).__name__}"
        raise StictionError(f"settings {changes!r}: expected {expected}")
    where = os.fspath(changes)
    return _changed(settings, _nested(_read(Path(where)), where), f"{where}: ")


def fingerprint(settings: Any) -> str:
    """Return 16 hexadecimal digits that change with any name or value; the same everywhere."""
    text = json.dumps(dict(sorted(flat(settings))), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def flat(settings: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted names and values of all numbers, nested ones included."""
    for name, value in _items(settings).items():
        if dataclasses.is_dataclass(value) or isinstance(value, Mapping):
            yield from flat(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = (error.strerror or "cannot be read").lower()
        raise StictionError(f"{path}: {reason}: expected a TOML file of settings") from None
    except ValueError as error:  # TOML, UTF-8, or a whole number of thousands of digits
        raise StictionError(f"{path}: not a TOML file: {error}") from None


def _items(settings: Any) -> Mapping[str, Any]:
    """Return names and values of a dataclass or of several by name."""
    if isinstance(settings, Mapping):
        return settings
    return {f.name: getattr(settings, f.name) for f in dataclasses.fields(settings)}


def _values(table: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return a table of the room's TOML without units and sources, which every entry must have."""
    out = {}
    for name, entry in table.items():
        if isinstance(entry, dict) and not ENTRY & set(entry):
            out[name] = _values(entry, f"{where}{name}.")
            continue
        if not isinstance(entry, dict) or not {"value", "unit"} <= set(entry) <= ENTRY:
            expected = "{ value, unit, source or assumed = true }"
            raise StictionError(f"{where}{name} is {entry!r}: expected {expected}")
        known = entry.get("assumed") is True or isinstance(entry.get("source"), str)
        if not (known and isinstance(entry["unit"], str)):
            raise StictionError(f"{where}{name}: expected a unit, and a source or assumed = true")
        out[name] = entry["value"]
    return out


def _converted(cls: type[T], values: Mapping[str, Any], where: str) -> T:
    """Return checked settings: names, types, ranges, and every number finite.

    Raises:
        StictionError: one line that names the value and what is expected.
    """
    _check_names(cls, values, where)
    _check_finite(values, where)
    try:
        return msgspec.convert(values, cls)
    except msgspec.ValidationError as error:
        said, _, place = str(error).partition(" - at `$.")
        place = f"{place.removesuffix('`')}: " if place else ""
        raise StictionError(f"{where}{place}{said[:1].lower()}{said[1:]}") from None


def _check_names(cls: Any, values: Mapping[str, Any], where: str) -> None:
    """msgspec passes unknown names of dataclasses."""
    kinds = get_type_hints(cls)
    names = [f.name for f in dataclasses.fields(cls)]
    for name, value in values.items():
        if name not in names:
            raise StictionError(f"{where}{name} is unknown: expected {', '.join(names)}")
        inner = kinds[name]
        if dataclasses.is_dataclass(inner):
            if not isinstance(value, Mapping):
                raise StictionError(f"{where}{name} is {value!r}: expected a table")
            _check_names(inner, value, f"{where}{name}.")
    for name in names:
        if name not in values:
            raise StictionError(f"{where}{name} is missing: expected {', '.join(names)}")


def _check_finite(value: Any, where: str) -> None:
    if isinstance(value, Mapping):
        for name, inner in value.items():
            dot = "" if where.endswith((" ", ".")) else "."
            _check_finite(inner, f"{where}{dot}{name}")
    elif isinstance(value, list | tuple):
        for inner in value:
            _check_finite(inner, where)
    elif isinstance(value, int) and abs(value) > sys.float_info.max:
        raise StictionError(f"{where}: a number of hundreds of digits: expected less")
    elif isinstance(value, float) and not math.isfinite(value):
        raise StictionError(f"{where} is {value!r}: expected finite numbers")


def _nested(given: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return changes as tables in tables: dotted names taken apart, plain values."""
    out: dict[str, Any] = {}
    for name, value in given.items():
        *tables, last = str(name).split(".")
        node = out
        for part in tables:
            node = node.setdefault(part, {})
            if not isinstance(node, dict):
                raise StictionError(f"{where}: {name} is given twice: expected once")
        if isinstance(value, Mapping):
            value = value["value"] if "value" in value else _nested(value, where)
        if isinstance(node.get(last), dict) and isinstance(value, dict):
            value = {**node[last], **value}
        node[last] = value
    return out


def _changed(settings: T, changes: Mapping[str, Any], where: str) -> T:
    """Return settings of the same kind; tables in them are changed first."""
    old = dict(_items(settings))
    for name, value in changes.items():
        if name not in old:
            expected = ", ".join(old)
            raise StictionError(f"{where}{name}: no such setting: expected one of {expected}")
        if dataclasses.is_dataclass(old[name]) or isinstance(old[name], Mapping):
            if not isinstance(value, Mapping):
                expected = ", ".join(_items(old[name]))
                raise StictionError(f"{where}{name} is {value!r}: expected a table of {expected}")
            old[name] = _changed(old[name], value, f"{where}{name}.")
        else:
            old[name] = _one(type(settings), name, value, where)
    if isinstance(settings, Mapping):
        return old  # type: ignore[return-value]
    return dataclasses.replace(settings, **{k: old[k] for k in changes})  # type: ignore[type-var]


def _one(cls: Any, name: str, value: Any, where: str) -> Any:
    """Return one checked value of a field."""
    _check_finite(value, f"{where}{name}")
    kind = get_type_hints(cls, include_extras=True)[name]
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        said = str(error).partition(" - at ")[0]
        raise StictionError(f"{where}{name} is {value!r}: {said[:1].lower()}{said[1:]}") from None
