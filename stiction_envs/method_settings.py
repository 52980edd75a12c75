"""Constants of a method as data: frozen dataclasses whose defaults stand in the room's TOML.

    @dataclass(frozen=True, kw_only=True)
    class ClockSettings:
        \"""When stamps are a clock.\"""

        on_clock: float
        \"""Root mean square distance from whole steps [steps]; 0.29 is chance.\"""

        def __post_init__(self) -> None:
            check_numbers(self)

with, in ``settings.toml`` beside it,

    [clock]
    on_clock = { value = 0.15, unit = "steps", assumed = true }

Every entry has ``value`` and ``unit``, and a ``source`` or ``assumed = true``. A room nests its
dataclasses in one, loads it once and hands it down through arguments; users change some numbers by
name (`override`), and results carry the hash of all of them (`fingerprint`).
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
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from stiction_envs.errors import StictionError

T = TypeVar("T")
Changes = Mapping[str, Any] | str | os.PathLike[str]
"""Dotted names (or tables) with new values, or a TOML file of them."""
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
    return _made(cls, node, path.name, f"{table}." if table else "")


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
        return _changed(settings, _nested(changes, "settings"), "settings", "")
    if not isinstance(changes, str | os.PathLike):
        expected = f"names and values, a TOML file, or {type(settings).__name__}"
        raise StictionError(f"settings {changes!r}: expected {expected}")
    where = os.fspath(changes)
    return _changed(settings, _nested(_read(Path(where)), where), where, "")


def fingerprint(settings: Any) -> str:
    """Return 16 hexadecimal digits that change with any name or value; the same everywhere."""
    text = json.dumps(dict(sorted(flat(settings))), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def flat(settings: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted names and values of all numbers, nested ones included."""
    for name, value in _items(settings).items():
        if _is_table(value):
            yield from flat(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


def check_numbers(
    settings: Any,
    *,
    shares: tuple[str, ...] = (),
    from_zero: tuple[str, ...] = (),
    signed: tuple[str, ...] = (),
) -> None:
    """Every number is finite, and above 0 unless named.

    Args:
        settings: a dataclass; flags, words and nested dataclasses pass.
        shares: fields of numbers above 0 and at most 1.
        from_zero: fields that may be 0.
        signed: fields that may be negative.

    Raises:
        StictionError: naming the field.
    """
    for f in dataclasses.fields(settings):
        value = getattr(settings, f.name)
        for x in value if isinstance(value, tuple) else (value,):
            if isinstance(x, bool) or not isinstance(x, int | float):
                continue
            good = x > 0 or f.name in signed or (f.name in from_zero and x == 0)
            if not (math.isfinite(x) and good and (f.name not in shares or x <= 1)):
                least = "" if f.name in signed else " from 0" if f.name in from_zero else " above 0"
                most = " up to 1" if f.name in shares else ""
                raise StictionError(
                    f"{type(settings).__name__}: {f.name} is {x!r}: expected finite numbers"
                    f"{least}{most}"
                )


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = (error.strerror or "cannot be read").lower()
        raise StictionError(f"{path}: {reason}: expected a TOML file of settings") from None
    except ValueError as error:  # TOML, UTF-8, or a whole number of thousands of digits
        raise StictionError(f"{path}: not a TOML file: {error}") from None


def _is_table(value: Any) -> bool:
    """Whether settings hold more settings: a dataclass, or several by name."""
    return dataclasses.is_dataclass(value) or isinstance(value, Mapping)


def _items(settings: Any) -> Mapping[str, Any]:
    """Return names and values of a dataclass or of several by name."""
    if isinstance(settings, Mapping):
        return settings
    return {f.name: getattr(settings, f.name) for f in dataclasses.fields(settings)}


def _names(cls: Any) -> str:
    if isinstance(cls, Mapping):
        return ", ".join(cls)
    return ", ".join(f.name for f in dataclasses.fields(cls))


def _made(cls: type[T], node: Any, where: str, above: str) -> T:
    """Return a dataclass from its table."""
    if not isinstance(node, dict):
        raise StictionError(f"{where}: {above or 'the file'}: expected a table of {_names(cls)}")
    kinds = get_type_hints(cls)
    names = [f.name for f in dataclasses.fields(cls)]  # type: ignore[arg-type]
    wrong = [f"{above}{x} is unknown" for x in node if x not in names]
    wrong += [f"{above}{x} is missing" for x in names if x not in node]
    if wrong:
        raise StictionError(f"{where}: {wrong[0]}: expected {_names(cls)}")
    values = {}
    for name in names:
        if dataclasses.is_dataclass(kinds[name]):
            values[name] = _made(kinds[name], node[name], where, f"{above}{name}.")
        else:
            here = f"{where}: {above}{name}"
            values[name] = _converted(kinds[name], _entry(node[name], here), here)
    return cls(**values)


def _entry(entry: Any, where: str) -> Any:
    """Return the value of an entry that says its unit and where it is from."""
    if not isinstance(entry, dict) or not {"value", "unit"} <= set(entry) <= ENTRY:
        raise StictionError(
            f"{where} is {entry!r}: expected {{ value, unit, source or assumed = true }}"
        )
    known = entry.get("assumed") is True or isinstance(entry.get("source"), str)
    if not (known and isinstance(entry["unit"], str)):
        raise StictionError(f"{where}: expected a unit, and a source or assumed = true")
    return entry["value"]


def _converted(kind: Any, value: Any, where: str) -> Any:
    """Return a value as its field has it: whole numbers pass for floats, lists for tuples."""
    if get_origin(kind) is tuple and isinstance(value, list | tuple):
        return tuple(_converted(get_args(kind)[0], x, where) for x in value)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(value, int) and abs(value) > sys.float_info.max:
        raise StictionError(f"{where}: a number of hundreds of digits: expected less")
    if kind is float and number:
        return float(value)
    if type(value) is kind:
        return value
    words = {float: "a number", int: "a whole number", bool: "true or false", str: "a word"}
    expected = words.get(kind, "a list")
    raise StictionError(f"{where} is {value!r}: expected {expected}")


def _nested(given: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return changes as tables in tables: dotted names taken apart."""
    out: dict[str, Any] = {}
    for name, value in given.items():
        *tables, last = str(name).split(".")
        node = out
        for part in tables:
            node = node.setdefault(part, {})
            if not isinstance(node, dict):
                raise StictionError(f"{where}: {name} is given twice: expected once")
        if isinstance(value, Mapping) and "value" not in value:
            value = _nested(value, where)
        if isinstance(node.get(last), dict) and isinstance(value, dict):
            value = {**node[last], **value}
        node[last] = value
    return out


def _changed(settings: T, changes: Mapping[str, Any], where: str, above: str) -> T:
    of_names, values = _items(settings), {}
    for name, value in changes.items():
        here = f"{where}: {above}{name}"
        if name not in of_names:
            raise StictionError(f"{here}: no such setting: expected one of {_names(settings)}")
        old = of_names[name]
        if _is_table(old):
            if not isinstance(value, Mapping):
                raise StictionError(f"{here} is {value!r}: expected a table of {_names(old)}")
            values[name] = _changed(old, value, where, f"{above}{name}.")
        else:
            plain = value["value"] if isinstance(value, Mapping) and "value" in value else value
            values[name] = _converted(get_type_hints(type(settings))[name], plain, here)
    if isinstance(settings, Mapping):
        return {**settings, **values}  # type: ignore[return-value]
    return dataclasses.replace(settings, **values)  # type: ignore[type-var]
