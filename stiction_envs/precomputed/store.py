"""Store of precomputed results: some are shipped beside this file, others are in the user's cache.

A result is found by a digest of everything that it depends on, so it is never stale: results of
other numbers, or of another MuJoCo, have another digest. In the user's cache, results of other code
count as missing (`code_digest`). Shipped results come with their code; a test compares them with
what the code computes (``tests/envs/test_precompute.py``).

The cache is in ``$XDG_CACHE_HOME/stiction-envs``, else ``~/.cache/stiction-envs``. The environment
variable STICTION_CACHE names another folder; if it is empty or ``off``, everything is computed
anew, even what is shipped. A file that cannot be read, or a damaged line, counts as missing; a
folder that cannot be written is not an error.
"""

import dataclasses
import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from stiction_envs.reporting.kept_rows import KeptRows

SHIPPED = Path(__file__).parent
MADE_BY = (
    "compiled.py",
    "plant",
    "control",
    "dither",
    "experiments",
    "filters.py",
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
"""A result by name: JSON values."""
_memory: dict[str, KeptRows] = {}


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
    return dict(_rows(kind, of).every)


def keep(kind: str, of: str, found: Mapping[str, object]) -> None:
    """Add `Values` to a stored result, in this process and in the user's cache; see `recall`."""
    rows = _rows(kind, of)
    for name, value in found.items():
        with suppress(OSError):  # of a folder that cannot be written: it is computed again
            rows.add(name, value)


def forget() -> None:
    """Forget what this process has found: the next `recall` reads the files again."""
    _memory.clear()


def _rows(kind: str, of: str) -> KeptRows:
    """Return the rows of a result: those of the user's cache, and shipped ones."""
    name = file_name(kind, of)
    if name not in _memory:
        folder = cache_folder()
        rows = KeptRows(None)
        if folder is not None:
            with suppress(OSError):
                rows = KeptRows(folder / name, code_digest())
                if not rows.every:  # files of other code do not pile up
                    (folder / name).unlink(missing_ok=True)
            rows.every |= KeptRows(SHIPPED / name).every
        _memory[name] = rows
    return _memory[name]


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
    return f"{kind}-{digest(mujoco.__version__, of)[:16]}.jsonl"
