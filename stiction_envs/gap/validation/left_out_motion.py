"""Leave out one motion: fit the coefficients to the other logs, and predict the one left out.

Blocks of one log share its motion. Coefficients that fit a motion rather than the arm predict
held-out blocks well, and other motions badly. The causes are those of the fit to all logs; this
test judges their coefficients. Poses at rest are a motion of their own.

The other logs hardly determine some coefficients: friction of a joint that moves in one log only,
the inertia of a payload that they move slowly. With N the normal equations of all logs and M those
of the others, the directions v of M v = λ N v are independent in both. A direction stays at zero
where the others' estimate is not significant by its scatter between blocks (jackknife), or depends
on a single block. A cause is judged on a motion where at least half of its torque is determined by
the others and is larger than the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.stats import t as student

from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.gap.linear.bounded_fit import RIDGE, solve
from stiction_envs.gap.linear.grams import share_found
from stiction_envs.gap.linear.model_columns import of_joints
from stiction_envs.gap.selection.candidates import Candidate, RegressorLibrary
from stiction_envs.gap.validation.check import HARM

Array = NDArray[np.float64]
SINGLE_BLOCK = 0.05
"""Part of the information on coefficients that must lie outside any one block for them to be
predicted on a motion that is left out [-]; assumed."""
KNOWN = 0.5
"""Part of a cause's torque on a motion, root mean square, that the others must know for it to be
judged there [-]; assumed."""
INFORMED = 1e-6
"""Part of all motions' information below which there is only rounding [-]; assumed."""
STIFF = 1e3
"""Weight of the prior on what other motions do not show, over all motions' information [-];
assumed."""
TRANSFERS, HARMS, UNCLEAR, ONE_MOTION = (
    *("transfers", "does not transfer", "cannot tell"),
    "one motion shows it",
)


@dataclass(frozen=True, kw_only=True)
class CauseElsewhere:
    """One cause on one joint, on motions to which its coefficients were not fitted."""

    name: str
    joint: int
    """From 1."""
    motions: tuple[str, ...]
    """Names of those it is judged on."""
    without_nm: float
    """Error there without it, root mean square [N·m]; NaN where it is judged on none."""
    with_nm: float
    """The same with it [N·m]."""
    share: float
    """Part of its torque that the motions show [-]."""
    verdict: str
    """``transfers``, ``does not transfer``, ``cannot tell`` or ``one motion shows it``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeftOutMotion:
    """Every motion, predicted by the fit to the others."""

    motions: tuple[str, ...]
    """Names of the logs."""
    nominal: Array
    """(L, n) error of the nominal model on each [N·m]; NaN for a log without rows in blocks."""
    extended: Array
    """(L, n) the same of the extended model, coefficients from the others [N·m]."""
    nominal_rms: Array
    """(n,) over all [N·m]."""
    extended_rms: Array
    """(n,) over all [N·m]."""
    causes: tuple[CauseElsewhere, ...]

    def to_json(self) -> dict[str, object]:
        """Return ``left_out_motion`` of ``diagnosis.json``."""
        return {
            "motions": list(self.motions),
            "nominal_rms_nm": self.nominal_rms.tolist(),
            "extended_rms_nm": self.extended_rms.tolist(),
            "causes": [
                {
                    "name": c.name,
                    "joint": c.joint,
                    "judged_on": list(c.motions),
                    "without_nm": c.without_nm if c.motions else None,
                    "with_nm": c.with_nm if c.motions else None,
                    "verdict": c.verdict,
                }
                for c in self.causes
            ],
        }


def leave_out_motions(d: Diagnosis) -> LeftOutMotion | None:
    """Return the errors on each log with the fit to the others; None for a single log."""
    library, grams = d.library, d.library.grams
    log_of = _log_of_blocks(library)
    numbers = np.unique(log_of)
    if len(numbers) < 2:
        return None
    names = list(dict.fromkeys(t.cause for t in d.terms if not t.small))
    shape = (len(grams.joints), grams.blocks)
    errors, sums = np.zeros((2, *shape)), np.zeros((len(names), 3, *shape))
    judged = np.zeros((len(names), *shape), dtype=bool)
    none = np.zeros_like(d.coefficients)
    count = np.stack([g.count for g in grams.joints])
    for log in numbers:
        mine = log_of == log
        others = (~mine).astype(float)
        c, known = _fit(d, d.terms, others)
        errors[0][:, mine] = _sums(library, d.terms, none, none)[2][:, mine]
        errors[1][:, mine] = _sums(library, d.terms, c, none)[2][:, mine]
        for i, name in enumerate(names):
            own = library.own(d.terms, _named(d, name))
            rest = none.copy()
            rest[~own], _ = _fit(d, [t for t in d.terms if t not in _named(d, name)], others)
            sums[i][:, :, mine] = _sums(library, d.terms, rest, c - rest)[:, :, mine]
            part, whole = (
                _sums(library, d.terms, none, x * own)[1][:, mine].sum(axis=1)
                for x in (known, d.coefficients)
            )
            seen = whole > d.settings.selection.least_torque**2 * count[:, mine].sum(axis=1)
            judged[i][:, mine] = ((part >= KNOWN**2 * whole) & seen)[:, None]
    titles = [Path(d.logs[k].source).name for k in numbers]
    noise, total = d.data.noise, count.sum(axis=1)
    nominal_rms, extended_rms = (np.sqrt(e.sum(axis=1) / total) * noise for e in errors)
    by_log = (log_of[:, None] == numbers).astype(float)
    with np.errstate(invalid="ignore"):
        each = np.sqrt((errors @ by_log) / (count @ by_log)) * noise[:, None]
    return LeftOutMotion(
        motions=tuple(titles),
        nominal=each[0].T,
        extended=each[1].T,
        nominal_rms=nominal_rms,
        extended_rms=extended_rms,
        causes=tuple(
            _judged(d, name, j, sums[i, :, j], judged[i, j], log_of, titles)
            for i, name in enumerate(names)
            for j in _acts_on(d, name)
        ),
    )


def _named(d: Diagnosis, name: str) -> list[Candidate]:
    """Return the terms of a cause, without its small errors on other joints."""
    return [t for t in d.terms if t.cause == name and not t.small]


def _acts_on(d: Diagnosis, name: str) -> list[int]:
    """Return the joints (from 0) on which a cause's torque is larger than the noise."""
    own = d.library.own(d.terms, _named(d, name))
    none = np.zeros_like(d.coefficients)
    size = _sums(d.library, d.terms, none, d.coefficients * own)[1].sum(axis=1)
    count = np.array([g.count.sum() for g in d.library.grams.joints])
    torque = np.sqrt(size / np.maximum(count, 1))
    return [int(j) for j in np.flatnonzero(torque > d.settings.selection.least_torque)]


def _judged(
    d: Diagnosis,
    name: str,
    joint: int,
    sums: Array,
    on: NDArray[np.bool_],
    log_of: NDArray[np.int64],
    titles: Sequence[str],
) -> CauseElsewhere:
    """Return whether a cause on a joint predicts the blocks (B,) on which it is judged."""
    noise = float(d.data.noise[joint])
    pe, pp, ee = sums[:, on]
    numbers = np.unique(log_of)
    motions = tuple(titles[int(k)] for k in np.flatnonzero(np.isin(numbers, log_of[on])))
    without = with_it = share = float("nan")
    verdict = ONE_MOTION
    if motions and pp.sum() > 0:
        count = max(float(d.library.grams.joints[joint].count[on].sum()), 1e-300)
        before = float(ee.sum())
        grown = max(before - 2 * float(pe.sum()) + float(pp.sum()), 0.0)
        without, with_it = (float(np.sqrt(x / count) * noise) for x in (before, grown))
        a, error = (float(x[0]) for x in share_found(pe[:, None], pp[:, None]))
        room = float(student.ppf(1 - d.settings.selection.chance, max(len(pe) - 1, 1))) * error
        share, verdict = a, UNCLEAR
        if a + room < 0.5 and grown > (1 + HARM) * before:
            verdict = HARMS
        elif a - room > 0.5:
            verdict = TRANSFERS
    return CauseElsewhere(
        name=name,
        joint=joint + 1,
        motions=motions,
        without_nm=without,
        with_nm=with_it,
        share=share,
        verdict=verdict,
    )


def _log_of_blocks(library: RegressorLibrary) -> NDArray[np.int64]:
    """Return (B,) number of each block's log."""
    recording = library.data.recording
    kept = recording.block >= 0
    out = np.full(library.grams.blocks, -1, dtype=np.int64)
    out[recording.block[kept]] = recording.log[kept]
    return out


def _fit(d: Diagnosis, terms: Sequence[Candidate], weight: Array) -> tuple[Array, Array]:
    """Return coefficients (P,) from weighted blocks (B,), and those of all blocks that they show.

    A stiff prior holds directions that the blocks do not show at zero; bounds are unchanged.
    """
    if not terms:
        return np.zeros(0), np.zeros(0)
    grams, model = d.library.grams, d.library.model_columns(terms)
    xx, xr = grams.system(model, weight)
    whole, _ = grams.system(model)
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    across = np.outer(scale, scale)
    metric = whole / across + RIDGE * np.eye(len(xr))
    share, v = eigh(xx / across, metric)
    informed, share = share > INFORMED, np.maximum(share, INFORMED)
    value = np.where(informed, v.T @ (xr / scale) / share, 0.0)
    # a block's part of the information, and the change of the estimate when it is left out
    some = np.flatnonzero(weight > 0)
    blocks_xx, blocks_xr = (x[some] for x in grams.block_systems(model))
    directions = v / scale[:, None]
    each, along = directions.T @ blocks_xx @ directions, blocks_xr @ directions
    part = np.minimum(np.einsum("bii->bi", each) / share, 1.0)
    moved = (along - each @ value) / (share * np.maximum(1 - part, SINGLE_BLOCK))
    spread = np.sqrt(np.square(moved).sum(axis=0) * len(some) / max(len(some) - 1, 1))
    limit = float(student.ppf(1 - d.settings.selection.chance / 2, max(len(some) - 1, 1)))
    known = informed & (np.abs(value) > limit * spread) & (part.max(axis=0) < 1 - SINGLE_BLOCK)
    unknown = metric @ v[:, ~known]
    held = xx + STIFF * across * (unknown @ unknown.T)
    c = solve(held, xr, np.array(model.low), np.array(model.high))
    best = grams.fit(model) * scale
    return c, np.asarray(v[:, known] @ (v[:, known].T @ metric @ best) / scale)


def _sums(
    library: RegressorLibrary, terms: Sequence[Candidate], before: Array, more: Array
) -> Array:
    """Return Σpe, Σpp and Σee (3, joints, B) in units of noise variance.

    e is what coefficients ``before`` (P,) leave, p the torque of ``more`` (P,).
    """
    model = library.model_columns(terms)
    out = np.zeros((3, len(library.grams.joints), library.grams.blocks))
    out[2] = [gram.rr for gram in library.grams.joints]
    for j, cols, at in of_joints(model):
        gram = library.grams.joints[j]
        xx, xr = gram.xx[:, cols[:, None], cols], gram.xr[:, cols]
        a, c = more[at], before[at]
        out[0, j] = xr @ a - xx @ c @ a
        out[1, j] = xx @ a @ a
        out[2, j] += xx @ c @ c - 2 * xr @ c
    return out
