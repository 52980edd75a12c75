"""The runs of a rehearsal: sizes, simulation, diagnosis; in processes, kept as they end."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.causes import Cause, register, registered
from stiction_envs.hidden.rehearsal.effects import dry_friction, effect_of
from stiction_envs.hidden.rehearsal.jobs import FOUND, MISSED, NOTHING, Job, Run, judge
from stiction_envs.hidden.rehearsal.replay import Replay
from stiction_envs.reporting.atomic import naming, write_text_atomic

Array = NDArray[np.float64]
LARGE_NOISE, LARGE_SHARE = 25.0, 0.1
"""Torque of the largest size over the noise, and over the joint's whole torque, whichever is more;
root mean squares [-]; assumed: nobody overlooks either. That of the smallest is the noise, hardly
visible to the eye; the middle one is their geometric mean."""
CLOSE = 0.03
"""Relative error of a size [-]; assumed."""
STEPS = 8
"""Most steps in which a size is found; assumed: the torque is nearly proportional to it."""
NO_TORQUE = 1e-6
"""Torque over the noise that is none [-]; assumed."""
NO_SIZE = 1e-6
"""Part of a small size that is none [-]; assumed."""
RUNS = "rehearsal_runs.jsonl"


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
    jobs: list[Job], replay: Replay, seed: int, threads: int
) -> Iterator[tuple[Job, list[Run]]]:
    """Yield the runs of each job when they are done."""
    processes = min(threads or os.cpu_count() or 1, len(jobs))
    if processes < 2:
        yield from ((job, measure(job, replay, seed)) for job in jobs)
        return
    with _pool(processes, (replay, seed, registered())) as pool:
        waiting = {pool.submit(_measure_there, job): job for job in jobs}
        for one in as_completed(waiting):
            yield waiting[one], one.result()


@contextmanager
def _pool(processes: int, shared: tuple[Any, ...]) -> Iterator[Executor]:
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


_there: list[Any] = []
"""Replay and seed of a process."""


def _begin(replay: Replay, seed: int, causes: Sequence[Cause]) -> None:
    """Prepare a process; causes of other packages are known there too."""
    known = {c.name for c in registered()}
    for cause in causes:
        if cause.name not in known:
            register(cause)
    _there[:] = [replay, seed]


def _measure_there(job: Job) -> list[Run]:
    return measure(job, *_there)


def measure(job: Job, replay: Replay, seed: int) -> list[Run]:
    """Hide a cause at the sizes that are needed; the smallest effect first."""
    if job.cause == NOTHING:
        return [_run(job, replay, np.zeros(replay.data.n), seed, 1)]
    sizes = sizes_of(job, replay)
    if not sizes[1].any():
        return []
    runs = {1: _run(job, replay, sizes[1], seed, 1)}
    said = {judge(job, row, runs[1]).verdict for row in job.rows if str(row) in runs[1]["sizes"]}
    for k, needed in ((0, said != {MISSED}), (2, said != {FOUND})):
        if needed and not np.allclose(sizes[k], sizes[1]):  # unless all are the largest there is
            runs[k] = _run(job, replay, sizes[k], seed, k)
    return [runs[k] for k in sorted(runs)]


def sizes_of(job: Job, replay: Replay) -> tuple[Array, Array, Array]:
    """Return three sizes (n,) of the cause of a job; 0 on joints whose torque does not change."""
    whole = np.sqrt(np.mean(np.square(replay.data.nominal), axis=0))
    small = size_for(job, replay, replay.noise)
    large = size_for(job, replay, np.maximum(LARGE_NOISE * replay.noise, LARGE_SHARE * whole))
    return small, np.sqrt(small * large), large


def size_for(job: Job, replay: Replay, target: Array) -> Array:
    """Return (n,) sizes with torques of a root mean square (n,) [N·m]; 0 where there is no torque.

    Of a cause that all joints show, one joint reaches its target, and the others do not. Sizes end
    at the largest.
    """
    effect, size = effect_of(job.cause), np.zeros(replay.data.n)
    size[list(job.joints)] = effect.start
    always = effect.torque(replay, NO_SIZE * size) if effect.comes_with else 0.0
    for _ in range(STEPS):
        torque = replay.in_band(effect.torque(replay, size) - always)
        ratio = np.sqrt(np.mean(np.square(torque), axis=0)) / target
        if job.coupled or job.arm_wide:
            ratio = np.full_like(ratio, ratio.max())
        size = np.where(ratio > NO_TORQUE, size, 0.0)
        wanted = np.minimum(size / np.maximum(ratio, NO_TORQUE), effect.largest)
        near = np.allclose(wanted, size, rtol=CLOSE)
        size = wanted
        if near:
            break
    return size


def _run(job: Job, replay: Replay, size: Array, seed: int, number: int) -> Run:
    """Hide a cause of sizes (n,), and return what is named."""
    hidden, sizes = np.zeros_like(replay.data.q), {}
    if job.cause != NOTHING:
        effect = effect_of(job.cause)
        hidden = hidden + effect.torque(replay, size)
        if effect.on_friction:
            hidden = hidden + dry_friction(replay, replay.unknown_friction)
        shown = effect.shown(replay, size)
        at = {0: 0} if job.arm_wide else {j + 1: j for j in job.joints}
        sizes = {str(row): float(shown[j]) for row, j in at.items() if size[j] > 0}
    logs = replay.logs(hidden, [seed, zlib.crc32(job.key.encode()), number])
    said = replay.diagnose(logs, seed)
    named = [[c.name, list(c.joints), list(c.confused_with)] for c in said.causes]
    return {"sizes": sizes, "named": named, "minor": [c.name for c in said.minor]}
