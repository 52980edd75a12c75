"""What a simulation gets wrong, found in tables of breakaway torques.

    diagnosis = diagnose_tables(base, rows, load_arm("panda"), load_friction("panda"))
    print(diagnosis.verdict)
    for cause in diagnosis.causes:
        print(cause.name, cause.joints, cause.parameters, cause.evidence, cause.confused_with)

Hypotheses of the causes (`gap.tables.causes`) are accepted one by one, as long as their gain on
held-out blocks is significant, the largest gain first. Causes that would have predicted the
held-out blocks as well are named in `confused_with`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from stiction_envs.errors import StictionError
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.gap.judge.judgement import NamedCause, percent_lost
from stiction_envs.gap.tables.causes import (
    Hypothesis,
    TableCause,
    registered,
    what_tells_apart,
)
from stiction_envs.gap.tables.causes.base import BASE_AGAIN
from stiction_envs.gap.tables.causes.corrupted_cell import CorruptedCell
from stiction_envs.gap.tables.found import TableDiagnosis, parameters_of
from stiction_envs.gap.tables.model import Fit, Model
from stiction_envs.gap.tables.readings import Readings
from stiction_envs.gap.tables.settings import TableSettings, table_settings
from stiction_envs.gap.tables.whole_arm import WholeArm
from stiction_envs.measured import BaseTable, DitheredRow
from stiction_envs.method_settings import Changes, override
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
MOST_CAUSES = 12
"""Largest number of accepted hypotheses; assumed."""
RIVAL = 0.6
"""Least gain of a rival that is simulated with the whole arm too, over the best gain [-];
assumed."""
ALIKE = 0.1
"""Difference of two equally good gains over the gain [-]; assumed: how well the lone joint follows
the arm."""
MOST_CORRUPTED = 0.05
"""Largest share of corrupted readings; with more the model is wrong, not the readings [-];
assumed."""
MODEL_SD = 0.005
"""Error of the lone joint's level shift, over friction [-]; measured by simulation: 0.003 to 0.008
for the Panda's joints 5 and 7."""
DOUBTFUL = 0.8
"""Part of the setting ``unexplained`` above which a joint is simulated more closely [-];
assumed."""


def diagnose_tables(
    base: BaseTable,
    dithered: Sequence[DitheredRow],
    arm: Arm,
    friction: FrictionParameters | None = None,
    *,
    whole: WholeArm | None = None,
    threads: int = 0,
    progress: Callable[[str], None] | None = None,
    settings: TableSettings | Changes | None = None,
    causes: Sequence[TableCause] | None = None,
) -> TableDiagnosis:
    """Say what a simulation gets wrong about measured breakaway torques.

    Args:
        base: base torques of all joints; only joints with dithered torques are used.
        dithered: torques of some or all joints; days or sets are not distinguished.
        arm: the arm that is simulated.
        friction: nominal parameters of one arm; None for the TOML of that name.
        whole: the arm of an earlier diagnosis, in place of ``friction`` and ``threads``: its
            simulations are not repeated. The result is the same.
        threads: threads of the simulation, 0 for all processors.
        progress: called with a line about the present step.
        settings: constants of the method that differ from ``[tables]`` of ``settings.toml``.
        causes: causes to try; None for all registered ones.

    Raises:
        StictionError: tables of another arm, or unknown settings.
    """
    if base.n_joints != arm.n:
        raise StictionError(f"base table of {base.n_joints} joints, but {arm.name} has {arm.n}")
    wrong = [x.joint for x in dithered if not 1 <= x.joint <= arm.n]
    if wrong:
        raise StictionError(f"dithered torque of joint {wrong[0]}, but {arm.name} has {arm.n}")
    if whole is None:
        if friction is None:
            friction = load_friction(arm.registered_name, arm.n)
        whole = WholeArm(arm, friction, threads=threads)
    chosen = override(table_settings(), settings)
    say = progress or (lambda _: None)
    readings = Readings(base, dithered)
    joints = tuple(readings.joints)
    if len(readings.blocks) - 1 < chosen.verdict.least_blocks:
        return _cannot_tell(
            arm.name, joints, f"{max(0, len(readings.blocks) - 1)} frequencies and scales of "
            f"dithered torques: at least {chosen.verdict.least_blocks} are needed to hold one out"
        )  # fmt: skip
    say("simulating the nominal arm")
    tried = registered() if causes is None else causes
    nominal = Model(readings, whole, base, tried, chosen)
    if not np.isfinite(nominal.noise).all():
        bad = sorted({int(j) for j in readings.joint[~np.isfinite(nominal.noise)]})
        return _cannot_tell(arm.name, joints, f"too few dithered torques of joints {bad}")
    model = _select(nominal, say)
    bad_readings = _corrupted(model)
    poor = _unexplained(model, bad_readings, DOUBTFUL)
    if poor:
        say(f"simulating joints {', '.join(map(str, poor))} at more values")
        nominal.anchor(poor)
        model = _select(nominal, say)
        bad_readings = _corrupted(model)
    say("looking for what else could have been it")
    return _report(arm.name, nominal, model, bad_readings)


def _cannot_tell(robot: str, joints: tuple[int, ...], reason: str) -> TableDiagnosis:
    nothing = np.full(len(joints), np.nan)
    return TableDiagnosis(
        robot=robot,
        verdict="cannot tell",
        joints=joints,
        nominal=nothing,
        extended=nothing,
        noise_floor=nothing,
        reason=reason,
    )


def _select(model: Model, say: Callable[[str], None]) -> Model:
    """Accept hypotheses while the best one's held-out gain is significant."""
    refused: set[Hypothesis] = set()
    s = model.settings.verdict
    for _ in range(MOST_CAUSES):
        null = _losses(model)
        fits = _fits(model, null, refused, s.least_gain)
        if not fits or fits[0][0] < s.least_gain:
            break
        best = fits[0]
        say(f"trying {best[1].hypothesis.name} on joints {best[1].hypothesis.joints}")
        gain, chosen = _arbitrate(model, null, fits)
        if gain < s.least_gain:
            refused.add(best[1].hypothesis)
            continue
        model = chosen
        model.set_noise()
        for h in list(model.values)[:-1]:
            if _lost(model, h) < s.least_gain:
                model.drop([h])
                refused.add(h)
    return model


def _losses(model: Model) -> dict[int, float]:
    """Return the held-out loss of each joint with the present values [nats]."""
    return {j: model.held((j,), refitted=False) for j in model.readings.joints}


def _fits(
    model: Model, null: Mapping[int, float], refused: set[Hypothesis], enough: float
) -> list[tuple[float, Fit]]:
    """Return held-out gains [nats] of further hypotheses, best first; −inf for too little."""
    out = []
    for h in model.hypotheses():
        if h in refused:
            continue
        fit = model.fit(h, enough=enough)
        out.append((sum(null[j] for j in h.joints) - fit.held, fit))
    return sorted(out, key=lambda pair: -pair[0])


def _arbitrate(
    model: Model, null: Mapping[int, float], fits: list[tuple[float, Fit]]
) -> tuple[float, Model]:
    """Return gain [nats] and model of the best hypothesis, after simulations of its rivals."""
    best_gain, best = fits[0]
    rivals = [best] + [
        f
        for g, f in fits[1:]
        if g > RIVAL * best_gain
        and set(f.hypothesis.joints) & set(best.hypothesis.joints)
        and (f.hypothesis.cause.quantity or best.hypothesis.cause.quantity)
    ]
    tried = []
    for fit in rivals[:3]:
        h = fit.hypothesis
        trial = model.copy()
        held = trial.accept(h, fit.x).held
        tried.append((sum(null[j] for j in h.joints) - held, trial))
    return max(tried, key=lambda pair: pair[0])


def _lost(model: Model, h: Hypothesis) -> float:
    """Return the held-out gain that is lost without a hypothesis [nats]."""
    without, full = (m.held(h.joints, refitted=True) for m in (_without(model, [h]), model))
    return without - full


def _without(model: Model, some: Sequence[Hypothesis]) -> Model:
    new = model.copy()
    new.drop(some)
    return new


def _corrupted(model: Model) -> list[int]:
    """Return the readings that no cause explains, the worst first."""
    r, z, s = model.readings, model.left_over(), model.settings.verdict
    error = z * model.noise
    found = []
    for i in np.flatnonzero((np.abs(z) > s.corrupted_sd) & (np.abs(error) > s.corrupted)):
        rest = error[i]
        block = (r.joint == r.joint[i]) & (r.block == r.block[i])
        for others in (r.of([r.all[i].where]), block):
            others[i] = False
            if others.any():
                # an error of the whole configuration or block is no bad reading
                rest = min(rest, error[i] - np.median(error[others]), key=abs)
        if abs(rest) > max(s.corrupted, s.corrupted_sd * model.noise[i]):
            found.append(int(i))
    if len(found) > max(1, MOST_CORRUPTED * len(z)):
        return []
    return sorted(found, key=lambda i: -abs(z[i]))


def _report(robot: str, nominal: Model, model: Model, bad: list[int]) -> TableDiagnosis:
    r = model.readings
    before, after = _errors(nominal, []), _errors(model, bad)
    groups: dict[tuple[str, tuple[int, ...]], list[Hypothesis]] = {}
    for h in model.values:
        groups.setdefault((h.name, h.joints), []).append(h)
    causes = []
    for (name, joints), some in groups.items():
        without = _without(model, some)
        fits = [model.fit(h) for h in some]
        lost = without.held(joints, refitted=True) - model.held(joints, refitted=True)
        values = [model.values[h] for h in some]
        cause = some[0].cause
        confused = _confused(name, joints, some, lost, without)
        causes.append(
            NamedCause(
                name=name,
                joints=joints,
                parameters={0 if len(joints) > 1 else joints[0]: parameters_of(fits, model.data)},
                gain_percent=percent_lost(_errors(without, bad), after, before),
                evidence=cause.evidence(some, values, model.comparison(without)),
                confused_with=tuple(confused),
                told_apart_by=confused,
            )
        )
    for i in bad:
        others = [k for k in bad if k != i]
        confused = {"base_drift": BASE_AGAIN} if r.base[i] else {}
        causes.append(
            NamedCause(
                name=CorruptedCell.name,
                joints=(int(r.joint[i]),),
                parameters={int(r.joint[i]): {}},
                gain_percent=percent_lost(_errors(model, others), after, before),
                evidence=CorruptedCell().describe(i, model.comparison(model)),
                confused_with=tuple(confused),
                told_apart_by=confused,
            )
        )
    verdict, reason = _verdict(model, bad, bool(causes))
    return TableDiagnosis(
        robot=robot,
        verdict=verdict,
        causes=tuple(sorted(causes, key=lambda c: -c.gain_percent)),
        joints=tuple(r.joints),
        nominal=before,
        extended=after,
        noise_floor=np.array([100 * model.noise[r.of_joints([j])].min() for j in r.joints]),
        reason=reason,
    )


def _errors(model: Model, bad: list[int]) -> Array:
    """Return the mean held-out |error| of each joint over its friction [%], no bad readings."""
    error = np.abs(model.left_out_residual())
    good = np.ones(len(error), dtype=bool)
    good[bad] = False
    r = model.readings
    return np.array([100 * error[(r.joint == j) & good].mean() for j in r.joints])


def _confused(
    name: str,
    joints: tuple[int, ...],
    some: list[Hypothesis],
    gain: float,
    without: Model,
) -> dict[str, str]:
    """Return causes that predict the held-out blocks as well, and what distinguishes them."""
    null = _losses(without)
    s = without.settings.verdict
    least = gain - max(s.alike_nats, ALIKE * gain)
    # small gains on several joints may add up
    enough = 1.0 if len(joints) > 1 else max(least, 1.0)
    best: dict[str, dict[tuple[int, ...], float]] = {}
    for g, fit in _fits(without, null, set(some), enough):
        h = fit.hypothesis
        if h.name == name or not set(h.joints) & set(joints):
            continue
        known = best.setdefault(h.name, {})
        if h.joints in known:
            continue
        if h.cause.quantity and g > RIVAL * gain and len(joints) == len(h.joints):
            trial = without.copy()
            g = sum(null[j] for j in h.joints) - trial.accept(h, fit.x).held
        known[h.joints] = g
    out = {}
    for other, gains in best.items():
        # one hypothesis per joint is compared with one about all joints
        each = [max(g, 0.0) for g in gains.values()]
        total = sum(each) if len(joints) > 1 else max(each)
        if total >= least:
            out[other] = what_tells_apart(name, other)
    return out | {x: what_tells_apart(name, x) for x in some[0].cause.indistinguishable_from(some)}


def _verdict(model: Model, bad: list[int], any_cause: bool) -> tuple[str, str]:
    """Return the verdict, and what remains unexplained."""
    poor = _unexplained(model, bad)
    if not poor:
        return ("explained" if any_cause else "no discrepancy"), ""
    reason = "; ".join(
        f"joint {j}: the remaining error is {np.sqrt(size):.1f} times the noise, and no known "
        "cause predicts it"
        for j, size in poor.items()
    )
    return ("partly explained" if any_cause else "cannot tell"), reason


def _unexplained(model: Model, bad: list[int], share: float = 1.0) -> dict[int, float]:
    """Return the mean square of the residual over noise, of joints where it is too large."""
    r, s = model.readings, model.settings.verdict
    # the difference of lone joint and whole arm is not a cause
    z = model.left_over() * model.noise / np.hypot(model.noise, MODEL_SD)
    good = np.ones(len(z), dtype=bool)
    good[bad] = False
    out = {}
    for j in r.joints:
        mine = good & (r.joint == j)
        size = float(np.minimum(z[mine] ** 2, 9.0).mean())
        # a common error of a block has a cause that is unknown here
        blocks = [z[mine & (r.block == b)] for b in np.unique(r.block[mine])]
        common = float(np.mean([b.mean() ** 2 * len(b) for b in blocks]))
        by_chance = float(chi2.ppf(0.999, len(blocks))) / len(blocks)
        if size > share * s.unexplained or common > share * max(s.unexplained, by_chance):
            out[j] = max(size, common)
    return out
