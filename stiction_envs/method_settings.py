"""Constants of a method as data: frozen dataclasses whose defaults are in the room's TOML.

    @dataclass(frozen=True, kw_only=True)
    class ClockSettings:
        \"""When time stamps are a clock.\"""

        on_clock: Share
        \"""Root mean square distance from whole steps [steps]; 0.29 is chance.\"""

with, in ``settings.toml`` beside it,

    [clock]
    on_clock = { value = 0.15, unit = "steps", assumed = true }

Every entry has ``value`` and ``unit``, and a ``source`` or ``assumed = true``, as a test says.
msgspec checks types and ranges. A room nests its dataclasses in one, loads it once and passes it
down as an argument; users change some numbers by name (`override`).
"""

import dataclasses
import math
import os
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Protocol, TypeVar, get_type_hints

import msgspec

from stiction_envs.errors import StictionError, opening


class Dataclass(Protocol):
    """Instances of any dataclass."""

    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]


T = TypeVar("T", bound=Dataclass)
Changes = Mapping[str, object] | str | os.PathLike[str]
"""Dotted names (or tables) with new values, or a TOML file of them."""
Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
FinitePositive = Annotated[float, msgspec.Meta(gt=0, le=sys.float_info.max)]
Amount = Annotated[float, msgspec.Meta(ge=0, le=sys.float_info.max)]
"""Finite, and not negative."""
Share = Annotated[float, msgspec.Meta(gt=0, le=1)]
"""Above 0 and at most 1."""
Count = Annotated[int, msgspec.Meta(ge=1)]
Index = Annotated[int, msgspec.Meta(ge=0)]


@cache
def load_settings(cls: type[T], path: Path, table: str = "") -> T:
    """Return settings as a TOML file has them; the file is read once.

    Args:
        cls: keyword-only dataclass of numbers, flags, words, tuples of these, and more dataclasses.
        path: the file.
        table: dotted name of the table that holds ``cls``; its nested dataclasses are tables in it.
    """
    node: object = read_toml(path)
    for part in filter(None, table.split(".")):
        node = node.get(part) if isinstance(node, dict) else None
    if not isinstance(node, dict):
        raise StictionError(f"{path.name}: {table or 'the file'}: expected a table")
    where = f"{path.name}: {table}." if table else f"{path.name}: "
    return _converted(cls, _values(node), where)


def override(settings: T, changes: T | Changes | None) -> T:
    """Return settings with some values changed; the others stay.

    Args:
        settings: the values that are changed.
        changes: ``{"search.draws": 4}``, ``{"search": {"draws": 4}}``, a TOML file of tables with
            plain values or ``{ value = … }``, or settings of the same kind.

    Raises:
        StictionError: a file that cannot be read, an unknown name, or a value of another kind or
            out of range.
    """
    if changes is None:
        return settings
    if isinstance(changes, type(settings)):
        return changes
    if isinstance(changes, Mapping):
        where, given = "settings: ", changes
    elif isinstance(changes, str | os.PathLike):
        where, given = f"{os.fspath(changes)}: ", read_toml(Path(changes))
    else:
        expected = f"names and values, a TOML file, or {type(settings).__name__}"
        raise StictionError(f"settings {changes!r}: expected {expected}")
    values = dataclasses.asdict(settings)
    _merge(values, given, where)
    return _converted(type(settings), values, where)


def flat(
    settings: Dataclass | type[Dataclass] | Mapping[str, object], above: str = ""
) -> Iterator[tuple[str, object]]:
    """Yield dotted names and values of all numbers, nested ones included."""
    if not isinstance(settings, Mapping):
        settings = {f.name: getattr(settings, f.name) for f in dataclasses.fields(settings)}
    for name, value in settings.items():
        if dataclasses.is_dataclass(value) or isinstance(value, Mapping):
            yield from flat(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file; StictionError if it cannot be read."""
    try:
        with opening(path, "a TOML file"):
            return tomllib.loads(path.read_text(encoding="utf-8"))
    except StictionError:
        raise
    except ValueError as error:  # TOML, UTF-8, or a whole number of thousands of digits
        raise StictionError(f"{path}: not a TOML file: {error}") from None


def check_fields(settings: Dataclass, what: str) -> None:
    """Check every field of a dataclass that callers make; called in its ``__post_init__``.

    Raises:
        StictionError: a value of another kind or out of range; ``what`` are the settings.
    """
    for name, kind in get_type_hints(type(settings), include_extras=True).items():
        object.__setattr__(settings, name, checked(getattr(settings, name), kind, f"{what} {name}"))


def checked(value: Any, kind: Any, what: str) -> Any:
    """Return a value of a kind as `Count`; raise a StictionError that names ``what`` it is."""
    value = value.tolist() if hasattr(value, "tolist") else value  # numpy's numbers count
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        problem = str(error).replace("Expected", "expected")
        raise StictionError(f"{what} is {value!r}: {problem}") from None


def _values(table: Mapping[str, Any]) -> dict[str, object]:
    """Return a table of the room's TOML without units and sources."""
    return {
        name: entry["value"] if "value" in entry else _values(entry)
        for name, entry in table.items()
    }


def _merge(into: dict[str, object], given: Mapping[str, object], where: str) -> None:
    """Put changes into tables in tables; a name may be dotted, a value ``{ value = … }``."""
    for name, value in given.items():
        *tables, last = str(name).split(".")
        node = into
        for part in tables:
            inner = node.setdefault(part, {})
            if not isinstance(inner, dict):
                raise StictionError(
                    f"{where}{name}: no such setting: {part} is {inner!r}, no table"
                )
            node = inner
        if isinstance(value, Mapping) and "value" in value:
            value = value["value"]
        if isinstance(value, Mapping) and isinstance(table := node.get(last), dict):
            _merge(table, value, f"{where}{name}.")
        else:  # numpy's numbers count as Python's
            node[last] = value.tolist() if hasattr(value, "tolist") else value


def _converted(cls: type[T], values: Mapping[str, object], where: str) -> T:
    """Return checked settings: names, types, ranges, and every number finite.

    Raises:
        StictionError: one line that names the value and what is expected.
    """
    _check_names(cls, values, where)
    for name, value in flat(values):
        for number in _leaves(value):
            if isinstance(number, int) and abs(number) > sys.float_info.max:
                raise StictionError(f"{where}{name}: a number of hundreds of digits: expected less")
            if isinstance(number, float) and not math.isfinite(number):
                raise StictionError(f"{where}{name} is {number!r}: expected finite numbers")
    try:
        return msgspec.convert(values, cls)
    except msgspec.ValidationError as error:
        text, _, place = str(error).partition(" - at `$.")
        found = re.match(r"[\w.]+", place)
        if found:
            where += f"{found[0]} is {dict(flat(values)).get(found[0])!r}: "
        raise StictionError(f"{where}{text[:1].lower()}{text[1:]}") from None


def _leaves(value: object) -> Iterator[object]:
    """Yield the values in lists in lists."""
    if isinstance(value, list | tuple):
        for inner in value:
            yield from _leaves(inner)
    else:
        yield value


def _check_names(cls: type[Dataclass], values: object, where: str) -> None:
    """Raise for an unknown or a missing name: msgspec accepts unknown names of dataclasses."""
    kinds = get_type_hints(cls)
    names = [f.name for f in dataclasses.fields(cls)]
    if not isinstance(values, Mapping):
        place = where.removesuffix(".")
        raise StictionError(f"{place} is {values!r}: expected a table of {', '.join(names)}")
    for name, value in values.items():
        if name not in names:
            expected = ", ".join(names)
            raise StictionError(f"{where}{name}: no such setting: expected one of {expected}")
        if dataclasses.is_dataclass(kinds[name]):
            _check_names(kinds[name], value, f"{where}{name}.")
    for name in names:
        if name not in values:
            raise StictionError(f"{where}{name} is missing: expected {', '.join(names)}")
