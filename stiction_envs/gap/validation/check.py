"""Test the model of a diagnosis on logs that took no part in it.

    refuse_unfit(logs, diagnosed, arm, settings)
    check = check_model(diagnosis, logs)

Nothing is fitted here. The check logs go through the same reader, corrections and preparation as
the diagnosed ones, with the cutoff of these: the extended model was fitted below it. Both models
then predict their torque, for the same arm, side of the gear and baseline.

A joint is **worse** where the extended model's error exceeds the nominal model's by more than
`WORSE` of it and the added error, √(extended² − nominal²), exceeds the noise floor. The model
**holds** where no joint is worse.

A cause **does not transfer** where it makes a joint worse. Let p be the torque that its parts add
to the model with all other causes, and e the residual without them. The share a = Σpe/Σpp is one
where p is right and zero where p is unrelated to e; the squared error grows where a < 1/2. The
share must be below a half by more than its scatter between blocks of time (Student's t at
`CHANCE`), p must be at least `LEAST_TORQUE` of the noise floor, and p must add more than `HARM` to
the joint's squared error. A cause that acts on several joints with the same coefficients is judged
on all of them together: it fails where Σ log((without² + noise²)/(with² + noise²)) < 0.

Rows in which a joint rests off its steady friction count little, as in the diagnosis: there the
torque may be anything within the friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from stiction_envs.errors import StictionError
from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import Diagnosis, model_of
from stiction_envs.gap.linear.grams import share_found
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.selection.row_weights import certain
from stiction_envs.gap.settings import GapSettings
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import Signals, prepare
from stiction_envs.gap.signals.sessions import sessions
from stiction_envs.gap.signals.torque_lag import correct_torques
from stiction_envs.gap.signals.torque_sign import inverted, signs
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.measured.logs.timing import LEAST_SECONDS
from stiction_envs.reporting.markdown import joints as joint_list
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
WORSE = 0.05
"""A joint is worse if its error exceeds the nominal one by this part of it [-]; assumed."""
HARM = 0.1
"""Part of a joint's squared error that a cause must add to it [-]; assumed: 5 % of the error, as
`WORSE`."""
SHORTEST_BLOCK = 0.5
"""Least length of a block [s]; assumed: neighbours share noise and friction state."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Transfer:
    """One cause on the check logs."""

    name: str
    torque: Array
    """(n,) root mean square of what it adds to the model [N·m]."""
    without: Array
    """(n,) error of the extended model without it [N·m]."""
    share: Array
    """(n,) part of its torque that the logs show [-]; NaN where it has none."""
    harmed: tuple[int, ...]
    """Joints, from 1, that its presence makes worse."""
    as_a_whole: bool
    """Whether it acts on all of them with the same coefficients, and helps more than it harms."""

    @property
    def fails(self) -> bool:
        """Whether it does not transfer."""
        return bool(self.harmed) and not self.as_a_whole


@dataclass(frozen=True, kw_only=True, eq=False)
class Check:
    """Both models on logs that took no part."""

    logs: tuple[JointLog, ...]
    data: Data
    """The logs against the nominal model."""
    extended: Array
    """(T, n) torque of the extended model along them [N·m]."""
    nominal_rms: Array
    """(n,) [N·m]."""
    extended_rms: Array
    """(n,) [N·m]."""
    noise: Array
    """(n,) noise floor [N·m]."""
    worse_joints: tuple[int, ...]
    """From 1."""
    transfers: tuple[Transfer, ...]
    """One per cause of the model, in its order."""
    notes: tuple[str, ...]
    """How the signals of the logs were computed."""

    @property
    def verdict(self) -> str:
        """``holds`` or ``does not hold``."""
        return "does not hold" if self.worse_joints else "holds"

    @property
    def not_transferring(self) -> tuple[str, ...]:
        """Names of causes whose presence makes a joint worse."""
        return tuple(x.name for x in self.transfers if x.fails)

    def to_json(self) -> dict[str, object]:
        """Return ``check`` of ``diagnosis.json``."""
        return {
            "nominal_rms_nm": self.nominal_rms.tolist(),
            "extended_rms_nm": self.extended_rms.tolist(),
            "verdict": self.verdict,
            "worse_joints": list(self.worse_joints),
            "not_transferring": list(self.not_transferring),
            "cutoff_hz": self.data.cutoff,
        }


def refuse_unfit(
    logs: Sequence[JointLog], diagnosed: Sequence[JointLog], arm: Arm, settings: GapSettings
) -> None:
    """Refuse logs that cannot check a model of ``diagnosed`` ones.

    Raises:
        StictionError: logs of another robot, without a joint that moves in both, too short, poses,
            or one that was diagnosed too.
    """
    least, span = LEAST_SECONDS, settings.motion.travel_span
    reach = _reach(diagnosed)
    known = np.flatnonzero(np.ptp(reach, axis=0) > span)
    for log in logs:
        where = f"check log {log.source}"
        if log.n != arm.n:
            raise StictionError(f"{where}: {log.n} joints: expected {arm.n}, those of {arm.name}")
        if log.static:
            raise StictionError(f"{where}: poses without time: expected a log of a motion")
        seconds = float(log.t[-1] - log.t[0])
        if seconds < least - 1.5 * log.step:
            raise StictionError(f"{where}: {seconds:.3g} s: expected {least:g} s or more")
        if any(np.array_equal(log.q, other.q) for other in diagnosed):
            raise StictionError(f"{where}: it is diagnosed too: expected a log that takes no part")
        _check_limits(where, _reach([log]), reach, arm, span)
        moved = np.flatnonzero(np.ptp(_reach([log]), axis=0) > span)
        if not np.intersect1d(moved, known).size:
            has, took = (joint_list([int(j) + 1 for j in x]) for x in (moved, known))
            raise StictionError(
                f"{where}: {has} moves more than {span:g} rad in it, {took} in the diagnosed logs: "
                "expected one or more that move in both"
            )


def _reach(logs: Sequence[JointLog]) -> Array:
    """Return (2, n) least and largest angles of some logs [rad]."""
    return np.stack(
        [
            np.min([log.q.min(axis=0) for log in logs], axis=0),
            np.max([log.q.max(axis=0) for log in logs], axis=0),
        ]
    )


def _check_limits(where: str, reach: Array, diagnosed: Array, arm: Arm, span: float) -> None:
    """Raise if angles leave the arm's limits where those of the diagnosed logs do not."""
    low, high = arm.limits.position.T
    beyond, before = (np.maximum(low - x[0], x[1] - high) for x in (reach, diagnosed))
    for j in np.flatnonzero((beyond > span) & (before <= span)):
        raise StictionError(
            f"{where}: joint {j + 1} turns from {reach[0, j]:.3g} to {reach[1, j]:.3g} rad: "
            f"expected a log of {arm.name}, which turns from {low[j]:.3g} to {high[j]:.3g} rad"
        )


def check_model(d: Diagnosis, logs: Sequence[JointLog]) -> Check:
    """Try both models of a diagnosis on logs that took no part.

    Raises:
        StictionError: no segment is long enough for the cutoff of the diagnosis.
    """
    (arm, settings), found = (d.data.arm, d.settings), model_of(d)
    cutoff = d.data.cutoff if np.isfinite(d.data.cutoff) else None
    make = partial(prepare, cutoff_hz=cutoff, settings=settings)
    logs, signals = correct_torques(logs, arm, make, settings, known_lag=found.torque_lag)
    logs, signals = _same_sign(d, logs, signals)
    signals = replace(signals, sessions=sessions(logs, found.sessions))
    torque, friction = d.data.recording.torque, d.baseline.friction
    base = assemble(arm, signals, friction=friction, torque=torque, settings=settings)
    nominal = d.baseline.extend(base)
    extended = found.extend(base).nominal
    weight = np.stack([certain(nominal, j) for j in range(arm.n)], axis=1)
    noise = base.noise
    before, after = (_rms(base.tau - x, weight) for x in (nominal.nominal, extended))
    added = np.sqrt(np.maximum(after**2 - before**2, 0.0))
    worse = (after > (1 + WORSE) * before) & (added > noise)
    return Check(
        logs=tuple(logs),
        data=nominal,
        extended=extended,
        nominal_rms=before,
        extended_rms=after,
        noise=noise,
        worse_joints=tuple(int(j) + 1 for j in np.flatnonzero(worse)),
        transfers=_transfers(base, found, d.baseline, extended, weight),
        notes=(f"logs that took no part: cutoff {signals.cutoff_hz:.3g} Hz", *signals.notes),
    )


def _same_sign(
    d: Diagnosis, logs: list[JointLog], signals: Signals
) -> tuple[list[JointLog], Signals]:
    """Return logs and signals with the sign of the diagnosed ones, where they do not show it."""

    def turned(logs: Sequence[JointLog]) -> bool:
        return any(c.kind == "sign" for x in logs for c in x.corrections)

    silent = not any(s.vote for s in signs(signals, d.data.arm, d.settings))
    if not turned(d.logs) or turned(logs) or not silent:
        return logs, signals
    text = "torques inverted as those of the diagnosed logs were: these logs do not show the sign"
    return inverted(logs, signals, text)


def _rms(error: Array, weight: Array) -> Array:
    """Return (n,) root mean square of (T, n) with weights of the rows."""
    return np.asarray(np.sqrt((weight * error**2).sum(axis=0) / weight.sum(axis=0)))


def _transfers(
    base: Data, found: Nominal, baseline: Nominal, extended: Array, weight: Array
) -> tuple[Transfer, ...]:
    """Judge each cause by the model without its parts, as the module describes."""
    new = found.parts[len(baseline.parts) :]
    names = list(dict.fromkeys(p.cause for p in new))
    block = blocks(base)
    count, out = int(block.max()) + 1, []
    own = base.settings.selection
    limit = float(student.ppf(1 - own.chance, count - 1)) if count > 1 else np.inf
    for name in names:
        rest = [p for p in new if p.cause != name]
        less = replace(found, parts=(*baseline.parts, *rest)).extend(base).nominal
        p, e = extended - less, base.tau - less
        pe, pp, ee = (_sums(weight * x, block, count) for x in (p * e, p * p, e * e))
        share, error = share_found(pe, pp)
        torque = np.sqrt(pp.sum(axis=0) / weight.sum(axis=0))
        before = ee.sum(axis=0)
        grown = before - 2 * pe.sum(axis=0) + pp.sum(axis=0)
        harmed = (
            (share + limit * error < 0.5)
            & (torque > own.least_torque * base.noise)
            & (grown > (1 + HARM) * before)
        )
        cause = cause_named(name)
        with_it, without = (np.maximum(x, 0) / weight.sum(axis=0) for x in (grown, before))
        helps = np.log((without + base.noise**2) / (with_it + base.noise**2)).sum() > 0
        out.append(
            Transfer(
                name=name,
                torque=torque,
                without=np.sqrt(without),
                share=share,
                harmed=tuple(int(j) + 1 for j in np.flatnonzero(harmed)),
                as_a_whole=bool(helps) and (cause.arm_wide or cause.coupled),
            )
        )
    return tuple(out)


def blocks(data: Data) -> NDArray[np.int64]:
    """Return (T,) number of the block of each row: equal spans of each log, none too short.

    Nothing is fitted, so that no guard is needed between them.
    """
    out, first = np.zeros(len(data.t), dtype=np.int64), 0
    for log in np.unique(data.recording.log):
        rows = np.flatnonzero(data.recording.log == log)
        most = data.settings.recording.blocks
        many = int(np.clip(len(rows) * data.dt / SHORTEST_BLOCK, 1, most))
        out[rows] = first + np.arange(len(rows)) * many // len(rows)
        first += many
    return out


def _sums(x: Array, block: NDArray[np.int64], count: int) -> Array:
    """Return (B, n) sums of (T, n) over blocks."""
    out = np.zeros((count, x.shape[1]))
    np.add.at(out, block, x)
    return out


def describe(check: Check) -> str:
    """Return the verdict in a sentence or two."""
    many = "the log that took no part" if len(check.logs) == 1 else "logs that took no part"
    before, after = check.nominal_rms, check.extended_rms
    if check.worse_joints:
        each = ", ".join(f"{before[j - 1]:.3g} to {after[j - 1]:.3g}" for j in check.worse_joints)
        text = f"does not hold on {joint_list(check.worse_joints)}, where errors rise ({each} N·m)"
    elif not check.transfers:
        text = f"is the nominal one, whose error there is {before.mean():.3g} N·m"
    else:
        text = f"holds: error there {before.mean():.3g} N·m without it, {after.mean():.3g} with it"
    text = f"On {many} the model {text}" + ("." if check.worse_joints else " (mean of joints).")
    harm = [f"{x.name} ({joint_list(x.harmed)})" for x in check.transfers if x.fails]
    if harm:
        text += f" Not transferring: {', '.join(harm)}."
    return text
