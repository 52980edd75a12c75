"""What a simulation gets wrong, told from tables of breakaway torques.

diagnosis = diagnose_tables(base, cells, load_arm("panda"), load_friction("panda"))
print(diagnosis.verdict)
for cause in diagnosis.causes:
    print(cause.name, cause.joints, cause.parameters, cause.evidence, cause.confused_with)

| name | what is wrong in the simulation | how the tables show it |
|---|---|---|
| `low_pass` | cut-off of the robot's command filter | one cut-off for the dither of all joints |
| `rotor_inertia` | apparent rotor inertia of a joint | dithered torques, most near resonance |
| `presliding` | bristle stiffness of a joint | where dither is near √(σ0/J)/2π (physics.md 4.3) |
| `torque_offset` | constant torque | + and − torques shifted, dither does not shrink it |
| `gravity_error` | gravity model | the same, in proportion to the load of the pose |
| `direction_asymmetry` | dry friction by direction | + and − torques shifted, dither shrinks it |
| `friction_level` | dry friction | base and dithered torques off by one factor |
| `base_drift` | friction moved between two measuring days | dithered torques off by one factor |
| `corrupted_cell` | one reading | far off what model, neighbours and repeats say |

Statements are taken on one by one, the one that predicts held-out blocks best first, as long as
that gain stands against the noise. Single cells are never held out. Whatever would have predicted
the held-out blocks as well is named in `confused_with`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.protocol import Protocol
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.gap.tables.cells import Cell
from stiction_envs.gap.tables.evidence import DYNAMIC, Readings, WholeArm
from stiction_envs.gap.tables.hypotheses import Fit, Hypothesis, Model
from stiction_envs.gap.tables.noise import losses
from stiction_envs.gap.tables.sentences import (
    ELSE,
    TOLD_APART,
    TableCause,
    TableDiagnosis,
    bad_reading,
    evidence_of,
    parameters_of,
)
from stiction_envs.gap.tables.settings import TableSettings, table_settings
from stiction_envs.measured import BaseTable
from stiction_envs.method_settings import Changes, override
from stiction_envs.robots import Arm

Array = NDArray[np.float64]


def diagnose_tables(
    base: BaseTable,
    cells: Sequence[Cell],
    arm: Arm,
    friction: FrictionParameters | None = None,
    *,
    interface: TorqueInterface | None = None,
    protocol: Protocol | None = None,
    whole: WholeArm | None = None,
    nthread: int = 0,
    progress: Callable[[str], None] | None = None,
    settings: TableSettings | Changes | None = None,
) -> TableDiagnosis:
    """Say what a simulation gets wrong about measured breakaway torques.

    Args:
        base: base torques of all joints; those of joints without dithered torques are not used.
        cells: dithered torques of some or all joints; two days, or sets, are not told apart.
        arm: the arm that is simulated.
        friction: nominal parameters of one arm; None for the TOML of that name.
        interface: nominal torque interface; None for the arm's.
        protocol: of the measurement; None for the robot's.
        whole: of an earlier diagnosis, in place of the four before: what it has simulated is not
            simulated again. The result is the same.
        nthread: threads of the simulation, 0 for all processors.
        progress: called with a line on what is being done.
        settings: constants of the method that differ from ``[tables]`` of ``settings.toml``.

    Raises:
        StictionError: tables of another arm, or settings that are none.
    """
    if base.n_joints != arm.n:
        raise StictionError(f"base table of {base.n_joints} joints, but {arm.name} has {arm.n}")
    wrong = [c.row.joint for c in cells if not 1 <= c.row.joint <= arm.n]
    if wrong:
        raise StictionError(f"dithered torque of joint {wrong[0]}, but {arm.name} has {arm.n}")
    if whole is None:
        nominal_friction = load_friction(arm.name, arm.n) if friction is None else friction
        whole = WholeArm(
            arm, nominal_friction, interface=interface, protocol=protocol, nthread=nthread
        )
    own = override(table_settings(), settings)
    tell = progress or (lambda _: None)
    readings = Readings(base, cells)
    joints = tuple(readings.joints)
    if len(readings.blocks) - 1 < own.verdict.least_blocks:
        return _cannot_tell(
            arm.name, joints, f"{max(0, len(readings.blocks) - 1)} frequencies and scales of "
            f"dithered torques: at least {own.verdict.least_blocks} are needed to hold one out"
        )  # fmt: skip
    tell("simulating the nominal arm")
    nominal = Model(readings, whole, base, own)
    if not np.isfinite(nominal.noise).all():
        bad = sorted({int(j) for j in readings.joint[~np.isfinite(nominal.noise)]})
        return _cannot_tell(arm.name, joints, f"too few dithered torques of joints {bad}")
    model = _select(nominal, tell)
    bad_readings = _corrupted(model)
    poor = _unexplained(model, bad_readings, own.verdict.doubtful)
    if poor:
        tell(f"simulating joints {', '.join(map(str, poor))} at more values")
        _anchor(nominal, poor)
        model = _select(nominal, tell)
        bad_readings = _corrupted(model)
    tell("looking for what else could have been it")
    return _report(arm.name, nominal, model, bad_readings)


def _cannot_tell(robot: str, joints: tuple[int, ...], reason: str) -> TableDiagnosis:
    nothing = dict.fromkeys(joints, float("nan"))
    return TableDiagnosis(
        robot=robot,
        verdict="cannot tell",
        causes=(),
        joints=joints,
        nominal=nothing,
        extended=nothing,
        noise_floor=nothing,
        gain_percent=0.0,
        reason=reason,
    )


def _select(model: Model, tell: Callable[[str], None]) -> Model:
    """Take statements on while the best one's held-out gain stands against noise."""
    refused: set[Hypothesis] = set()
    s = model.settings.verdict
    for _ in range(s.most_causes):
        null = {j: model.held_now((j,)) for j in model.readings.joints}
        fits = _fits(model, null, refused, s.least_gain)
        if not fits or fits[0][0] < s.least_gain:
            break
        best = fits[0]
        tell(f"trying {best[1].hypothesis.name} on joints {best[1].hypothesis.joints}")
        gain, chosen = _arbitrate(model, null, fits)
        if gain < s.least_gain:
            refused.add(best[1].hypothesis)
            continue
        model = chosen
        model.set_noise()
        for h in list(model.values)[:-1]:
            if _lost(model, (h,)) < s.least_gain:
                model.drop((h,))
                refused.add(h)
    return model


def _fits(
    model: Model, null: Mapping[int, float], refused: set[Hypothesis], enough: float
) -> list[tuple[float, Fit]]:
    """Return held-out gains [nats] of what could be taken on, best first; −inf for too little."""
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
    """Return the gain [nats] and model of the best statement, rivals simulated too."""
    best_gain, best = fits[0]
    rivals = [best] + [
        f
        for g, f in fits[1:]
        if g > model.settings.verdict.rival * best_gain
        and set(f.hypothesis.joints) & set(best.hypothesis.joints)
        and (f.hypothesis.name in DYNAMIC or best.hypothesis.name in DYNAMIC)
    ]
    tried = []
    for fit in rivals[:3]:
        h = fit.hypothesis
        trial = model.copy()
        held = trial.take(h, fit.x).held
        tried.append((sum(null[j] for j in h.joints) - held, trial))
    return max(tried, key=lambda pair: pair[0])


def _lost(model: Model, some: tuple[Hypothesis, ...]) -> float:
    """Return the held-out gain that is lost without some statements [nats]."""
    joints = tuple(sorted({j for h in some for j in h.joints}))
    return _without(model, some).held(joints) - model.held(joints)


def _without(model: Model, some: tuple[Hypothesis, ...]) -> Model:
    new = model.copy()
    new.drop(some)
    return new


def _corrupted(model: Model) -> list[int]:
    """Return the readings that nothing explains, the worst first."""
    r, z, s = model.readings, model.left_over(), model.settings.verdict
    error = z * model.noise
    found = []
    for i in np.flatnonzero((np.abs(z) > s.corrupted_sd) & (np.abs(error) > s.corrupted)):
        near = r.joint == r.joint[i]
        alike = [w == r.all[i].where for w in (x.where for x in r.all)]
        rest = error[i]
        for group in (np.array(alike), near & (r.block == r.block[i])):
            others = group.copy()
            others[i] = False
            if others.any():
                # what its configuration or its block does as a whole is no bad reading
                rest = min(rest, error[i] - np.median(error[others]), key=abs)
        if abs(rest) > max(s.corrupted, s.corrupted_sd * model.noise[i]):
            found.append(int(i))
    if len(found) > max(1, s.corrupted_share * len(z)):
        return []
    return sorted(found, key=lambda i: -abs(z[i]))


def _report(robot: str, nominal: Model, model: Model, bad: list[int]) -> TableDiagnosis:
    r = model.readings
    before, after = _errors(nominal, []), _errors(model, bad)
    full = _percent(before, after)
    groups: dict[tuple[str, tuple[int, ...]], list[Hypothesis]] = {}
    for h in model.values:
        groups.setdefault((h.name, h.joints), []).append(h)
    causes = []
    for (name, joints), some in groups.items():
        without = _without(model, tuple(some))
        fits = [model.fit(h) for h in some]
        lost = _lost(model, tuple(some))
        causes.append(
            TableCause(
                name=name,
                joints=joints,
                parameters=parameters_of(fits, model),
                gain_percent=full - _percent(before, _errors(without, bad)),
                gain_nats=lost,
                evidence=evidence_of(name, some, model, without),
                confused_with=_confused(name, joints, some, lost, without),
            )
        )
    for i in bad:
        others = [k for k in bad if k != i]
        causes.append(
            TableCause(
                name="corrupted_cell",
                joints=(int(r.joint[i]),),
                parameters={},
                gain_percent=full - _percent(before, _errors(model, others)),
                gain_nats=float(losses(model.left_over(), r.base, model.settings.noise)[i]),
                evidence=bad_reading(i, model),
                confused_with={"base_drift": TOLD_APART["base_drift"]["corrupted_cell"]}
                if r.base[i]
                else {},
                cell=r.all[i].cell,
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
        noise_floor={j: float(100 * model.noise[r.of_joints([j])].min()) for j in r.joints},
        gain_percent=full,
        reason=reason,
    )


def _errors(model: Model, bad: list[int]) -> dict[int, float]:
    """Return the mean held-out |error| per joint over its friction [%], but for some readings."""
    error = np.abs(model.left_out_residual())
    good = np.ones(len(error), dtype=bool)
    good[bad] = False
    r = model.readings
    return {j: float(100 * error[(r.joint == j) & good].mean()) for j in r.joints}


def _percent(before: Mapping[int, float], after: Mapping[int, float]) -> float:
    return float(100 * (1 - np.mean([after[j] / before[j] for j in before])))


def _confused(
    name: str,
    joints: tuple[int, ...],
    some: list[Hypothesis],
    gain: float,
    without: Model,
) -> dict[str, str]:
    """Return what would have predicted the held-out blocks as well, and what would tell."""
    null = {j: without.held_now((j,)) for j in without.readings.joints}
    s = without.settings.verdict
    least = gain - max(s.alike_nats, s.alike_share * gain)
    # of several joints, what little each gains may add up
    enough = 1.0 if len(joints) > 1 else max(least, 1.0)
    best: dict[str, dict[tuple[int, ...], float]] = {}
    for g, fit in _fits(without, null, set(some), enough):
        h = fit.hypothesis
        if h.name == name or not set(h.joints) & set(joints):
            continue
        known = best.setdefault(h.name, {})
        if h.joints in known:
            continue
        if h.name in DYNAMIC and g > s.rival * gain and len(joints) == len(h.joints):
            trial = without.copy()
            g = sum(null[j] for j in h.joints) - trial.take(h, fit.x).held
        known[h.joints] = g
    out = {}
    for other, gains in best.items():
        # what speaks of all joints at once is matched by one statement per joint
        each = [max(g, 0.0) for g in gains.values()]
        total = sum(each) if len(joints) > 1 else max(each)
        if total >= least:
            out[other] = TOLD_APART.get(name, {}).get(other, ELSE)
    if name == "base_drift" and len(some) == 1 and len(some[0].where) == 1:
        out["corrupted_cell"] = TOLD_APART["base_drift"]["corrupted_cell"]
    return out


def _verdict(model: Model, bad: list[int], any_cause: bool) -> tuple[str, str]:
    """Return the verdict, and what is left over if anything is."""
    poor = _unexplained(model, bad)
    if not poor:
        return ("explained" if any_cause else "no discrepancy"), ""
    reason = "; ".join(
        f"joint {j}: what is left over is {np.sqrt(size):.1f} times the noise, and no statement "
        "that is known here predicts it"
        for j, size in poor.items()
    )
    return ("partly explained" if any_cause else "cannot tell"), reason


def _unexplained(model: Model, bad: list[int], share: float = 1.0) -> dict[int, float]:
    """Return the joints of which too much is left over: its mean square over noise."""
    r, s = model.readings, model.settings.verdict
    # what lone joint and whole arm differ by is not for a cause to explain
    z = model.left_over() * model.noise / np.hypot(model.noise, s.model_sd)
    good = np.ones(len(z), dtype=bool)
    good[bad] = False
    out = {}
    for j in r.joints:
        mine = good & (r.joint == j)
        size = float(np.minimum(z[mine] ** 2, 9.0).mean())
        # a block whose readings are all off has a cause, though none that is known here
        blocks = [z[mine & (r.block == b)] for b in np.unique(r.block[mine])]
        common = float(np.mean([b.mean() ** 2 * len(b) for b in blocks]))
        by_chance = float(chi2.ppf(0.999, len(blocks))) / len(blocks)
        if size > share * s.unexplained or common > share * max(s.unexplained, by_chance):
            out[j] = max(size, common)
    return out


def _anchor(model: Model, joints: Iterable[int]) -> None:
    """Simulate joints with the whole arm at more values of what the lone joint predicts."""
    for name, factors in dataclasses.asdict(model.settings.anchors).items():
        for factor in factors:
            states = {}
            for j in joints:
                knots = model.lone(j).knots[name]
                value = getattr(model.states[j], name) * factor
                if knots[0] < np.log(value) < knots[-1]:
                    states[j] = dataclasses.replace(model.states[j], **{name: value})
            model.simulate(states)
