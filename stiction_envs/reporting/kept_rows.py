"""Results of many jobs, kept in a file as they come: work that was stopped goes on where it was.

    rows = KeptRows(folder / "runs.jsonl").fill({"a": 1, "b": 2}, measure, processes=2)

The file has one JSON line per row: its key, the code that made it, and the row. Rows of other code
are left out, and so are lines that were cut off.

Stored so: rehearsals, repeated measurements of a search, measurements of a real robot, rows of
benchmarks, precomputed results. Trials are in an Optuna study instead, which samplers read and
machines share; a training's checkpoint is Stable-Baselines3's, networks and replay buffer.
"""

import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
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
        self._path, self._code, self._begin = path, code, ""
        self.every: dict[str, Any] = {}
        """All rows, by key."""
        if path is None or not path.exists():
            return
        lines = path.read_bytes().split(b"\n")
        for line in lines:
            with suppress(ValueError, KeyError, TypeError):
                one = json.loads(line)
                if one["code"] == code:
                    self.every[one["key"]] = one["row"]
        self._begin = "\n" if lines[-1] else ""  # ends a line that was cut off

    def add(self, key: str, row: Any) -> None:
        """Keep a row."""
        self.every[key] = row
        if self._path is not None:
            line = json.dumps({"key": key, "code": self._code, "row": row}) + "\n"
            with naming(self._path):
                self._path.parent.mkdir(parents=True, exist_ok=True)
                with self._path.open("ab") as file:  # in one piece: other processes may write, too
                    file.write((self._begin + line).encode())
            self._begin = ""

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
