"""Jobs of a rehearsal: causes to hide, their sizes, and whether a run found them."""

from dataclasses import KW_ONLY, dataclass
from typing import Any, TypedDict

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.reporting.markdown import joints as joints_text
from stiction_envs.reporting.markdown import listed

NOTHING = "nothing"
"""Key of the run in which nothing is hidden."""
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


def surrogate(x: Array, rng: np.random.Generator) -> Array:
    """Return noise (K, n) with the spectra and the cross-spectra of ``x`` (K, n).

    Phases are random (D. Prichard, J. Theiler, "Generating surrogate data for time series with
    several simultaneously measured variables", 1994), so that nothing follows the motion.
    """
    waves = np.fft.rfft(x, axis=0)
    phases = rng.uniform(-np.pi, np.pi, (len(waves), 1))
    return np.asarray(np.fft.irfft(waves * np.exp(1j * phases), len(x), axis=0))
