"""Jobs of a rehearsal: hidden causes, their sizes, and whether a run found them."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any, Protocol, TypedDict

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.reporting.markdown import joints as joints_text
from stiction_envs.reporting.markdown import listed

NOTHING = "nothing"
"""Key of the run in which nothing is hidden."""
LARGE_NOISE, LARGE_SHARE = 25.0, 0.1
"""Change by the largest size, over the noise, and over the joint's whole torque or motion,
whichever is more; root mean squares [-]; assumed: nobody overlooks either. The smallest changes as
much as the noise, hardly visible to the eye; the middle one is their geometric mean."""


class RehearsalRun(TypedDict):
    """Diagnosis of a log in which a cause was hidden."""

    sizes: dict[str, float]
    """Parameter by joint."""
    named: list[list[Any]]
    """Name, joints and what it is confused with, of each cause."""
    minor: list[str]


@dataclass(frozen=True)
class Hideable:
    """A cause that a rehearsal hides, and how its rows call it."""

    name: str
    parameter: str
    """Name of the size, as in ``diagnosis.json`` where the size is a parameter of the cause."""
    unit: str
    what_to_record: str
    """The motion that would show it."""
    _: KW_ONLY
    expected: tuple[str, ...] = ()
    """Causes that are named rightly beside it."""
    part_of: tuple[str, ...] = ()
    """Causes that are named instead where these data cannot tell it from their other parts."""
    arm_wide: bool = False
    coupled: bool = False
    """Whether all joints' torques show it in one joint: it is hidden joint by joint."""


@dataclass(frozen=True, kw_only=True)
class CauseJob:
    """One cause, and the joints (from 0) in which it is hidden at once."""

    what: Hideable
    joints: tuple[int, ...]
    why_not: str = ""

    @property
    def cause(self) -> str:
        """Name of the cause."""
        return self.what.name

    @property
    def key(self) -> str:
        """Name of the job among the runs."""
        return f"{self.cause} {self.joints[0] + 1}" if self.what.coupled else self.cause

    @property
    def rows(self) -> tuple[int, ...]:
        """Joints of its rows (from 1); 0 for the whole arm."""
        return (0,) if self.what.arm_wide else tuple(j + 1 for j in self.joints)


NO_JOB = CauseJob(what=Hideable(NOTHING, "", "", ""), joints=())


class Subject(Protocol):
    """Logs in which causes can be hidden."""

    def sizes(self, job: CauseJob) -> tuple[Array, Array, Array]:
        """Return three sizes (n,) of the cause of a job; 0 on joints where it changes nothing."""

    def run(self, job: CauseJob, size: Array, seed: int, number: int) -> RehearsalRun:
        """Hide a cause of sizes (n,), diagnose the log, and return what is named."""


FOUND, CONFUSED, MISSED = "found", "confused", "missed"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Verdict of a run on the hidden cause on a joint."""

    verdict: str
    """``found``: named, and nothing false beside it; ``confused``: the same, but these data cannot
    tell it from others; ``missed``."""
    false: tuple[str, ...]
    """Causes that were named falsely."""
    why: str


def judge(job: CauseJob, row: int, run: RehearsalRun) -> Verdict:
    """Return whether a run finds the cause on a joint (from 1), 0 for the whole arm.

    Named falsely is every cause that was not hidden: anywhere on the arm if the hidden cause acts
    on all joints' torques, else on this joint.
    """
    everywhere = job.what.arm_wide or job.what.coupled
    alike: list[str] | None = None
    false: list[str] = []
    for name, joints, confused_with in run["named"]:
        if name in (job.cause, *job.what.part_of) and (job.what.arm_wide or row in joints):
            alike = [x for x in confused_with if x != job.cause]
            extra = [j for j in joints if j != row] if job.what.coupled else []
            false += [f"{name} of {joints_text(extra)}"] if extra else []
        elif name in job.what.expected:
            continue
        elif everywhere or row in joints:
            false.append(f"{name} of {joints_text(joints)}" if everywhere else name)
    verdict, why = MISSED, "nothing is named"
    if alike is None and job.cause in run["minor"]:
        why = "named among the minor causes only"
    elif false:
        named = listed(false)
        why = f"named {named} instead" if alike is None else f"named, but {named} too"
    elif alike:
        verdict, why = CONFUSED, f"these data cannot tell it from {listed(alike)}"
    elif alike is not None:
        verdict, why = FOUND, ""
    return Verdict(verdict=verdict, false=tuple(false), why=why)


def measure(job: CauseJob, subject: Subject, seed: int) -> list[RehearsalRun]:
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
