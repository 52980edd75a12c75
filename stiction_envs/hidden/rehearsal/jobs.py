"""Jobs of a rehearsal: causes to hide, their sizes, and whether a run found them."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
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
LEAST_FRICTION = 5.0
"""Dry friction that is taken where the log shows none, over the noise [-]; assumed."""
FOUND, CONFUSED, MISSED = "found", "confused", "missed"
"""Verdicts: named, and nothing false beside it; the same, but these data cannot tell it from
others; or else."""


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


@dataclass(frozen=True)
class CauseJob:
    """One cause, and the joints (from 0) in which it is hidden at once."""

    what: Hideable
    joints: tuple[int, ...]
    why_not: str = ""
    """Why it cannot show there; it is not hidden then."""

    @property
    def key(self) -> str:
        """Name of the job among the runs."""
        return f"{self.what.name} {self.joints[0] + 1}" if self.what.coupled else self.what.name

    @property
    def rows(self) -> tuple[int, ...]:
        """Joints of its rows (from 1); 0 for the whole arm."""
        return (0,) if self.what.arm_wide else tuple(j + 1 for j in self.joints)


NO_JOB = CauseJob(Hideable(NOTHING, "", "", ""), ())


class Subject(Protocol):
    """Logs in which causes can be hidden."""

    noise: Array
    """(n,) root mean square of what their own diagnosis leaves, of torques or angles."""
    whole: Array
    """(n,) root mean square of the torque or the motion."""

    def why_not(self, what: Hideable, j: int) -> str:
        """Return why a cause cannot show on a joint (from 0), or nothing."""

    def size(self, job: CauseJob, target: Array) -> Array:
        """Return the sizes (n,) that change torques or angles by root mean squares (n,); or 0."""

    def run(self, job: CauseJob, size: Array, rng: np.random.Generator) -> RehearsalRun:
        """Hide a cause of sizes (n,), diagnose the log, and return what is named."""


def jobs_of(subject: Subject, causes: Iterable[Hideable]) -> list[CauseJob]:
    """Return the jobs of causes, in their order."""
    jobs = []
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


def judge(job: CauseJob, row: int, run: RehearsalRun) -> tuple[str, list[str], str]:
    """Return the verdict of a run on a joint (from 1; 0: the arm), false causes, and why not found.

    Named falsely is every cause that was not hidden: anywhere on the arm if the hidden cause acts
    on all joints' torques, else on this joint.
    """
    what, everywhere = job.what, job.what.arm_wide or job.what.coupled
    alike: list[str] | None = None
    false: list[str] = []
    for name, joints, confused_with in run["named"]:
        if name in (what.name, *what.part_of) and (what.arm_wide or row in joints):
            alike = [x for x in confused_with if x != what.name]
            others = [j for j in joints if what.coupled and j != row]
            false += [f"{name} of {joints_text(others)}"] * bool(others)
        elif name not in what.expected and (everywhere or row in joints):
            false.append(f"{name} of {joints_text(joints)}" if everywhere else name)
    if alike is None and what.name in run["minor"]:
        return MISSED, false, "named among the minor causes only"
    if false:
        named = listed(false)
        why = f"named {named} instead" if alike is None else f"named, but {named} too"
        return MISSED, false, why
    if alike is None:
        return MISSED, false, "nothing is named"
    if alike:
        return CONFUSED, false, f"these data cannot tell it from {listed(alike)}"
    return FOUND, false, ""


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


def surrogate(x: Array, rng: np.random.Generator) -> Array:
    """Return noise (K, n) with the spectra and the cross-spectra of ``x`` (K, n).

    Phases are random (D. Prichard, J. Theiler, "Generating surrogate data for time series with
    several simultaneously measured variables", 1994), so that nothing follows the motion.
    """
    waves = np.fft.rfft(x, axis=0)
    phases = rng.uniform(-np.pi, np.pi, (len(waves), 1))
    return np.asarray(np.fft.irfft(waves * np.exp(1j * phases), len(x), axis=0))
