"""Test the model of a diagnosis on logs that took no part in it.

    refuse_unfit(logs, diagnosed, arm)
    check = check_model(diagnosis, logs)

Nothing is fitted here. The check logs are read, corrected and prepared as the diagnosed ones were,
with the same cutoff: the extended model was fitted below it.

A joint is **worse** where the extended model's error exceeds the nominal model's by more than
`WORSE` of it and the added error, √(extended² − nominal²), exceeds the noise floor, or where it is
more than `LARGE` of the joint's torque and of the noise floor. The model **holds** where no joint
is worse.

A cause **does not transfer** where it makes a joint worse: with it the joint's squared error is
larger by more than `HARM` than without it. A cause of several joints with the same coefficients is
judged on all of them together: it fails where Σ log((without² + noise²)/(with² + noise²)) < 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stiction_envs.arrays import Array, Index, rms
from stiction_envs.errors import StictionError
from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.causes.base import ALL_OF_ONE, THE_ARM
from stiction_envs.gap.diagnosis import Diagnosis, model_of
from stiction_envs.gap.judge.judgement import ModelCheck
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.signals.sessions import sessions
from stiction_envs.gap.signals.torque_lag import correct_torques
from stiction_envs.measured.logs.reader import LEAST_SECONDS, JointLog
from stiction_envs.measured.logs.robot_log import RobotLog
from stiction_envs.measured.motion_thresholds import TRAVEL_SPAN
from stiction_envs.reporting.markdown import joints as joint_list
from stiction_envs.robots import Arm

WORSE = 0.05
"""A joint is worse if its error exceeds the nominal one by this part of it [-]; assumed."""
HARM = 0.1
"""Part of a joint's squared error that a cause must add to it [-]; assumed: 5 % of the error, as
`WORSE`."""
LARGE = 0.5
"""Error over a joint's torque, root mean square, from which on no model holds [-]; assumed."""
SEEN = 0.5
"""Least torque of a cause over the noise floor for it to harm a joint [-]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Transfer:
    """One cause on the check logs."""

    name: str
    without: Array
    """(n,) error of the extended model without it [N·m]."""
    harmed: tuple[int, ...]
    """Joints, from 1, that its presence makes worse."""
    fails: bool
    """Whether it does not transfer."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Check(ModelCheck):
    """Both models on joint logs that took no part."""

    logs: tuple[JointLog, ...]
    data: Data
    """The logs against the nominal model."""
    transfers: tuple[Transfer, ...]
    """One per cause of the model, in its order."""
    notes: tuple[str, ...]
    """How the signals of the logs were computed."""

    @property
    def not_transferring(self) -> tuple[str, ...]:
        """See `ModelCheck.not_transferring`."""
        return tuple(x.name for x in self.transfers if x.fails)

    def to_json(self) -> dict[str, object]:
        """Return ``check`` of ``diagnosis.json``."""
        return {**super().to_json(), "cutoff_hz": self.data.recording.cutoff}

    def __str__(self) -> str:
        many = "the log that took no part" if len(self.logs) == 1 else "logs that took no part"
        before, after = self.nominal_rms, self.extended_rms
        if self.worse_joints:
            each = [f"{before[j - 1]:.3g} to {after[j - 1]:.3g}" for j in self.worse_joints]
            worse = joint_list(self.worse_joints)
            text = f"does not hold on {worse}, whose errors go from {', '.join(each)} N·m."
        elif not self.transfers:
            text = f"is the nominal one, whose error there is {before.mean():.3g} N·m"
            text += " (mean of joints)."
        else:
            text = f"holds: error there {before.mean():.3g} N·m without it, {after.mean():.3g} with"
            text += " it (mean of joints)."
        harm = [f"{x.name} ({joint_list(x.harmed)})" for x in self.transfers if x.fails]
        also = f" Not transferring: {', '.join(harm)}." if harm else ""
        return f"On {many} the model {text}{also}"


def refuse_unfit(logs: Sequence[JointLog], diagnosed: Sequence[JointLog], arm: Arm) -> None:
    """Refuse logs that cannot check a model of ``diagnosed`` ones.

    Raises:
        StictionError: logs of another robot, without a joint that moves in both, too short, poses,
            or one that was diagnosed too.
    """
    refuse_diagnosed(logs, diagnosed)
    known = _moved(diagnosed)
    for log in logs:
        where = f"check log {log.source}"
        if log.n != arm.n:
            raise StictionError(f"{where}: {log.n} joints: expected {arm.n}, those of {arm.name}")
        if log.static:
            raise StictionError(f"{where}: poses without time: expected a log of a motion")
        seconds = float(log.t[-1] - log.t[0])
        if seconds < LEAST_SECONDS - 1.5 * log.step:
            raise StictionError(f"{where}: {seconds:.3g} s: expected {LEAST_SECONDS:g} s or more")
        moved = _moved([log])
        if not np.intersect1d(moved, known).size:
            has, took = (joint_list((x + 1).tolist()) for x in (moved, known))
            raise StictionError(
                f"{where}: {has} moves more than {TRAVEL_SPAN:g} rad in it, {took} in the "
                "diagnosed logs: expected one or more that move in both"
            )


def refuse_diagnosed(logs: Sequence[RobotLog], diagnosed: Sequence[RobotLog]) -> None:
    """Raise a StictionError for a log to check with that was diagnosed too."""
    for log in logs:
        if any(np.array_equal(log.q, other.q) for other in diagnosed):
            raise StictionError(
                f"check log {log.source}: it is diagnosed too: expected a log that takes no part"
            )


def _moved(logs: Sequence[JointLog]) -> Index:
    """Return the joints, from 0, that move in some logs."""
    low, high = [log.q.min(axis=0) for log in logs], [log.q.max(axis=0) for log in logs]
    return np.flatnonzero(np.max(high, axis=0) - np.min(low, axis=0) > TRAVEL_SPAN)


def check_model(d: Diagnosis, logs: Sequence[JointLog]) -> Check:
    """Try both models of a diagnosis on logs that took no part.

    Raises:
        StictionError: no segment is long enough for the cutoff of the diagnosis.
    """
    arm, found = d.data.arm, model_of(d)
    cutoff = d.data.recording.cutoff if np.isfinite(d.data.recording.cutoff) else None
    make = partial(prepare, cutoff_hz=cutoff)
    sign, lag, unit = found.torque_sign, found.torque_lag, found.torque_unit
    logs, signals = correct_torques(logs, arm, make, sign, lag, unit)
    shown = d.data.measured if signals.measured is None else d.data.measured & signals.measured
    base = assemble(
        arm,
        replace(signals, sessions=sessions(logs, found.sessions), measured=shown),
        friction=d.baseline.friction,
        torque=d.data.recording.torque,
        of_file=d.baseline.file,
        known_unit=d.baseline.torque_unit,
    )
    nominal = d.baseline.extend(base)
    extended = found.extend(base).nominal
    before, after = rms(nominal.logged_residual), rms(base.tau - extended)
    added = np.sqrt(np.maximum(after**2 - before**2, 0.0))
    worse = (after > (1 + WORSE) * before) & (added > base.noise)
    worse |= after > np.maximum(LARGE * rms(base.tau), base.noise / LARGE)
    return Check(
        logs=tuple(logs),
        data=nominal,
        nominal_rms=before,
        extended_rms=after,
        worse_joints=tuple(int(j) + 1 for j in np.flatnonzero(worse)),
        transfers=_transfers(base, found, d, extended),
        notes=(f"logs that took no part: cutoff {signals.cutoff:.3g} Hz", *signals.notes),
    )


def _transfers(base: Data, found: Nominal, d: Diagnosis, extended: Array) -> tuple[Transfer, ...]:
    """Judge each named cause by the model without its parts, as the module describes."""
    before, out = d.baseline.parts, []
    with_it, noise = rms(base.tau - extended), base.noise
    for name in [c.name for c in (*d.causes, *d.minor)]:
        rest = [p for p in found.parts[len(before) :] if p.cause != name]
        less = replace(found, parts=(*before, *rest)).extend(base).nominal
        without = rms(base.tau - less)
        seen = rms(extended - less) > SEEN * noise
        harmed = np.flatnonzero(seen & (with_it**2 > (1 + HARM) * without**2))
        helps = np.log((without**2 + noise**2) / (with_it**2 + noise**2)).sum() > 0
        as_a_whole = helps and cause_named(name).acts_on in (THE_ARM, ALL_OF_ONE)
        out.append(
            Transfer(
                name=name,
                without=without,
                harmed=tuple(int(j) + 1 for j in harmed),
                fails=bool(harmed.size) and not as_a_whole,
            )
        )
    return tuple(out)
