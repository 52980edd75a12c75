"""What every benchmark shares: options, rows that are kept, which code made them, the page.

    STUDY = Benchmark(__file__, __doc__, made_by=(*LOGS, "benchmarks/accuracy/blind_logs.py"))

    options = STUDY.parser().parse_args()
    rows = STUDY.rows(options).fill(jobs, measure, processes=2, minutes=options.minutes)
    STUDY.write_page(options, text)             # or **values, for the template NAME.md.j2

A benchmark is a script ``benchmarks/GROUP/NAME.py``, run by ``python -m benchmarks.GROUP.NAME``. It
writes ``NAME.md`` and its pictures beside itself, or into ``--out``.
"""

import argparse
import hashlib
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

from benchmarks.reference_loop import USUAL_S
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.kept_rows import KeptRows
from stiction_envs.reporting.templates import render

ROOT = Path(__file__).parents[1]
MEASURED = ROOT.parent / "shared" / "measured"
"""Logs of real robots, which are not part of the project."""
KINDS = (".py", ".toml", ".xml", ".csv", ".json")
"""Files that decide a result."""
PACKAGES = ("mujoco", "numpy", "scipy", "numba", "pin")
"""Packages whose versions decide a result."""
LOGS = tuple(
    f"stiction_envs/{place}"
    for place in (
        *("compiled.py", "control", "dither", "experiments", "filters.py", "friction", "gap"),
        *("measured", "method_settings.py", "plant", "precomputed", "robots"),
    )
)
"""Code of the package that decides a diagnosis of joint logs."""
Row = dict[str, Any]


@dataclass(frozen=True)
class Benchmark:
    """A script that measures something and writes a page about it."""

    script: str
    """``__file__`` of the study's module."""
    doc: str | None
    """``__doc__`` of the module; the first line is the description of its command."""
    made_by: Sequence[str] = ()
    """Files, folders and patterns whose code decides its rows: see `code_digest`."""

    @property
    def folder(self) -> Path:
        """Where the script is."""
        return Path(self.script).parent

    @property
    def name(self) -> str:
        """Name of script and page."""
        return Path(self.script).stem

    @property
    def command(self) -> str:
        """How the script is run."""
        place = Path(self.script).relative_to(ROOT).with_suffix("")
        return f"python -m {'.'.join(place.parts)}"

    def parser(self) -> argparse.ArgumentParser:
        """Return a parser with ``--out``, ``--work`` and ``--minutes``."""
        out = argparse.ArgumentParser(
            prog=self.command, description=(self.doc or "").partition("\n")[0]
        )
        work = Path("runs/benchmarks") / self.name
        out.add_argument("--out", type=Path, default=self.folder, help="folder of the page")
        out.add_argument("--work", type=Path, default=work, help="folder of rows that are kept")
        out.add_argument("--minutes", type=float, default=math.inf, help="stop after this long")
        return out

    def rows(self, options: argparse.Namespace, name: str = "") -> "Rows":
        """Return the rows that are kept in ``--work``."""
        path = options.work / f"{name or self.name}.jsonl"
        return Rows(path, code_digest(self.made_by) if self.made_by else "")

    def write_page(self, options: argparse.Namespace, text: str = "", **values: Any) -> str:
        """Write a text as the page, or else ``NAME.md.j2`` with its values; print and return it."""
        text = text or render(self.folder / f"{self.name}.md.j2", command=self.command, **values)
        options.out.mkdir(parents=True, exist_ok=True)
        write_text_atomic(options.out / f"{self.name}.md", text.rstrip() + "\n")
        print(text)
        return text


class Rows(KeptRows):
    """Rows of a study, each with the seconds that it took, unless it has its own."""

    def fill(self, jobs: Mapping[str, Any], measure: Callable[[Any], Any], **how: Any) -> Any:
        """Measure what is missing, as `KeptRows.fill`; print what is done."""
        return super().fill(jobs, partial(_timed, measure), tell=_print, **how)

    def known(self, keys: Iterable[str]) -> dict[str, Row]:
        """Return the rows that there are, by key."""
        return {key: self.every[key] for key in keys if key in self.every}


def _print(key: str, done: int, count: int) -> None:
    print(f"{done} of {count}: {key}", file=sys.stderr)


def _timed(measure: Callable[[Any], Row], job: Any) -> Row:
    start = time.perf_counter()
    row = measure(job)
    return {"seconds": time.perf_counter() - start, **row}


# ---- which code ----------------------------------------------------------------------------------


def code_digest(places: Sequence[str]) -> str:
    """Return a hash of files and of the versions of `PACKAGES`.

    Args:
        places: files, folders or patterns, from the top level of the project; a pattern that is
            written after ``!`` takes files out again.

    Raises:
        ValueError: a place where no file is.
    """
    out = hashlib.sha256()
    for name in PACKAGES:
        out.update(f"{name} {metadata.version(name)};".encode())
    for path in files_of(places):
        out.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return out.hexdigest()


def files_of(places: Sequence[str]) -> list[Path]:
    """Return the files that `code_digest` reads."""
    found: set[Path] = set()
    for place in places:
        inside = [
            path
            for top in ROOT.glob(place.removeprefix("!"))
            for path in ([top] if top.is_file() else top.rglob("*"))
            if path.is_file() and path.suffix in KINDS
        ]
        if not inside:
            raise ValueError(f"{place}: nothing is there")
        found = found.difference(inside) if place.startswith("!") else found.union(inside)
    return sorted(found)


# ---- words ---------------------------------------------------------------------------------------


def machine(loop_s: float | None = None) -> str:
    """Return versions and processors, and the seconds of the reference loop if it was run."""
    text = f"Python {platform.python_version()}, MuJoCo {metadata.version('mujoco')}, "
    text += f"numpy {metadata.version('numpy')}, {os.cpu_count()} processors"
    if loop_s is not None:
        text += f"; the reference loop took {loop_s:.1f} s ({USUAL_S} s on the quiet machine)"
    return text


def met(value: float, target: float, *, most: bool = False) -> str:
    """Return whether a value reaches a target: at least it, or with ``most`` at most it."""
    return "met" if (value <= target if most else value >= target) else "missed"
