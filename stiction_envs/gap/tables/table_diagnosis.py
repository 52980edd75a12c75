"""Name what a simulation gets wrong, from tables of breakaway torques.

    arm = load_arm("panda")
    rows = read_tables(["sje.csv"], arm)
    diagnosis = diagnose_tables(rows, WholeArm(arm, load_friction("panda")))
    print(diagnosis.verdict)
    for cause in diagnosis.causes:
        print(cause.name, cause.joints, cause.parameters, cause.nats, cause.rivals)

`gap.tables.table_search` names causes by the evidence of the model with them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.gap.causes.base import Cause
from stiction_envs.gap.judge.judgement import (
    WIDTH,
    Estimate,
    Judgement,
    NamedCause,
    NotShown,
    percent_gained,
    percent_lost,
)
from stiction_envs.gap.predictors.named import ALIKE, HIDDEN, MOST_ALIKE
from stiction_envs.gap.tables.causes import cause_named, registered, what_tells_apart
from stiction_envs.gap.tables.data import Effect, TableData, WholeArm
from stiction_envs.gap.tables.table_search import Judge, TableFit, Weighed
from stiction_envs.measured.tables import SJERow
from stiction_envs.reporting.markdown import joints as named

UNEXPLAINED = 3.0
"""Log evidence for an error that is common to a frequency and scale above which a joint is not
explained [nats]; assumed."""
LEAST_BLOCKS = 3
"""Least number of frequencies and scales for a diagnosis: one is held out; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TableDiagnosis(Judgement):
    """Errors of a simulation, found in torque tables."""

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
        """Return the contents of a `diagnosis.json`."""

        def by_joint(values: Array) -> dict[str, float]:
            return dict(zip(map(str, self.joints), values.tolist(), strict=True))

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
    rows: Sequence[SJERow],
    whole: WholeArm,
    *,
    progress: Callable[[str, float], None] | None = None,
    causes: Sequence[Cause] | None = None,
) -> TableDiagnosis:
    """Say what a simulation gets wrong about measured breakaway torques.

    Args:
        rows: of `read_tables`; days or sets are not distinguished.
        whole: the nominal arm; a later diagnosis with it does not repeat its simulations.
        progress: called with the present step, and 0.
        causes: causes to try; None for all registered ones.
    """

    def say(step: str) -> None:
        if progress is not None:
            progress(step, 0.0)

    data = TableData(rows, whole)
    if data.blocks - 1 < LEAST_BLOCKS:
        nothing = np.full(len(data.joints), np.nan)
        return TableDiagnosis(
            robot=whole.arm.name,
            verdict="cannot tell",
            joints=data.joints,
            nominal=nothing,
            extended=nothing,
            noise_floor=nothing,
            reason=f"{max(0, data.blocks - 1)} frequencies and scales of dithered torques: at "
            f"least {LEAST_BLOCKS} are needed to hold one out",
        )
    say("simulating the nominal arm")
    tried = registered() if causes is None else causes
    judge = Judge(data, [e for c in tried for e in c.in_tables(data)])
    best, weighed = judge.search(say)
    before, after = _errors(judge, judge.fit({})), _errors(judge, best)
    gained = percent_gained(before, after)
    found = [_named(judge, best, c, before, after) for c in weighed]
    found.sort(key=lambda c: -c.gain_percent)
    verdict, reason = _verdict(judge, best)
    if found and gained < 0:  # a verdict is earned
        verdict, found, after = "cannot tell", [], before
        reason = "the likeliest causes predict held-out readings worse than the nominal model"
    shares = {"named": gained, "links": 0.0, "set_up": 0.0, "left": 100 - gained}
    return TableDiagnosis(
        robot=whole.arm.name,
        verdict=verdict,
        causes=tuple(found),
        shares_percent=shares if found else {},
        not_shown=_not_shown(judge, best),
        joints=data.joints,
        nominal=before,
        extended=after,
        noise_floor=np.array([100 * best.error(k)[0] for k in range(len(data.joints))]),
        reason=reason,
    )


def _named(
    judge: Judge, best: TableFit, weighed: Weighed, before: Array, after: Array
) -> NamedCause:
    """Return a cause with its values, evidence and rivals."""
    effects, without, rivals = weighed
    name, joints = effects[0].cause, effects[0].joints
    nearest = sorted(((n, best.score - f.score) for n, f in rivals.items()), key=lambda x: x[1])
    confused = [n for n, nats in nearest if nats < ALIKE][:MOST_ALIKE]
    return NamedCause(
        name=name,
        joints=joints,
        parameters={0 if len(joints) > 1 else joints[0]: _parameters(judge, best, effects)},
        gain_percent=percent_lost(_errors(judge, without), after, before),
        nats=best.score - without.score,
        rivals=tuple(nearest),
        evidence=_evidence(judge, best, without, effects),
        confused_with=tuple(confused),
        told_apart_by={n: what_tells_apart(name, n) for n in confused},
    )


def _errors(judge: Judge, fit: TableFit) -> Array:
    """Return the mean held-out |error| of each joint over its friction [%].

    Readings that the model calls bad have no error of the model.
    """
    bad = {i for e in fit.values if e.bad for i in e.rows.tolist()}
    error = np.abs(judge.left_out(fit))
    each = [[i for i in rows if i not in bad] for rows in judge.data.of_joint.values()]
    return np.array([100 * error[rows].mean() for rows in each])


def _parameters(judge: Judge, fit: TableFit, some: Sequence[Effect]) -> dict[str, Estimate]:
    """Return the parameters of one cause with their 95 % intervals."""
    out, sd = {}, fit.sd()
    for e in some:
        x, (low, high) = fit.values[e], judge.bounds[e]
        ends = [e.values(float(np.clip(x + w * sd[e], low, high))) for w in (-WIDTH, WIDTH)]
        for key, value in e.values(x).items():
            interval = min(v[key] for v in ends), max(v[key] for v in ends)
            out[key] = Estimate(value=value, ci95=interval, on_bound=x in (low, high))
    return out


def _evidence(judge: Judge, fit: TableFit, without: TableFit, some: Sequence[Effect]) -> str:
    """Return one sentence that can be checked in the tables."""
    data, joints = judge.data, some[0].joints
    rows = np.flatnonzero(np.isin(data.joint, joints))
    with_it, less = (judge.predictor.predict(f.states, f.values) for f in (fit, without))
    off, off_less = (np.abs(data.torque - x) / data.unit for x in (with_it, less))
    i = int(rows[(off_less - off)[rows].argmax()])
    values = {k: v for e in some for k, v in e.values(fit.values[e]).items()}
    before, after = (100 * np.sqrt(np.mean(x[rows] ** 2)) for x in (off_less, off))
    read, simulated, better = data.sign[i] * np.array([data.torque[i], less[i], with_it[i]])
    return (
        f"{cause_named(some[0].cause).in_words(values)}: without it the error of {named(joints)} "
        f"is {before:.1f} % of the friction (root mean square), with it {after:.1f} %; at "
        f"{data.place(i)}, {read:.4f} N·m is read, and simulated {simulated:.4f} N·m without it, "
        f"{better:.4f} N·m with it"
    )


def _not_shown(judge: Judge, fit: TableFit) -> tuple[NotShown, ...]:
    """Return the causes of whole joints whose posterior is about as wide as their prior."""
    lines = judge.problem(fit.states, fit.values, tangents=False, sizes=fit.sizes)
    out: dict[tuple[str, int], NotShown] = {}
    for term, e in judge.effects.items():
        whole = len(e.joints) == 1 and len(e.rows) == len(judge.data.of_joint[e.joints[0]])
        if not whole or e in fit.values or (e.cause, term.joint) in out:
            continue
        model = lines.model([*fit.terms, term])
        sd = float(np.sqrt(lines.covariance(model)[-1, -1]))
        if sd >= HIDDEN:
            low, high, x = *judge.bounds[e], float(lines.fit(model)[-1])
            ends = [np.clip(e.size * (x + w * sd), low, high) for w in (-WIDTH, WIDTH)]
            (key, a), (_, b) = (next(iter(e.values(float(v)).items())) for v in ends)
            where = e.cause, term.joint
            out[where] = NotShown(name=e.cause, joints=e.joints, parameters={key: (a, b)})
    return tuple(sorted(out.values(), key=lambda x: x.joints))


def _verdict(judge: Judge, fit: TableFit) -> tuple[str, str]:
    """Return the verdict, and what remains unexplained."""
    poor = [
        f"joint {j}: readings of one frequency and scale are off together, by "
        f"{100 * fit.error(k)[1]:.1f} % of the friction, and no known cause predicts it"
        for k, j in enumerate(judge.data.joints)
        if fit.problem.common_nats(k, fit.terms) > UNEXPLAINED
    ]
    if not poor:
        return ("explained" if fit.values else "no discrepancy"), ""
    return ("partly explained" if fit.values else "cannot tell"), "; ".join(poor)
