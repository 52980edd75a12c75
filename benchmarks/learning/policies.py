"""Does a learned policy shake better than a constant table, and than a rule?

    python -m benchmarks.learning.policies [--minutes M] [--page]

Trains policies of the Panda, two at a time, measures their episodes and those of agents that learn
nothing, writes ``policies.csv`` and the page from it. Stopped, it goes on: trainings from their
last checkpoint, episodes from the last agent that was measured. ``--page`` writes the page alone,
from the rows that are there.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks.harness import EPISODES, Benchmark, Row
from benchmarks.learning.policies_page import BASELINE, BOUND, Estimate, page
from benchmarks.learning.search_rows import JOINTS, KEPT, known_tables, table_of
from stiction_envs.control.compensation_files import read_compensation
from stiction_envs.envs.agents import ConstantTable, NoDither, RandomDither, TorqueRule
from stiction_envs.envs.evaluation import evaluate, write_rows
from stiction_envs.measured import AmplitudeRow
from stiction_envs.method_settings import override
from tuning.policies.evaluation import best_gated, read_agent, within_bounds
from tuning.policies.settings import policy_settings
from tuning.policies.task import Task

STUDY = Benchmark(
    __file__, __doc__, made_by=(*EPISODES, "tuning/policies", "benchmarks/learning/policies.py")
)
ROWS = STUDY.folder / "policies.csv"
STEPS, RUNS, PATHS = 300_000, 5, 50
"""Of a training; trainings with other seeds, of an agent that learns nothing repeats; and random
paths of the test."""
FRICTIONS = (1.0, 0.8, 1.2)
"""True friction over the one that is known."""
SPREADS = {"friction": 0.2, "rotor": 0.2, "bristles": 0.3, "load": 0.5}
"""Of the arms that are trained on [-]: assumed, since no source says how far two arms of one make
are apart."""
SHAKING_WEIGHT = 1.0
"""Of the GTE's reward, assumed: with the environment's 0.01 whoever shakes most is best."""
CHANGES = {"ppo": {"ppo.rollout": 128, "ppo.batch_size": 1024}}
"""Settings that are not the defaults, assumed: few, larger updates. With the defaults PPO left the
table that it began with, downhill: -0.926 to -0.955 and -0.960 to -0.990 in 120,000 steps."""
FROM_A_TABLE = ("ppo",)
"""Algorithms that begin with the best constant table. The others forget it: with a critic that
knows nothing, 10,000 steps of the GTE took TD3 and SAC from -0.930 to -0.997."""
TRAININGS = {"gte": ("ppo", "td3", "sac"), "sje": ("ppo",)}
"""Algorithms by experiment."""
WANTED = {"gte": ("position", "orientation"), "sje": ("torque",)}
PRICES = {"gte": ("moving", "at_rest"), "sje": ("oscillation",)}
"""Measures that are to be smaller, and those that may not be larger for it, by experiment."""
DRAWS, LEVEL = 2000, 0.95
"""Of a bootstrap, and of its intervals; assumed."""
SEED, TOGETHER = 515_000, 64
"""Of the first episode, which no training has, and arms at once; assumed."""


Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Agent:
    """An agent that is compared."""

    name: str
    make: Callable[[Any], Any]
    """Returns the agent of an environment."""
    compensation: Any = None
    """Of the friction, besides what it does."""
    run: int | None = None
    """Its only run, as a training has one; None for all."""
    friction: float = 1.0
    """Over the true one: below 1 it is no agent, but a bound of what any could do."""


def environment(experiment: str, **arguments: Any) -> Task:
    """Return the environment of trainings and tests, which differ in ``arguments``."""
    if experiment == "gte":
        arguments["shaking_weight"] = SHAKING_WEIGHT
    return Task(robot="panda", experiment=experiment, arguments=arguments)


def episodes(experiment: str) -> list[dict[str, Any]]:
    """Return the reset options of a run: random paths that no training draws, or all ramps."""
    if experiment == "gte":
        first = policy_settings().evaluation.test_paths
        return [{"path": first + k} for k in range(PATHS)]
    ramps = product(range(1, JOINTS + 1), ("load", "no_load"), "+-")
    return [dict(zip(("joint", "load", "direction"), ramp, strict=True)) for ramp in ramps]


def tables(experiment: str) -> dict[str, tuple[AmplitudeRow, ...]]:
    """Return the constant tables by name."""
    searched = table_of(KEPT / f"panda_{experiment}.csv")
    return {**known_tables("panda"), "search, constant": searched}


def unlearned(experiment: str) -> list[Agent]:
    """Return the agents that learn nothing."""
    found = tables(experiment)

    def of_table(name: str, kind: Any, table: str) -> Agent:
        return Agent(name=name, make=lambda env: kind(env, within_bounds(env, found[table])))

    out = [Agent(name="none", make=NoDither), Agent(name="random", make=RandomDither)]
    out += [of_table(name, ConstantTable, name) for name in found]
    out.append(of_table("rule", TorqueRule, BASELINE))
    if experiment == "gte":
        out.append(Agent(name="gated", make=partial(best_gated, "panda")))
        out.append(Agent(name=BOUND, make=NoDither, friction=0.01))
        for kind in ("feedforward", "push"):
            gains = read_compensation(KEPT / f"panda_{kind}_gains.csv", kind, JOINTS)
            out.append(Agent(name=kind, make=NoDither, compensation=gains))
    return out


# ---- trainings -----------------------------------------------------------------------------------


def train(job: tuple[str, str, int, Path]) -> Row:
    """Train one policy in a folder."""
    from tuning.policies.train import Training

    experiment, algorithm, run, folder = job
    arguments: dict[str, Any] = {"randomise": SPREADS}
    if experiment == "gte":
        arguments["fixed_options"] = {"trajectory": "random"}
    task = replace(environment(experiment, **arguments), threads=1)
    start: list[AmplitudeRow] = []
    if algorithm in FROM_A_TABLE:
        env = task.make(1)
        searched = within_bounds(env, tables(experiment)["search, constant"])
        start = [row for row in searched if row.amplitude_nm]
        env.close()
    folder.mkdir(parents=True, exist_ok=True)
    settings = override(policy_settings(), CHANGES.get(algorithm, {}))
    training = Training(
        task=task, algorithm=algorithm, steps=STEPS, seed=run, start=start, settings=settings
    )
    return {"best": training.run(folder).best.evaluation_return}


def learned(experiment: str, work: Path) -> Iterator[Agent]:
    """Yield the trained policies."""
    for algorithm, run in product(TRAININGS[experiment], range(RUNS)):
        policy = work / f"{experiment}-{algorithm}-{run}" / "policy.zip"
        make = partial(read_agent, str(policy), environment(experiment))
        yield Agent(name=algorithm.upper(), make=make, run=run)


# ---- episodes ------------------------------------------------------------------------------------


def measure(job: tuple[str, float, Agent]) -> Row:
    """Return an agent's episodes, run by run."""
    experiment, friction, agent = job
    options = episodes(experiment)
    runs = range(RUNS) if agent.run is None else [agent.run]
    env: Any = environment(experiment, friction_factor=agent.friction * friction).make(TOGETHER)
    if agent.compensation is not None:
        # the undithered runs remain those without: one yardstick for all agents
        for core in env.tiles.cores:
            given = [agent.compensation] * core.num_envs
            core.rig.compensator.set_rows(np.arange(core.num_envs), given)
    seeds = [SEED + 1000 * run + k for run in runs for k in range(len(options))]
    rows = evaluate(env, agent.make(env), seeds, options * len(runs))
    env.close()
    return {"episodes": rows}


_EVERY = {"power": "power", "rate": "torque_rate", "return": "return"}
MEASURES = {
    "gte": {
        "position": "position_left_m/undithered_position_left_m",
        "orientation": "orientation_left_rad/undithered_orientation_left_rad",
        "position_at_rest": "position_resting_m/undithered_position_resting_m",
        "orientation_at_rest": "orientation_resting_rad/undithered_orientation_resting_rad",
        "tracking": "tracking_error",
        "moving": "vibration_moving_mm/undithered_vibration_mm",
        "at_rest": "vibration_at_rest_mm",
        **_EVERY,
    },
    "sje": {"torque": "tau_sje_nm/tau_base_nm", "oscillation": "oscillation_mrad", **_EVERY},
}
"""Columns of an episode, or one over another, by experiment and name in ``policies.csv``."""


def scores(experiment: str, rows: Sequence[Row], name: str) -> Array:
    """Return a measure (runs, episodes); what an episode does not have is infinitely bad."""
    columns = MEASURES[experiment][name].split("/")
    first, *below = (np.array([row[c] for row in rows], dtype=float) for c in columns)
    values = first / below[0] if below else first
    bad = -np.inf if name == "return" else np.inf
    return np.where(np.isnan(values), bad, values).reshape(-1, len(episodes(experiment)))


def compared(experiment: str, ours: Sequence[Row], theirs: Sequence[Row]) -> dict[str, Estimate]:
    """Return changes, how sure they are, and whether the first agent beats the second (1 or 0)."""
    out: dict[str, Estimate] = {}
    wanted, prices = WANTED[experiment], PRICES[experiment]
    for name in (*wanted, *prices):
        pair = [scores(experiment, rows, name) for rows in (ours, theirs)]
        out[f"{name}_change_percent"] = with_interval(change_percent, *pair)
        if name in wanted:
            out[f"{name}_improvement"] = with_interval(improvement, *pair)
    calm = all(out[f"{name}_change_percent"].value <= 0 for name in prices)
    sure = all(out[f"{name}_improvement"].low > 0.5 for name in wanted)
    return {**out, "beats": Estimate(*[float(calm and sure)] * 3)}


def summary(experiment: str, friction: float, found: Mapping[str, Sequence[Row]]) -> Iterator[Row]:
    """Yield rows of ``policies.csv`` from episodes by agent."""
    where = {"task": "random paths" if experiment == "gte" else "ramps", "friction": friction}
    for us, them in product(found, ("", BASELINE, "search, constant", "gated", "rule")):
        if them == "":
            names = MEASURES[experiment]
            out = {k: with_interval(mean, scores(experiment, found[us], k)) for k in names}
        elif them in found and us != them:
            out = compared(experiment, found[us], found[them])
        else:
            continue
        for name, number in out.items():
            yield {**where, "agent": us, "against": them, "measure": name, **number._asdict()}


# ---- statistics, as rliable defines them: Agarwal et al., NeurIPS 2021 ---------------------------


def mean(scores: Array) -> Array:
    """Return the interquartile mean of scores (draws, runs, tasks), as both below (draws,)."""
    return np.asarray(stats.trim_mean(scores.reshape(len(scores), -1), 0.25, axis=1))


def change_percent(ours: Array, theirs: Array) -> Array:
    """Return how much more our interquartile mean is than theirs [%]."""
    return 100 * (mean(ours) / mean(theirs) - 1)


def improvement(ours: Array, theirs: Array) -> Array:
    """Return the probability that a run of ours has a lower score than one of theirs.

    It is the mean over tasks of the Mann-Whitney U over the number of pairs.
    """
    a, b = ours[:, :, None, :], theirs[:, None, :, :]
    return np.asarray(((a < b) + 0.5 * (a == b)).mean(axis=(1, 2, 3)))


def with_interval(statistic: Callable[..., Array], *all_scores: Array) -> Estimate:
    """Return a statistic of scores (runs, tasks) with its stratified bootstrap interval."""
    rng, drawn = np.random.default_rng(0), []
    for scores in all_scores:
        runs, tasks = scores.shape
        drawn.append(scores[rng.integers(runs, size=(DRAWS, runs, tasks)), np.arange(tasks)])
    tail = 50 * (1 - LEVEL)
    # infinite scores have no differences to interpolate
    ends = np.percentile(statistic(*drawn), [tail, 100 - tail], method="nearest")
    return Estimate(float(statistic(*(x[None] for x in all_scores))[0]), *map(float, ends))


# ---- rows and page -------------------------------------------------------------------------------


def fill(options: Any, jobs: Mapping[str, Any], work: Any, processes: int = 1) -> dict[str, Row]:
    """Return the rows of all jobs, or stop where there is no time for them."""
    minutes = options.minutes
    rows = STUDY.rows(options).fill(jobs, work, processes=processes, minutes=minutes)
    if len(rows) < len(jobs):
        raise SystemExit(f"no page yet: {len(jobs) - len(rows)} of {len(jobs)} to go")
    return rows


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--page", action="store_true", help="write the page alone")
    options = parser.parse_args()
    if not options.page:
        warnings.simplefilter("ignore")
        # two trainings at once: threads of linear algebra would only be in each other's way
        os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        names = [(e, x, k) for e, kinds in TRAININGS.items() for x in kinds for k in range(RUNS)]
        trainings = {f"{e}-{x}-{k}": (e, x, k, options.work / f"{e}-{x}-{k}") for e, x, k in names}
        fill(options, trainings, train, processes=2)
        jobs = {
            f"{experiment} {friction:g} {agent.name} {agent.run}": (experiment, friction, agent)
            for experiment, friction in product(TRAININGS, FRICTIONS)
            for agent in (*unlearned(experiment), *learned(experiment, options.work))
        }
        cells: dict[tuple[str, float], dict[str, list[Row]]] = {}
        for key, row in fill(options, jobs, measure).items():
            experiment, friction, agent = jobs[key]
            mine = cells.setdefault((experiment, friction), {})
            mine.setdefault(agent.name, []).extend(row["episodes"])
        rows = [row for cell, found in cells.items() for row in summary(*cell, found)]
        write_rows(ROWS, rows)
    STUDY.write_page(options, **page(ROWS, options.out))


if __name__ == "__main__":
    main()
