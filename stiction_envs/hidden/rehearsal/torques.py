"""Causes hidden in joint logs: which, on which joints, at which sizes, and a diagnosis of them."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.causes import Cause
from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.hidden.rehearsal.effects import REPLAYED, dry_friction, effect_of
from stiction_envs.hidden.rehearsal.jobs import NO_JOB, NOTHING, Hideable, Job, Run
from stiction_envs.hidden.rehearsal.replay import Replay
from stiction_envs.hidden.rehearsal.runs import LARGE_NOISE, LARGE_SHARE

Array = NDArray[np.float64]
CLOSE = 0.03
"""Relative error of a size [-]; assumed."""
STEPS = 8
"""Most steps in which a size is found; assumed: the torque is nearly proportional to it."""
NO_TORQUE = 1e-6
"""Torque over the noise that is none [-]; assumed."""
NO_SIZE = 1e-6
"""Part of a small size that is none [-]; assumed."""


def hideable(cause: Cause) -> Hideable:
    """Return how the rows of a cause of joint logs call it."""
    law, first = REPLAYED.get(cause.name), cause.parameters[0]
    return Hideable(
        name=cause.name,
        parameter=(law.parameter if law else "") or first.name,
        unit=first.unit,
        what_to_record=cause.what_to_record,
        expected=law.expected if law else (),
        arm_wide=cause.arm_wide,
        coupled=cause.coupled,
    )


def jobs_of(
    own: Diagnosis, causes: Sequence[Cause]
) -> tuple[list[Job], list[tuple[Hideable, int, str]]]:
    """Return the jobs, and the causes on joints (from 1; 0: the arm) that are in none, and why."""
    jobs, reasons = [NO_JOB], []
    for cause in causes:
        what, joints = hideable(cause), range(own.data.n)
        if cause.arm_wide:
            why = cause.why_not_identifiable(own.data, 0) or _lawless(cause)
            if why:
                reasons.append((what, 0, why))
            else:
                jobs.append(Job(what=what, joints=tuple(joints)))
            continue
        why_not = {j: cause.why_not_identifiable(own.data, j) or _lawless(cause) for j in joints}
        reasons += [(what, j + 1, why) for j, why in why_not.items() if why]
        left = tuple(j for j, why in why_not.items() if not why)
        if cause.coupled:
            jobs += [Job(what=what, joints=(j,)) for j in left]
        elif left:
            jobs.append(Job(what=what, joints=left))
    return jobs, reasons


def _lawless(cause: Cause) -> str:
    """Return that a cause of another package cannot be hidden, or nothing."""
    if cause.name in REPLAYED or (cause.is_linear and not cause.coupled):
        return ""
    return "no law is known by which to hide it"


@dataclass(frozen=True, kw_only=True, eq=False)
class HiddenTorques:
    """Torques that are hidden along the motion of joint logs."""

    replay: Replay

    def sizes(self, job: Job) -> tuple[Array, Array, Array]:
        """See `runs.Subject`."""
        replay = self.replay
        whole = np.sqrt(np.mean(np.square(replay.data.nominal), axis=0))
        small = self._size(job, replay.noise)
        large = self._size(job, np.maximum(LARGE_NOISE * replay.noise, LARGE_SHARE * whole))
        return small, np.sqrt(small * large), large

    def _size(self, job: Job, target: Array) -> Array:
        """Return (n,) sizes with torques of a root mean square (n,) [N·m]; 0 where there is none.

        Of a cause that all joints show, one joint reaches its target, and the others do not. Sizes
        end at the largest.
        """
        replay, effect = self.replay, effect_of(job.cause)
        size = np.zeros(replay.data.n)
        size[list(job.joints)] = effect.start
        always = effect.torque(replay, NO_SIZE * size) if effect.comes_with else 0.0
        for _ in range(STEPS):
            torque = replay.in_band(effect.torque(replay, size) - always)
            ratio = np.sqrt(np.mean(np.square(torque), axis=0)) / target
            if job.what.coupled or job.what.arm_wide:
                ratio = np.full_like(ratio, ratio.max())
            size = np.where(ratio > NO_TORQUE, size, 0.0)
            before = size
            size = np.minimum(size / np.maximum(ratio, NO_TORQUE), effect.largest)
            if np.allclose(size, before, rtol=CLOSE):
                break
        return size

    def run(self, job: Job, size: Array, seed: int, number: int) -> Run:
        """See `runs.Subject`."""
        replay = self.replay
        hidden, sizes = np.zeros_like(replay.data.q), {}
        if job.cause != NOTHING:
            effect = effect_of(job.cause)
            hidden = hidden + effect.torque(replay, size)
            if effect.on_friction:
                hidden = hidden + dry_friction(replay, replay.unknown_friction)
            shown = effect.shown(replay, size)
            at = {0: 0} if job.what.arm_wide else {j + 1: j for j in job.joints}
            sizes = {str(row): float(shown[j]) for row, j in at.items() if size[j] > 0}
        logs = replay.logs(hidden, [seed, zlib.crc32(job.key.encode()), number])
        said = replay.diagnose(logs, seed)
        named = [[c.name, list(c.joints), list(c.confused_with)] for c in said.causes]
        return {"sizes": sizes, "named": named, "minor": [c.name for c in said.minor]}
