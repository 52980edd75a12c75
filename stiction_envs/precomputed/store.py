"""Store of precomputed results: some are shipped beside this file, others are in the user's cache.

A result is found by a digest of everything that it depends on, so it is never stale: results of
other numbers, or of another MuJoCo, have another digest. In the user's cache, results of other code
count as missing (`code_digest`). Shipped results come with their code; a test compares them with
what the code computes (``tests/envs/test_precompute.py``).

The cache is in ``$XDG_CACHE_HOME/stiction-envs``, else ``~/.cache/stiction-envs``. The environment
variable STICTION_CACHE names another folder; if it is empty or ``off``, everything is computed
anew, even what is shipped. A file that cannot be read, or is damaged, counts as missing; a folder
that cannot be written is not an error.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from stiction_envs.reporting.atomic import write_text_atomic

SHIPPED = Path(__file__).parent
MADE_BY = (
    "compiled.py",
    "plant",
    "control",
    "dither",
    "experiments",
    "friction",
    "measured",
    "method_settings.py",
    "precomputed",
    "robots",
)
"""Files and rooms of the package whose code and settings can change a result."""
SHOWS = "plots.py"
"""Name of the files in them that only draw results."""
_PACKAGE = Path(__file__).parents[1]

Values = dict[str, Any]
"""A result by name: finite numbers, bools or nested lists of them."""
_memory: dict[str, Values] = {}


def digest(*parts: object) -> str:
    """Return a hash of numbers, strings, arrays (by their bits), dataclasses and containers.

    Raises:
        TypeError: anything else, since a `repr` need not show all its content.
    """
    out = hashlib.sha256()
    _feed(out.update, parts)
    return out.hexdigest()


def _feed(add: Callable[[bytes], None], part: object) -> None:
    if isinstance(part, np.ndarray):
        add(f"{part.dtype.str}{part.shape}".encode())
        add(np.ascontiguousarray(part).tobytes())
    elif part is None or isinstance(part, (str, bytes, bool, int, float)):
        plain = float(part).hex() if isinstance(part, float) else part
        add(f"{type(plain).__name__} {plain!r};".encode())
    elif isinstance(part, np.generic):
        _feed(add, part.item())
    elif dataclasses.is_dataclass(part) and not isinstance(part, type):
        _feed(add, [getattr(part, f.name) for f in dataclasses.fields(part)])
    elif isinstance(part, Mapping):
        _feed(add, [[name, part[name]] for name in sorted(part)])
    elif isinstance(part, Sequence):
        add(f"[{len(part)};".encode())
        for value in part:
            _feed(add, value)
    else:
        raise TypeError(f"no digest of a {type(part).__name__}")


def recall(kind: str, of: str) -> Values:
    """Return the stored part of a result, by name; empty where all must be computed.

    A result has a kind, such as ``poses``, and the `digest` of everything that it depends on.
    """
    name = file_name(kind, of)
    if name not in _memory:
        found = {}
        if (folder := cache_folder()) is not None:
            found = read(folder / name, code_digest()) | read(SHIPPED / name)
        _memory[name] = found
    return _memory[name]


def keep(kind: str, of: str, found: Mapping[str, object]) -> None:
    """Add `Values` to a stored result, in this process and in the user's cache; see `recall`."""
    name = file_name(kind, of)
    known = _memory.setdefault(name, {})
    known.update(found)
    folder = cache_folder()
    if folder is None:
        return
    with suppress(OSError):  # of a folder that cannot be written: it is computed again
        folder.mkdir(parents=True, exist_ok=True)
        write(folder / name, known, code=code_digest())


def forget() -> None:
    """Forget what this process has found: the next `recall` reads the files again."""
    _memory.clear()


def write(path: Path, values: Mapping[str, object], code: str = "") -> None:
    """Write one result at once; floats keep all their digits.

    ``code`` is the `code_digest` of a result in the user's cache.
    """
    lines = [f"  {json.dumps(k)}: {json.dumps(v, allow_nan=False)}" for k, v in values.items()]
    head = {"code": code, "sha256": digest(values)}
    text = "".join(f" {json.dumps(k)}: {json.dumps(v)},\n" for k, v in head.items())
    write_text_atomic(path, f'{{\n{text} "values": {{\n' + ",\n".join(lines) + "\n }\n}\n")


def cache_folder() -> Path | None:
    """Return the folder of the user's cache; None where it is switched off or there is no home."""
    own = os.environ.get("STICTION_CACHE")
    if own is not None:
        return None if own in ("", "off") else Path(own).expanduser()
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        return (base if base.is_absolute() else Path.home() / ".cache") / "stiction-envs"
    except RuntimeError:  # no home
        return None


@cache
def code_digest() -> str:
    """Return a hash of the code and settings that can change a result."""
    out = hashlib.sha256()
    for name in MADE_BY:
        path = _PACKAGE / name
        files = [path] if path.suffix else sorted([*path.rglob("*.py"), *path.rglob("*.toml")])
        for source in (x for x in files if x.name != SHOWS):
            out.update(f"{source.relative_to(_PACKAGE).as_posix()};".encode())
            out.update(source.read_bytes())
    return out.hexdigest()


def file_name(kind: str, of: str) -> str:
    """Return the name of a result's file; arguments as in `recall`."""
    return f"{kind}-{digest(mujoco.__version__, of)[:16]}.json"


def read(path: Path, code: str | None = None) -> Values:
    """Return the values of a file, none of one that is missing, damaged or made by other code."""
    try:
        found = json.loads(path.read_text("utf-8"))
        good = found["sha256"] == digest(found["values"]) and code in (None, found.get("code"))
        return dict(found["values"]) if good else {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}
