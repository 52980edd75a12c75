"""Results of many jobs, kept in a file as they come: work that was stopped goes on where it was.

    rows = KeptRows(folder / "runs.jsonl").fill({"a": 1, "b": 2}, measure, processes=2)

The file has one JSON line per row: its key, the code that made it, and the row. Rows of other code
are left out, and a last line that was cut off is made anew.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

from stiction_envs.reporting.atomic import naming

Job = TypeVar("Job")
Tell = Callable[[str, int, int], None]
"""Called with a finished key, the number of finished jobs, and the number of all."""


class KeptRows:
    """Rows of a file, and those that are added to it."""

    def __init__(self, path: Path | None, code: str = "") -> None:
        """Read the rows that a code made; a ``path`` of None keeps rows in memory only."""
        self._path, self._code = path, code
        self.every: dict[str, Any] = {}
        """All rows, by key."""
        if path is None or not path.exists():
            return
        text = path.read_text("utf-8")
        for line in text.splitlines():
            try:
                one = json.loads(line)
            except json.JSONDecodeError:
                continue
            if one["code"] == code:
                self.every[one["key"]] = one["row"]
        if not text.endswith("\n"):
            with path.open("a", encoding="utf-8") as file:
                file.write("\n")

    def add(self, key: str, row: Any) -> None:
        """Keep a row."""
        self.every[key] = row
        if self._path is not None:
            line = json.dumps({"key": key, "code": self._code, "row": row}) + "\n"
            with naming(self._path):
                self._path.parent.mkdir(parents=True, exist_ok=True)
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(line)

    def fill(
        self,
        jobs: Mapping[str, Job],
        measure: Callable[[Job], Any],
        *,
        processes: int = 1,
        minutes: float = math.inf,
        tell: Tell | None = None,
        begin: Callable[[], None] | None = None,
    ) -> dict[str, Any]:
        """Measure the jobs whose key has no row; return the rows of all jobs, in their order.

        Args:
            jobs: by the keys of their rows.
            measure: returns the row of a job; with more than one process a function of a module.
            processes: number of processes, each with one thread of linear algebra.
            minutes: no row is begun after this time, and missing rows are left out.
            tell: called after each job.
            begin: called in each new process.
        """
        missing = {key: job for key, job in jobs.items() if key not in self.every}
        end = time.monotonic() + 60 * minutes
        if minutes > 0:
            with _mapping(min(processes, len(missing)), begin) as apply:
                found = apply(measure, missing.values())
                for left, (key, row) in enumerate(zip(missing, found, strict=True), 1):
                    self.add(key, row)
                    if tell is not None:
                        tell(key, len(jobs) - len(missing) + left, len(jobs))
                    if time.monotonic() > end:
                        break
        return {key: self.every[key] for key in jobs if key in self.every}


@contextmanager
def _mapping(processes: int, begin: Callable[[], None] | None) -> Iterator[Callable[..., Any]]:
    """Yield `map`, or the same with several processes at the same time."""
    if processes < 2:
        yield map
        return
    before = os.environ.get("OPENBLAS_NUM_THREADS")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # they compete for the processors else
    pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"), initializer=begin)
    try:
        yield pool.map
    finally:
        if before is None:
            del os.environ["OPENBLAS_NUM_THREADS"]
        pool.shutdown(cancel_futures=True)  # after an interruption none begins anything
