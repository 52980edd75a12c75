"""Which causes would a diagnosis find on this arm? Hide each cause in the motion of a log.

    r = rehearse("log.csv", "panda", torque="link")
    print(r)                       # the smallest size of each cause that this motion shows
    r.save("runs/rehearsal")       # rehearsal.csv

log -> its own diagnosis -> motion and noise -> a log with one cause of known size hidden in it
(`torque_logs`, `servo_logs`) -> diagnosis -> was it named, and nothing else (`jobs.judge`)?

A cause of single joints is hidden in all of them at once, because its torque is only its joint's.
One that all joints' torques show (`Cause.acts_on`: a link, a gear) is hidden joint by joint: all
together would be another fault, such as a wrong torque gain. The middle size comes first; then a
smaller one where it was found, or a larger one where not. Refinements of dry friction are hidden on
dry friction, as much as the log shows, which a rigid nominal model lacks: that is to be named too.
"""

import hashlib
import os
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Unpack

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError, unknown
from stiction_envs.gap.causes import Cause, register, registered
from stiction_envs.gap.diagnose import SERVO_LOGS, TABLES, LogOptions, diagnose, kind_of
from stiction_envs.gap.model_file import changed_arm
from stiction_envs.gap.report.results import LogDiagnosis, ServoResult
from stiction_envs.hidden.rehearsal.jobs import (
    FOUND,
    MISSED,
    NO_JOB,
    NOTHING,
    CauseJob,
    Hideable,
    RehearsalRun,
    judge,
)
from stiction_envs.hidden.rehearsal.rehearsal_result import Rehearsal, row_of
from stiction_envs.hidden.rehearsal.servo_logs import ServoLogs
from stiction_envs.hidden.rehearsal.torque_logs import TorqueLogs, hideable
from stiction_envs.hidden.servo_effects import EFFECTS
from stiction_envs.measured.logs.joint_names import naming_of
from stiction_envs.measured.logs.robot_log import RobotLog
from stiction_envs.measured.logs.sources import Log
from stiction_envs.reporting.kept_rows import KeptRows
from stiction_envs.reporting.provenance import Provenance
from stiction_envs.robots import Arm

Subject = TorqueLogs | ServoLogs
"""Logs in which causes can be hidden."""
LARGE_NOISE, LARGE_SHARE = 25.0, 0.1
"""Change by the largest size, over the noise, and over the joint's whole torque or motion,
whichever is more; root mean squares [-]; assumed: nobody overlooks either. The smallest changes as
much as the noise, hardly visible to the eye; the middle one is their geometric mean."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Jobs of a rehearsal in a log that was diagnosed."""

    robot: str
    subject: Subject
    jobs: Sequence[CauseJob]
    provenance: Provenance

    def run(
        self,
        *,
        threads: int = 1,
        progress: Callable[[str, float], None] | None = None,
        kept: Path | None = None,
    ) -> Rehearsal:
        """Hide, diagnose and judge; ``threads`` and ``progress`` are as of `rehearse`.

        Finished jobs are kept in the file ``kept``, and not done again; None keeps nothing.
        """

        def tell(key: str, done: int, count: int) -> None:
            if progress is not None:
                progress(f"hid {key} in the log", done / count)

        runs = KeptRows(kept).fill(
            {job.key: job for job in self.jobs if not job.why_not},
            partial(measure, subject=self.subject, seed=self.provenance["seed"]),
            processes=threads or os.cpu_count() or 1,
            tell=tell,
            begin=partial(_begin, registered()),
        )
        order = [job.what.name for job in self.jobs]
        rows = [
            row_of(job, row, [] if job.why_not else runs[job.key])
            for job in self.jobs
            if job.what.name != NOTHING
            for row in job.rows
        ]
        return Rehearsal(
            robot=self.robot,
            rows=tuple(sorted(rows, key=lambda r: (order.index(r.cause), r.joint))),
            named_without=tuple(x[0] for x in runs[NOTHING][0]["named"]),
            runs=runs,
            provenance=self.provenance,
        )


def _begin(causes: Sequence[Cause]) -> None:
    """Prepare a process: register causes of other packages."""
    known = {c.name for c in registered()}
    for cause in (c for c in causes if c.name not in known):
        register(cause)


def jobs_of(subject: Subject, causes: Sequence[Hideable]) -> list[CauseJob]:
    """Return the jobs of causes, in their order, and that in which nothing is hidden."""
    jobs = [NO_JOB]
    for what in causes:
        whys = [subject.why_not(what, j) for j in range(len(subject.noise))]
        seen = tuple(j for j, why in enumerate(whys) if not why)
        if what.arm_wide:
            jobs.append(CauseJob(what, seen or (0,), "" if seen else whys[0]))
            continue
        together = [(j,) for j in seen] if what.coupled else [seen] * bool(seen)
        jobs += [CauseJob(what, joints) for joints in together]
        jobs += [CauseJob(what, (j,), why) for j, why in enumerate(whys) if why]
    return jobs


def measure(job: CauseJob, subject: Subject, seed: int) -> list[RehearsalRun]:
    """Hide a cause at the sizes that are needed; the smallest effect first."""

    def run(number: int, size: Array) -> RehearsalRun:
        rng = np.random.default_rng([seed, zlib.crc32(job.key.encode()), number])
        return subject.run(job, size, rng)

    if job.what.name == NOTHING:
        return [run(1, np.zeros(0))]
    overlooked = np.maximum(LARGE_NOISE * subject.noise, LARGE_SHARE * subject.whole)
    small, large = (subject.size(job, x) for x in (subject.noise, overlooked))
    sizes = small, np.sqrt(small * large), large
    if not sizes[1].any():
        return []
    runs = {1: run(1, sizes[1])}
    said = {judge(job, row, runs[1])[0] for row in job.rows if str(row) in runs[1]["sizes"]}
    for k, needed in ((0, said != {MISSED}), (2, said != {FOUND})):
        if needed and not np.allclose(sizes[k], sizes[1]):  # unless all are the largest there is
            runs[k] = run(k, sizes[k])
    return [runs[k] for k in sorted(runs)]


def rehearse(
    data: Log | Sequence[Log],
    robot: str | Path | Arm,
    *,
    causes: Sequence[str] | None = None,
    threads: int = 1,
    progress: Callable[[str, float], None] | None = None,
    **options: Unpack[LogOptions],
) -> Rehearsal:
    """Find which causes, and of which size, a diagnosis would find in recordings like these.

    Args:
        data: a joint log or servo log, or several.
        robot: name, model file or arm.
        causes: names of the causes to hide; None for all registered causes. Each diagnosis
            searches all causes.
        threads: processes that diagnose at the same time, 0 for one per processor; with more than
            one, a script needs the guard ``if __name__ == "__main__":``.
        progress: called with what was done and the part of the whole that is done.
        options: options of `diagnose`, for the log and for all simulated logs, without ``check``
            and ``poses``.

    Raises:
        StictionError: as `diagnose`; poses without motion, a torque table, or an unknown cause.
    """
    planned = plan(data, robot, causes=causes, progress=progress, **options)
    return planned.run(threads=threads, progress=progress)


def plan(
    data: Log | Sequence[Log],
    robot: str | Path | Arm,
    *,
    causes: Sequence[str] | None = None,
    progress: Callable[[str, float], None] | None = None,
    **options: Unpack[LogOptions],
) -> Plan:
    """Diagnose logs as they are, and plan what to hide in them; arguments are as of `rehearse`."""
    for name in ("check", "poses"):
        if name in options:
            raise StictionError(f"{name}: cannot be used to rehearse")
    say = progress or (lambda *_: None)
    given = [data] if isinstance(data, str | Path | RobotLog) else list(data)
    kind = kind_of(given, options.get("drive"), naming_of(None, options))
    if kind == TABLES:
        raise StictionError(f"rehearse: {given[0]} is a torque table: expected joint logs")
    every = list(EFFECTS.values()) if kind == SERVO_LOGS else [hideable(c) for c in registered()]
    for name in causes or ():  # before the long computation
        if name not in (known := [x.name for x in every]):
            raise unknown("cause", name, known)
    own = diagnose(
        given, robot, progress=lambda stage, _: say(f"the log itself: {stage}", 0.0), **options
    )
    subject: Subject
    if isinstance(own, ServoResult):
        subject = ServoLogs(own.diagnosis, changed_arm(own.arm, own.before.parts))
    else:
        assert isinstance(own, LogDiagnosis)
        subject = TorqueLogs(own.diagnosis)
    asked = {} if causes is None else {"rehearse_causes": list(causes)}
    made = own.provenance
    made["arguments"] |= {"rehearse": True, **asked}
    identity = made["arguments_sha256"] + str(asked)
    made["arguments_sha256"] = hashlib.sha256(identity.encode()).hexdigest()
    hidden = [x for x in every if causes is None or x.name in causes]
    return Plan(
        robot=own.robot,
        subject=subject,
        jobs=jobs_of(subject, hidden),
        provenance=made,
    )
