"""Which causes would a diagnosis find on this arm? Hide each cause in the motion of a log.

    r = rehearse("log.csv", "panda", torque="link")
    print(r)                       # the smallest size of each cause that this motion shows
    r.save("runs/rehearsal")       # rehearsal.csv

log -> its own diagnosis -> motion and noise (`replay`) -> nominal torque + one cause of known size
(`torque_effects`) + noise -> diagnosis -> was it named, and nothing else?

For servo logs (`servo`) stock MuJoCo simulates the whole arm under its servos instead.

A cause of single joints is hidden in all of them at once, because its torque is only its joint's.
One that all joints' torques show (`Cause.acts_on`: a link, a gear) is hidden joint by joint: all
together would be another fault, such as a wrong torque gain. The middle size comes first; then a
smaller one where it was found, or a larger one where not. Refinements of dry friction are hidden on
dry friction, as much as the log shows, which a rigid nominal model lacks: that is to be named too.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Unpack

from stiction_envs.errors import StictionError, unknown
from stiction_envs.gap.causes import Cause, cause_named, register, registered
from stiction_envs.gap.diagnose import LogOptions, diagnose
from stiction_envs.gap.model_file import changed_arm
from stiction_envs.gap.report.results import LogDiagnosis, ServoResult
from stiction_envs.hidden.rehearsal.jobs import NOTHING, CauseJob, Subject, measure
from stiction_envs.hidden.rehearsal.rehearsal_result import Rehearsal, row_of
from stiction_envs.hidden.rehearsal.replay import replay_of
from stiction_envs.hidden.rehearsal.servo import subject_of
from stiction_envs.hidden.rehearsal.torques import HiddenTorques, jobs_of
from stiction_envs.hidden.servo_effects import EFFECTS
from stiction_envs.measured.kinds import TABLE, file_kind
from stiction_envs.measured.logs.columns import POSITION, TORQUE
from stiction_envs.measured.logs.joint_names import naming_of
from stiction_envs.measured.logs.reader import drive_of
from stiction_envs.measured.logs.robot_log import RobotLog
from stiction_envs.measured.logs.sources import Log
from stiction_envs.reporting.kept_rows import KeptRows
from stiction_envs.reporting.provenance import Provenance, provenance
from stiction_envs.robots import Arm
from stiction_envs.robots.registry import robot_files


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Jobs of a rehearsal in a log that was diagnosed."""

    robot: str
    subject: Subject
    jobs: tuple[CauseJob, ...]
    seed: int
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
        asked = {job.key: job for job in self.jobs if not job.why_not}

        def tell(key: str, done: int, count: int) -> None:
            if progress is not None:
                progress(f"hid {key} in the log", done / count)

        runs = KeptRows(kept).fill(
            asked,
            partial(measure, subject=self.subject, seed=self.seed),
            processes=threads or os.cpu_count() or 1,
            tell=tell,
            begin=partial(_begin, registered()),
        )
        order = list(dict.fromkeys(job.cause for job in self.jobs))
        rows = [
            row_of(job, row, [] if job.why_not else runs[job.key])
            for job in self.jobs
            if job.cause != NOTHING
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
    for table in (x for x in given if isinstance(x, str | Path) and file_kind(x) == TABLE):
        raise StictionError(f"rehearse: {table} is a torque table: expected joint logs")
    naming = naming_of(None, options)
    kind = options.get("drive") or next((drive_of(x, naming) for x in given), TORQUE)
    for name in causes or ():  # before the long computation
        if kind != POSITION:
            cause_named(name)
        elif name not in EFFECTS:
            raise unknown("cause", name, EFFECTS)
    own = diagnose(
        given, robot, progress=lambda stage, _: say(f"the log itself: {stage}", 0.0), **options
    )
    subject: Subject
    if isinstance(own, ServoResult):
        subject = subject_of(own.diagnosis, changed_arm(own.arm, own.before.parts))
        jobs = subject.jobs_of(causes or EFFECTS)
    else:
        assert isinstance(own, LogDiagnosis)
        hidden = [c for c in registered() if causes is None or c.name in causes]
        subject = HiddenTorques(replay=replay_of(own.diagnosis))
        jobs = jobs_of(own.diagnosis, hidden)
    arguments: dict[str, object] = {**own.provenance["arguments"], "rehearse": True}
    if causes is not None:
        arguments["rehearse_causes"] = list(causes)
    inputs = {**own.sources.files, **({} if isinstance(robot, Arm) else robot_files(robot))}
    for name in ("nominal", "calibration"):
        file = options.get(name)
        if isinstance(file, str | Path) and Path(file).is_file():
            inputs[name] = Path(file)
    seed = own.provenance["seed"]
    return Plan(
        robot=own.robot,
        subject=subject,
        jobs=tuple(jobs),
        seed=seed,
        provenance=provenance("diagnose", arguments, seed=seed, inputs=inputs),
    )
