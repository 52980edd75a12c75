"""Asking a real robot: Tables 4.6, 4.7 and 4.8 as the robot that answers.

    python -m benchmarks.accuracy.ask_tell [--fit]

Every joint of the Panda has nine measured settings (frequency, scale), each in four configurations:
252 cells. A strategy measures one setting after the other until the one it estimates to be best is
within 3.1 % of the base torque of the best of the nine, and stays so. ``--fit`` prints the numbers
of ``[robot]`` in the tuner's settings.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from benchmarks.harness import EPISODES, Benchmark, Rows
from stiction_envs.experiments.sje.calibrate import calibrate
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.measured import DitheredRow, thesis_base, thesis_dithered
from stiction_envs.precomputed.store import digest
from stiction_envs.reporting.markdown import number, table_text
from stiction_envs.reporting.png import save_full
from tuning.robot.candidates import CONFIGURATIONS, Candidates, Readings
from tuning.robot.ensemble import plausible
from tuning.robot.next_setting import best_measured, may_stop, next_settings
from tuning.robot.posterior import posterior_of, prior_covariance
from tuning.robot.prediction import mean_of
from tuning.search.frictions import frictions
from tuning.settings import RobotSettings, tuning_settings

Array = NDArray[np.float64]
MADE_BY = (*EPISODES, "!stiction_envs/envs", "benchmarks/accuracy/ask_tell.py")
STUDY = Benchmark(__file__, __doc__, made_by=MADE_BY)
PRIORS = ("shipped", "base torques")
"""Friction fitted to Tables 4.3 and 4.6; friction from Table 4.3 alone."""
ENSEMBLES = ("± 30 %", "springs")
"""Several frictions from Table 4.3 alone: dry friction, rotors and bristles drawn within some 30 %;
what the tuner takes (`tuning.robot.ensemble`)."""
FITTED = ("offset", "configuration", "shape", "frequency_length", "displacement_length", "setting")
GUESS = {
    "offset": (0.03, 1.0),
    "configuration": (0.05, 1.0),
    "shape": (0.03, 1.0),
    "setting": (0.015, 1.0),
    "frequency_length": (0.7, 0.5),
    "displacement_length": (0.5, 0.5),
}
"""Median and standard deviation of the logarithm of every number before it is fitted; assumed."""
OTHER_SEEDS = (1, 2)
"""Of further ensembles with springs, to see what the draw decides."""
ITERATIONS, MEMBERS_ITERATIONS = 4, 2
"""Of the simulation, under the friction of a prior and under the others of an ensemble; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """One joint of the robot that answers."""

    candidates: Candidates
    ratio: Array
    """(S, 4) measured |τ|/|τ_base|, S settings in the thesis's order."""
    scale: Array
    """(S,) amplitude over base torque."""
    refuted: NDArray[np.bool_]
    """(S, 4) cells whose reading its repetition refutes; that repetition is the answer."""

    @property
    def regret(self) -> Array:
        """(S,) how far a setting is above the best one, mean of four configurations [-]."""
        mean = self.ratio.mean(axis=1)
        return np.asarray(mean - mean.min())

    def readings(self, settings: Sequence[int]) -> Readings:
        """Return all cells of some settings."""
        rows = [(s, c, float(self.ratio[s, c])) for s in settings for c in range(4)]
        return Readings.of(rows)


# ---- the simulation's predictions ----------------------------------------------------------------


def experiment_of(prior: str) -> SingleJointExperiment:
    if prior == "shipped":
        return SingleJointExperiment("panda")
    unknown = SingleJointExperiment("panda", friction=load_friction("generic", 7))
    found = calibrate(thesis_base("panda"), unknown).parameters
    arm, timestep = unknown.sticking.arm, unknown.sticking.timestep
    return unknown.replace(sticking=build(arm, found, timestep=timestep))


def members(ensemble: str, seed: int) -> list[FrictionParameters]:
    """Return the frictions of an ensemble, that of the base torques first."""
    nominal = experiment_of("base torques").sticking.parameters
    s = dataclasses.replace(tuning_settings().robot, seed=seed)
    if ensemble == "springs":
        return plausible(nominal, s)
    return frictions(nominal, s.members, spread=0.3, seed=s.seed)


def predictions(
    prior: str, rows: Rows, friction: FrictionParameters | None = None, iterations: int = ITERATIONS
) -> dict[Job, tuple[float, float]]:
    """Return torque [N·m] and displacement [rad] of every measured cell and base, simulated.

    Args:
        prior: of `PRIORS`, or a name for another friction.
        rows: that are kept.
        friction: instead of the prior's.
        iterations: of every cell.
    """
    wanted = [Job(Configuration(j, *c)) for j in range(1, 8) for c in CONFIGURATIONS]
    wanted += [job_of(r) for r in thesis_dithered("panda") if r.table != "4.10"]
    of = prior if friction is None else f"{prior} {digest(friction)[:8]}"
    keys = {job: f"{of} {job}" for job in wanted}
    missing = [job for job, key in keys.items() if key not in rows]
    if missing:
        e = experiment_of(PRIORS[1] if friction is not None else prior)
        if friction is not None:
            arm, timestep = e.sticking.arm, e.sticking.timestep
            e = e.replace(sticking=build(arm, friction, timestep=timestep))
        for m in e.run(missing, iterations=iterations):
            rows.add(keys[m.job], {"tau_nm": m.mean, "displacement_rad": m.displacement})
    found = {job: rows[key] for job, key in keys.items()}
    return {job: (row["tau_nm"], row["displacement_rad"]) for job, row in found.items()}


def job_of(r: DitheredRow) -> Job:
    return Job(Configuration(r.joint, r.load, r.direction), r.frequency_hz, r.amplitude_nm)


def together(ensemble: str, rows: Rows, seed: int = 0) -> list[Measured]:
    """Return the seven joints with the predictions of an ensemble, drawn from a seed."""
    found = [measured(predictions(PRIORS[1], rows))]
    for k, friction in enumerate(members(ensemble, seed)[1:], 1):
        name = f"{ensemble} {k}"
        found.append(measured(predictions(name, rows, friction, MEMBERS_ITERATIONS)))
    out = []
    for group in zip(*found, strict=True):
        each = [m.candidates for m in group]
        mean, deviation = mean_of(list(np.stack([c.predicted for c in each], axis=1)))
        candidates = dataclasses.replace(
            each[0],
            predicted=mean,
            deviation=deviation,
            displacement=np.mean([c.displacement for c in each], axis=0),
        )
        out.append(dataclasses.replace(group[0], candidates=candidates))
    return out


def measured(simulated: Mapping[Job, tuple[float, float]]) -> list[Measured]:
    """Return the seven joints with simulated torques and displacements."""
    cells = [r for r in thesis_dithered("panda") if r.table != "4.10"]
    repeated = {
        (r.joint, r.load, r.direction): r
        for r in thesis_dithered("panda")
        if r.amplitude_set == "intermediate"
    }
    out = []
    for joint in range(1, 8):
        mine = [r for r in cells if r.joint == joint]
        settings = list(dict.fromkeys((r.frequency_hz, r.scale) for r in mine))
        shape = (len(settings), 4)
        ratio, amplitude, predicted, shaken = (np.full(shape, np.nan) for _ in range(4))
        refuted = np.zeros(shape, dtype=bool)
        for r in mine:
            at = (
                settings.index((r.frequency_hz, r.scale)),
                CONFIGURATIONS.index((r.load, r.direction)),
            )
            answer = repeated[joint, r.load, r.direction] if r.outlier else r
            ratio[at] = abs(answer.tau_sje_nm / answer.tau_base_nm)
            amplitude[at], refuted[at] = r.amplitude_nm, r.outlier
            tau, shaken[at] = simulated[job_of(r)]
            base, _ = simulated[Job(Configuration(joint, r.load, r.direction))]
            predicted[at] = abs(tau / base)
        candidates = Candidates(
            joint=joint,
            frequency_hz=np.array([f for f, _ in settings]),
            amplitude_nm=amplitude,
            predicted=predicted,
            displacement=shaken,
        )
        scale = np.array([s for _, s in settings])
        out.append(Measured(candidates=candidates, ratio=ratio, scale=scale, refuted=refuted))
    return out


def without_simulation(joints: Sequence[Measured]) -> list[Measured]:
    """Return the joints with a constant, the other joints' mean, and scale for displacement."""
    out = []
    for k, m in enumerate(joints):
        mean = np.mean([x.ratio.mean() for i, x in enumerate(joints) if i != k])
        scale = np.repeat(m.scale[:, None], 4, axis=1)
        known: dict[str, Any] = {"predicted": np.full(m.ratio.shape, mean), "displacement": scale}
        candidates = dataclasses.replace(m.candidates, **known)
        out.append(dataclasses.replace(m, candidates=candidates))
    return out


# ---- the numbers of the posterior ----------------------------------------------------------------


def fit(joints: Sequence[Measured], start: RobotSettings) -> RobotSettings:
    """Return settings of largest marginal likelihood over joints; the noise stays."""

    def changed(x: Array) -> RobotSettings:
        values: dict[str, Any] = dict(zip(FITTED, map(float, np.exp(x)), strict=True))
        return dataclasses.replace(start, **values)

    def loss(x: Array) -> float:
        apart = [(v - np.log(GUESS[k][0])) / GUESS[k][1] for k, v in zip(FITTED, x, strict=True)]
        total = sum(log_likelihood(m, changed(x)) for m in joints)
        return float(np.sum(np.square(apart)) / 2 - total)

    x = np.log([GUESS[k][0] for k in FITTED])
    return changed(minimize(loss, x, method="L-BFGS-B", bounds=[(-9, 2)] * len(x)).x)


def log_likelihood(m: Measured, s: RobotSettings) -> float:
    """Return the logarithm of the density of a joint's cells (Rasmussen & Williams 2.30)."""
    keep = ~m.refuted.ravel()
    prior = prior_covariance(m.candidates, s)[np.ix_(keep, keep)]
    d = (m.ratio - m.candidates.predicted).ravel()[keep]
    factor = cho_factor(prior + s.noise**2 * np.eye(len(d)), lower=True)
    logs = np.log(np.diag(factor[0])).sum()
    return float(-d @ cho_solve(factor, d) / 2 - logs - len(d) / 2 * np.log(2 * np.pi))


def left_out(joints: Sequence[Measured], start: RobotSettings) -> list[RobotSettings]:
    """Return for each joint (1..7) the settings fitted to the six others, under all priors."""
    return [fit([m for m in joints if m.candidates.joint != j], start) for j in range(1, 8)]


# ---- strategies ----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Replay:
    """What one strategy did with one joint."""

    regret: tuple[float, ...]
    """Of the choice after 1, 2, … settings [-]."""
    stopped: int
    """Settings after which it stopped asking."""
    inside: tuple[bool, ...] = ()
    """Whether a measured mean was within the 95 % interval that was believed before."""

    def needed(self, tolerance: float) -> int:
        """Return the settings after which the choice is good enough and stays so."""
        bad = [k for k, x in enumerate(self.regret) if x > tolerance]
        return bad[-1] + 2 if bad else 1


def ask(m: Measured, s: RobotSettings) -> Replay:
    """Ask, measure in four configurations, correct the belief; go on to the last setting."""
    tried: list[int] = []
    regret, inside, stopped = [], [], len(m.scale)
    for _ in m.scale:
        before = posterior_of(m.candidates, m.readings(tried), s)
        (setting,) = next_settings(m.candidates, m.readings(tried), 1, s)
        spread = np.hypot(before.sd[setting], s.noise / 2)
        inside.append(abs(m.ratio[setting].mean() - before.mean[setting]) < 1.96 * spread)
        tried.append(setting)
        posterior = posterior_of(m.candidates, m.readings(tried), s)
        best = best_measured(posterior, m.readings(tried))
        assert best is not None
        regret.append(float(m.regret[best]))
        if stopped == len(m.scale) and may_stop(posterior, m.readings(tried), s):
            stopped = len(tried)
    return Replay(regret=tuple(regret), stopped=stopped, inside=tuple(inside))


def in_order(m: Measured, order: Sequence[int]) -> Replay:
    """Measure in a given order; the lowest is the choice."""
    lowest = np.minimum.accumulate(m.regret[list(order)])
    return Replay(regret=tuple(map(float, lowest)), stopped=len(order))


# ---- page ----------------------------------------------------------------------------------------


def draw(strategies: dict[str, list[Replay]], path: Path) -> None:
    """Draw regret against settings measured, mean of the joints."""
    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.subplots()
    for name, replays in strategies.items():
        mean = 100 * np.mean([r.regret for r in replays], axis=0)
        axes.plot(range(1, 10), mean, "o-", ms=4, label=name)
    axes.axhline(100 * tuning_settings().robot.tolerance, color="0.3", lw=0.8, ls=":")
    axes.set_xlabel("settings measured of a joint (four cells each)")
    axes.set_ylabel("choice above the best of nine [% of base torque]")
    axes.set_title("mean of seven joints")
    axes.legend(frameon=False, fontsize=8)
    axes.grid(alpha=0.3)
    save_full(figure, path)


def page(
    strategies: dict[str, list[Replay]],
    joints: dict[str, list[Measured]],
    own: list[RobotSettings],
    s: RobotSettings,
) -> dict[str, Any]:
    """Return what the page's template asks for."""
    needed = {name: [r.needed(s.tolerance) for r in x] for name, x in strategies.items()}
    total = {name: sum(values) for name, values in needed.items()}
    rows = [[str(j + 1), *(f"{x[j]:g}" for x in needed.values())] for j in range(7)]
    rows.append(["**settings, of 63**", *(f"**{x:g}**" for x in total.values())])
    stops = [
        [
            name,
            ", ".join(str(r.stopped) for r in replays),
            str(sum(r.stopped for r in replays)),
            ", ".join(number(100 * r.regret[r.stopped - 1]) for r in replays),
            f"{sum(sum(r.inside) for r in replays)} of 63",
        ]
        for name, replays in strategies.items()
        if replays[0].inside
    ]
    header = ["strategy", "settings per joint when it stops", "sum"]
    header += ["choice above the best then [%]", "means within the 95 % interval estimated before"]
    spans = [
        [name, *(f"{getattr(x, name):.3f}" for x in own), f"{getattr(s, name):.3f}"]
        for name in FITTED
    ]
    return {
        "per_joint": table_text(["joint", *strategies], rows),
        "total": total,
        "upper": {name: sum(values[:4]) for name, values in needed.items()},
        "error": {
            prior: 100 * float(np.mean([np.abs(m.ratio - m.candidates.predicted) for m in group]))
            for prior, group in joints.items()
        },
        "stops": table_text(header, stops),
        "spans": table_text(["", *(f"without joint {j}" for j in range(1, 8)), "shipped"], spans),
        "members": s.members,
        "tolerance": 100 * s.tolerance,
        "confidence": 100 * s.confidence,
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--fit", action="store_true")
    options = parser.parse_args()
    s, rows = tuning_settings().robot, STUDY.rows(options)
    joints = {prior: measured(predictions(prior, rows)) for prior in PRIORS}
    pooled = [m for group in joints.values() for m in group]
    if options.fit:
        best = fit(pooled, s)
        for name in FITTED:
            print(f"{name} = {getattr(best, name):.4f}")
        return
    several = {name: together(name, rows) for name in ENSEMBLES}
    own, plain = left_out(pooled, s), without_simulation(joints["shipped"])
    strategies = {
        **{
            f"asked, {prior}": [ask(m, x) for m, x in zip(group, own, strict=True)]
            for prior, group in (joints | several).items()
        },
        "thesis's order": [in_order(m, range(9)) for m in plain],
        "asked, no simulation": [ask(m, x) for m, x in zip(plain, left_out(plain, s), strict=True)],
    }
    drawn = [
        sum(ask(m, x).needed(s.tolerance) for m, x in zip(group, own, strict=True))
        for group in (together("springs", rows, seed) for seed in OTHER_SEEDS)
    ]
    STUDY.write_page(options, drawn=drawn, **page(strategies, joints | several, own, s))
    draw(strategies, options.out / "ask_tell.png")


if __name__ == "__main__":
    main()
