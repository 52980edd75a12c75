"""The runs of a rehearsal: three sizes of each cause; in processes, kept as they end."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.causes import Cause, register, registered
from stiction_envs.hidden.rehearsal.jobs import FOUND, MISSED, NOTHING, Job, Run, judge
from stiction_envs.reporting.atomic import naming, write_text_atomic

Array = NDArray[np.float64]
LARGE_NOISE, LARGE_SHARE = 25.0, 0.1
"""What the largest size changes, over the noise, and over the joint's whole torque or motion,
whichever is more; root mean squares [-]; assumed: nobody overlooks either. The smallest changes as
much as the noise, hardly visible to the eye; the middle one is their geometric mean."""
RUNS = "rehearsal_runs.jsonl"


class Subject(Protocol):
    """Logs in which causes can be hidden."""

    def sizes(self, job: Job) -> tuple[Array, Array, Array]:
        """Return three sizes (n,) of the cause of a job; 0 on joints where it changes nothing."""

    def run(self, job: Job, size: Array, seed: int, number: int) -> Run:
        """Hide a cause of sizes (n,), diagnose the log, and return what is named."""


def line(key: str, runs: list[Run]) -> str:
    """Return the line of a job's runs in a file."""
    return json.dumps({"key": key, "runs": runs}, ensure_ascii=False) + "\n"


def read_runs(kept: Path | None, keys: set[str]) -> dict[str, list[Run]]:
    """Return the runs of a file; a last line that was cut off is measured anew."""
    out: dict[str, list[Run]] = {}
    if kept is None or not kept.exists():
        return out
    whole = kept.read_text("utf-8").rpartition("\n")[0].splitlines()
    for line in whole:
        found = json.loads(line)
        if found["key"] in keys:
            out[found["key"]] = found["runs"]
    write_text_atomic(kept, "".join(f"{line}\n" for line in whole))
    return out


def keep(kept: Path, key: str, runs: list[Run]) -> None:
    """Add the runs of a job to a file."""
    with naming(kept), kept.open("a", encoding="utf-8") as file:
        file.write(line(key, runs))


def measured(
    jobs: list[Job], subject: Subject, seed: int, threads: int
) -> Iterator[tuple[Job, list[Run]]]:
    """Yield the runs of each job when they are done."""
    processes = min(threads or os.cpu_count() or 1, len(jobs))
    if processes < 2:
        yield from ((job, measure(job, subject, seed)) for job in jobs)
        return
    with _pool(processes, (subject, seed, registered())) as pool:
        waiting = {pool.submit(_measure_there, job): job for job in jobs}
        for one in as_completed(waiting):
            yield waiting[one], one.result()


@contextmanager
def _pool(processes: int, shared: tuple[Subject, int, Sequence[Cause]]) -> Iterator[Executor]:
    """Make processes of one thread each; after an interruption none begins anything."""
    context = get_context("spawn")
    pool = ProcessPoolExecutor(processes, context, initializer=_begin, initargs=shared)
    before = os.environ.get("OPENBLAS_NUM_THREADS")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # they compete for the processors else
    try:
        yield pool
    finally:
        if before is None:
            del os.environ["OPENBLAS_NUM_THREADS"]
        pool.shutdown(wait=True, cancel_futures=True)


_there: list[tuple[Subject, int]] = []
"""Subject and seed of a process."""


def _begin(subject: Subject, seed: int, causes: Sequence[Cause]) -> None:
    """Prepare a process; causes of other packages are known there too."""
    known = {c.name for c in registered()}
    for cause in causes:
        if cause.name not in known:
            register(cause)
    _there[:] = [(subject, seed)]


def _measure_there(job: Job) -> list[Run]:
    return measure(job, *_there[0])


def measure(job: Job, subject: Subject, seed: int) -> list[Run]:
    """Hide a cause at the sizes that are needed; the smallest effect first."""
    if job.cause == NOTHING:
        return [subject.run(job, np.zeros(0), seed, 1)]
    sizes = subject.sizes(job)
    if not sizes[1].any():
        return []
    runs = {1: subject.run(job, sizes[1], seed, 1)}
    said = {judge(job, row, runs[1]).verdict for row in job.rows if str(row) in runs[1]["sizes"]}
    for k, needed in ((0, said != {MISSED}), (2, said != {FOUND})):
        if needed and not np.allclose(sizes[k], sizes[1]):  # unless all are the largest there is
            runs[k] = subject.run(job, sizes[k], seed, k)
    return [runs[k] for k in sorted(runs)]
