"""What a simulation gets wrong, found in tables of breakaway torques.

    diagnosis = diagnose_tables(base, rows, load_arm("panda"), load_friction("panda"))
    print(diagnosis.verdict)
    for cause in diagnosis.causes:
        print(cause.name, cause.joints, cause.parameters, cause.nats, cause.rivals)

Causes (`gap.tables.causes`) are named by the evidence of the model with them (`gap.tables.judge`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.gap.judge.judgement import (
    Estimate,
    Judgement,
    NamedCause,
    percent_gained,
    percent_lost,
)
from stiction_envs.gap.predictors.named import ALIKE, MOST_ALIKE, WIDTH
from stiction_envs.gap.tables.causes import TableCause, registered, what_tells_apart
from stiction_envs.gap.tables.causes.base import Hypothesis
from stiction_envs.gap.tables.judge import Fit, Judge
from stiction_envs.gap.tables.predictor import Predictor
from stiction_envs.gap.tables.readings import Readings
from stiction_envs.gap.tables.settings import TableSettings, table_settings
from stiction_envs.gap.tables.whole_arm import WholeArm
from stiction_envs.measured import BaseTable, DitheredRow
from stiction_envs.method_settings import Changes, override
from stiction_envs.reporting.markdown import joints as named
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
UNEXPLAINED = 3.0
"""Log evidence for an error that is common to a frequency and scale above which a joint is not
explained [nats]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TableDiagnosis(Judgement):
    """What the tables show about the simulation."""

    joints: tuple[int, ...]
    """The joints with dithered torques in the tables."""
    nominal: Array
    """Mean |error| of the nominal simulation in each, over the joint's friction [%]."""
    extended: Array
    """The same with the causes, their values fitted without each block in turn [%]."""
    noise_floor: Array
    """Scatter of a reading, over the joint's friction [%]; NaN if unknown."""
    reason: str = ""
    """Why the tables are not, or not fully, explained; empty otherwise."""

    @property
    def gain_percent(self) -> float:
        """See `Judgement.gain_percent`."""
        return percent_gained(self.nominal, self.extended) if self.causes else 0.0

    def to_json(self) -> dict[str, object]:
        """Return the contents of a `diagnosis.json`; joints are strings, NaN is None."""

        def by_joint(values: Array) -> dict[str, float | None]:
            each = zip(self.joints, values.tolist(), strict=True)
            return {str(j): x if math.isfinite(x) else None for j, x in each}

        return {
            "robot": self.robot,
            "verdict": self.verdict,
            "reason": self.reason,
            "joints": list(self.joints),
            "nominal": {"error_percent": by_joint(self.nominal)},
            "extended": {"error_percent": by_joint(self.extended), "cross_fitted": True},
            "noise_floor_percent": by_joint(self.noise_floor),
            "gain_percent": self.gain_percent,
            **self.judged_json(),
        }


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
    blocks = len(readings.blocks) - 1
    if blocks < chosen.least_blocks:
        nothing = np.full(len(joints), np.nan)
        return TableDiagnosis(
            robot=arm.name,
            verdict="cannot tell",
            joints=joints,
            nominal=nothing,
            extended=nothing,
            noise_floor=nothing,
            reason=f"{max(0, blocks)} frequencies and scales of dithered torques: at least "
            f"{chosen.least_blocks} are needed to hold one out",
        )
    say("simulating the nominal arm")
    tried = registered() if causes is None else causes
    quantities = [c.quantity for c in tried if c.quantity is not None]
    predictor = Predictor(readings, whole, base, quantities)
    hypotheses = [h for c in tried for h in c.hypotheses(readings)]
    judge = Judge(predictor, hypotheses, chosen.scatter)
    nominal = judge.fit({})
    best = judge.search(say)
    say("looking for what else could have been it")
    return _report(arm.name, judge, nominal, best)


def _report(robot: str, judge: Judge, nominal: Fit, best: Fit) -> TableDiagnosis:
    r = judge.readings
    # bad readings have no error of the model
    bad = {i for h in best.values if h.cause.separate for i in h.rows}
    before, after = _errors(judge, nominal, set()), _errors(judge, best, bad)
    groups: dict[tuple[object, ...], list[Hypothesis]] = {}
    for h in best.values:
        groups.setdefault((h.name, h.joints, h.rows if h.cause.separate else ()), []).append(h)
    causes = []
    for some in groups.values():
        name, joints, cause = some[0].name, some[0].joints, some[0].cause
        without = judge.fit({h: x for h, x in best.values.items() if h not in some}, best.around)
        still_bad = bad - {i for h in some for i in h.rows} if cause.separate else bad
        rivals = {n: best.score - f.score for n, f in judge.rivals(best, without, some).items()}
        nearest = sorted(rivals.items(), key=lambda x: x[1])
        confused = [n for n, nats in nearest if nats < ALIKE][:MOST_ALIKE]
        causes.append(
            NamedCause(
                name=name,
                joints=joints,
                parameters={0 if len(joints) > 1 else joints[0]: _parameters(judge, best, some)},
                gain_percent=percent_lost(_errors(judge, without, still_bad), after, before),
                nats=best.score - without.score,
                rivals=tuple(nearest),
                evidence=_evidence(judge, best, without, some),
                confused_with=tuple(confused),
                told_apart_by={n: what_tells_apart(name, n) for n in confused},
            )
        )
    verdict, reason = _verdict(judge, best)
    gained = percent_gained(before, after)
    if causes and gained < 0:  # a verdict is earned
        verdict, causes, after = "cannot tell", [], before
        reason = "the likeliest causes predict held-out readings worse than the nominal model"
    return TableDiagnosis(
        robot=robot,
        verdict=verdict,
        causes=tuple(sorted(causes, key=lambda c: -c.gain_percent)),
        shares_percent=dict(named=gained, links=0.0, set_up=0.0, left=100 - gained)
        if causes
        else {},
        not_shown=judge.not_shown(best),
        joints=tuple(r.joints),
        nominal=before,
        extended=after,
        noise_floor=np.array([100 * best.size[j][0] for j in r.joints]),
        reason=reason,
    )


def _errors(judge: Judge, fit: Fit, bad: set[int]) -> Array:
    """Return the mean held-out |error| of each joint over its friction [%], no bad readings."""
    error, joint = np.abs(judge.left_out(fit)), judge.readings.joint
    good = ~np.isin(np.arange(len(error)), list(bad))
    return np.array([100 * error[(joint == j) & good].mean() for j in judge.readings.joints])


def _parameters(judge: Judge, fit: Fit, some: Sequence[Hypothesis]) -> dict[str, Estimate]:
    """Return the parameters of one cause with their 95 % intervals."""
    out = {}
    for h in some:
        x, reach = fit.values[h], WIDTH * fit.sd[h]
        low, high = judge.bounds[h]
        ends = [h.cause.values(judge.data, h, float(np.clip(v, low, high)))
                for v in (x - reach, x + reach)]  # fmt: skip
        for key, value in h.cause.values(judge.data, h, x).items():
            interval = min(e[key] for e in ends), max(e[key] for e in ends)
            bound = x in (low, high)
            out[key] = Estimate(value=value, ci95=interval, on_bound=bound)
    return out


def _evidence(judge: Judge, fit: Fit, without: Fit, some: Sequence[Hypothesis]) -> str:
    """Return one sentence that can be checked in the tables."""
    r, joints, unit = judge.readings, some[0].joints, judge.data.unit
    rows = r.of_joints(joints)
    with_it, less = (f.around.predict(f.values) for f in (fit, without))
    off, off_less = (np.abs(r.torque - x) / unit for x in (with_it, less))
    i = int(rows[(off_less - off)[rows].argmax()])
    values: dict[str, float] = {}
    for h in some:
        values |= h.cause.values(judge.data, h, fit.values[h])
    before, after = (100 * np.sqrt(np.mean(x[rows] ** 2)) for x in (off_less, off))
    read, simulated, better = r.all[i].where.sign * np.array([r.torque[i], less[i], with_it[i]])
    return (
        f"{some[0].cause.what(values)}: without it the error of {named(joints)} is {before:.1f} % "
        f"of the friction (root mean square), with it {after:.1f} %; at {r.all[i]}, {read:.4f} N·m "
        f"is read, and simulated {simulated:.4f} N·m without it, {better:.4f} N·m with it"
    )


def _verdict(judge: Judge, fit: Fit) -> tuple[str, str]:
    """Return the verdict, and what remains unexplained."""
    poor = [j for j, nats in fit.common_nats.items() if nats > UNEXPLAINED]
    if not poor:
        return ("explained" if fit.values else "no discrepancy"), ""
    reason = "; ".join(
        f"joint {j}: readings of one frequency and scale are off together, by "
        f"{100 * fit.size[j][1]:.1f} % of the friction, and no known cause predicts it"
        for j in poor
    )
    return ("partly explained" if fit.values else "cannot tell"), reason
