"""What is hidden in which run of a rehearsal, and whether a run found it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stiction_envs.gap.causes import Cause
from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.hidden.rehearsal.effects import REPLAYED, effect_of
from stiction_envs.reporting.markdown import joints as joints_text
from stiction_envs.reporting.markdown import listed

NOTHING = "nothing"
"""Key of the run in which nothing is hidden."""
Run = dict[str, Any]
"""``sizes``: parameter by joint; ``named``: name, joints and what it is confused with, of each."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One cause, and the joints (from 0) in which it is hidden at once."""

    cause: str
    joints: tuple[int, ...]
    arm_wide: bool = False
    coupled: bool = False

    @property
    def key(self) -> str:
        """Its name among the runs."""
        return f"{self.cause} {self.joints[0] + 1}" if self.coupled else self.cause

    @property
    def rows(self) -> tuple[int, ...]:
        """Joints of its rows (from 1); 0 for the whole arm."""
        return (0,) if self.arm_wide else tuple(j + 1 for j in self.joints)


def jobs_of(
    own: Diagnosis, causes: Sequence[Cause]
) -> tuple[list[Job], dict[tuple[str, int], str]]:
    """Return the jobs, and why a cause (by name) on a joint (from 1) is not in any."""
    jobs, reasons = [Job(cause=NOTHING, joints=())], {}
    for cause in causes:
        joints = range(own.data.n)
        if cause.arm_wide:
            why = cause.why_not_identifiable(own.data, 0) or _lawless(cause)
            if why:
                reasons[cause.name, 0] = why
            else:
                jobs.append(Job(cause=cause.name, joints=tuple(joints), arm_wide=True))
            continue
        why_not = {j: cause.why_not_identifiable(own.data, j) or _lawless(cause) for j in joints}
        reasons |= {(cause.name, j + 1): why for j, why in why_not.items() if why}
        left = tuple(j for j, why in why_not.items() if not why)
        if cause.coupled:
            jobs += [Job(cause=cause.name, joints=(j,), coupled=True) for j in left]
        elif left:
            jobs.append(Job(cause=cause.name, joints=left))
    return jobs, reasons


def _lawless(cause: Cause) -> str:
    """Return that a cause of another package cannot be hidden, or nothing."""
    if cause.name in REPLAYED or (cause.is_linear and not cause.coupled):
        return ""
    return "no law is known by which to hide it"


FOUND, CONFUSED, MISSED = "found", "confused", "missed"


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What a run says of the hidden cause on a joint."""

    verdict: str
    """``found``: named, and nothing false beside it; ``confused``: the same, but these data cannot
    tell it from others; ``missed``."""
    false: tuple[str, ...]
    """What was named falsely."""
    why: str
    """Why it was not found, a clause."""


def judge(job: Job, row: int, run: Run) -> Judgement:
    """Return whether a run finds the cause on a joint (from 1), 0 for the whole arm.

    Named falsely is every cause that was not hidden: anywhere on the arm if the hidden cause acts
    on all joints' torques, else on this joint.
    """
    everywhere = job.arm_wide or job.coupled
    expected = effect_of(job.cause).expected
    alike: list[str] | None = None
    false: list[str] = []
    for name, joints, confused_with in run["named"]:
        if name == job.cause and (job.arm_wide or row in joints):
            alike = confused_with
            extra = [j for j in joints if j != row] if job.coupled else []
            false += [f"{name} of {joints_text(extra)}"] if extra else []
        elif name in expected:
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
    return Judgement(verdict=verdict, false=tuple(false), why=why)
