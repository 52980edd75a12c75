"""Does a policy that dithers and pushes beat the searched push, under the robot's senses?

    python -m benchmarks.learning.policies_push [--minutes M] [--steps N]

Trains a policy per seed that acts on the dither and on the gains of a push, from the gains that
``stiction tune`` found, and measures its episodes on random paths that no training draws beside
those of the gains alone, of the momentum observer and of no treatment. A small budget, half an hour
of one processor: the page says what it shows and what not.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import EPISODES, Benchmark, Row, Rows
from benchmarks.learning.policies_plan import SPREADS, Plan, Training, environment
from benchmarks.learning.policies_run import SEED, folder, train_one
from benchmarks.learning.policies_statistics import (
    Estimate,
    improvement_with_interval,
    mean_with_interval,
    ratio_with_interval,
)
from benchmarks.learning.search_rows import JOINTS, KEPT
from stiction_envs.control.compensation_files import read_compensation
from stiction_envs.envs.agents import NoDither
from stiction_envs.envs.evaluation import evaluate
from stiction_envs.experiments.actions import PUSHED
from stiction_envs.method_settings import override
from stiction_envs.precomputed.store import digest
from stiction_envs.reporting.markdown import table_text
from tuning.policies.evaluation import read_agent
from tuning.policies.settings import PolicySettings, policy_settings
from tuning.policies.task import Task

Array = NDArray[np.float64]
STUDY = Benchmark(
    __file__,
    __doc__,
    made_by=(*EPISODES, "tuning/policies", "benchmarks/learning/policies_push.py"),
)
ROBOT, EXPERIMENT, ALGORITHM = "panda", "gte", "ppo"
GAINS = KEPT / "panda_push_robot_gains.csv"
"""The best trial of ``stiction tune panda --protocol search --objective gte --treatment push
--sensing robot --evaluations 60``."""
STEPS, RUNS = 120_000, 3
"""Of a training, and trainings with other seeds; of an agent that learns nothing, repeats."""
PATHS, DRAWN, FRICTIONS = 24, 32, (1.0, 1.3)
"""Random paths of the test, of training, and true friction over the one that is believed."""
NOTHING, SEARCHED, OBSERVER, POLICY = "nothing", "searched push", "momentum observer", "policy"
KEYS = ("position_left_m", "orientation_left_rad", "vibration_moving_mm", "vibration_at_rest_mm")
ERRORS, SHAKING = KEYS[:2], KEYS[2:]


def task(*, threads: int = 1, **arguments: Any) -> Task:
    """Return the environment; a policy's and the gains' has the action of both."""
    return environment(ROBOT, EXPERIMENT, threads=threads, sensing="robot", **arguments)


def pushing(**more: Any) -> dict[str, Any]:
    """Return the arguments of an environment whose action begins with the searched gains."""
    return {"action": PUSHED, "compensation": read_compensation(GAINS, None, JOINTS), **more}


@dataclass(frozen=True, kw_only=True)
class PushTraining(Training):
    """A training that acts on the searched gains, under the robot's senses."""

    @property
    def start(self) -> tuple[Any, ...]:
        """No dither."""
        return ()

    @property
    def settings(self) -> PolicySettings:
        """As other trainings from a table, with half the arms: twice as many updates."""
        return override(super().settings, {"ppo.envs": 32})

    @property
    def task(self) -> Task:
        """Random paths, other frictions."""
        drawn = {"fixed_options": {"trajectory": "random"}, "random_paths": DRAWN}
        return task(**pushing(**drawn, randomise=SPREADS))


@dataclass(frozen=True)
class Lowest:
    """The lowest action: no dither, no push."""

    action: Array

    def predict(self, observation: Array, state: Any = None, **_: Any) -> tuple[Array, Any]:
        return np.tile(self.action, (len(observation), 1)), state


def lowest(env: Any) -> Lowest:
    return Lowest(env.single_action_space.low)


@dataclass(frozen=True)
class Job:
    """Episodes of one agent at one friction."""

    name: str
    """Of the treatment, on the page."""
    friction: float
    """True friction over the one that is believed."""
    runs: tuple[int, ...]
    arguments: Mapping[str, Any]
    make: Callable[[Any], Any]
    """Returns the agent of an environment."""
    made_of: str = ""
    """Hash of its numbers, besides code."""

    @property
    def key(self) -> str:
        """Key of its row."""
        of = digest(repr(self.arguments), self.made_of)
        return f"{self.name} {self.friction:g} {self.runs} {of}"


def measure(job: Job) -> Row:
    """Return a row per run and path."""
    first = policy_settings().evaluation.test_paths
    each = [(run, k) for run in job.runs for k in range(PATHS)]
    env = task(friction_factor=job.friction, **job.arguments).make(len(each))
    seeds = [SEED + 1000 * run + k for run, k in each]
    rows = evaluate(env, job.make(env), seeds, [{"path": first + k} for _, k in each])
    env.close()
    return {"episodes": rows}


def jobs(policies: Mapping[int, Path]) -> list[Job]:
    """Return all that is measured, paths in the order of their runs."""
    gains, every = pushing(), tuple(range(RUNS))
    out = []
    for friction in FRICTIONS:
        out += [
            Job(NOTHING, friction, every, gains, lowest),
            Job(SEARCHED, friction, every, gains, NoDither),
            Job(OBSERVER, friction, every, {"compensation": "momentum_observer"}, NoDither),
        ]
        for run, path in policies.items():
            make = partial(read_agent, str(path), task(**gains))
            out.append(Job(POLICY, friction, (run,), gains, make, digest(path.read_bytes())))
    return out


def scores(rows: list[Row], key: str) -> Array:
    """Return a number (runs, paths); an error that a run does not have is infinitely bad."""
    values = np.array([row[key] for row in rows], dtype=float).reshape(-1, PATHS)
    return np.where(np.isnan(values), np.inf, values)


def page(found: Mapping[tuple[str, float], list[Row]], curves: list[Row]) -> dict[str, Any]:
    """Return what the page's template asks for."""
    rows, against, beats = [], [], []
    for friction in FRICTIONS:
        of = {
            (name, key): scores(found[name, friction], key)
            for name in (NOTHING, SEARCHED, OBSERVER, POLICY)
            for key in KEYS
        }
        for name in (NOTHING, SEARCHED, OBSERVER, POLICY):
            left = [of[name, key] / of[NOTHING, key].mean(axis=0) for key in ERRORS]
            shaken = [of[name, key] for key in SHAKING]
            cells = [_text(mean_with_interval(x), 100, 0) for x in left]
            cells += [_text(mean_with_interval(x), 1, 3) for x in shaken]
            rows.append([f"{friction:g}", name, *cells])
        better = [improvement_with_interval(of[POLICY, k], of[SEARCHED, k]) for k in ERRORS]
        ratio = [ratio_with_interval(of[POLICY, k], of[SEARCHED, k]) for k in KEYS]
        calm = all(x.value <= 1 for x in ratio[len(ERRORS) :])
        beats.append(calm and all(x.low > 0.5 for x in better))
        shown = [_text(x, 1, 2) for x in (*ratio, *better)]
        against.append([f"{friction:g}", *shown])
    header = ["friction", "treatment", "position left [%]", "orientation left [%]"]
    header += ["vibration moving [mm]", "at rest [mm]"]
    compared = ["friction", "position", "orientation", "vibration moving", "at rest"]
    compared += ["P(position better)", "P(orientation better)"]
    ratios = [
        [
            ratio_with_interval(*(scores(found[who, FRICTIONS[0]], k) for who in (name, SEARCHED)))
            for k in ERRORS
        ]
        for name in (POLICY, OBSERVER)
    ]
    gain, observer = ([100 * (1 - x.value) for x in pair] for pair in ratios)
    returns = np.array([row["curve"][1] for row in curves])
    return {
        "table": table_text(header, rows),
        "against": table_text(compared, against),
        "beats": beats,
        "gain": gain,
        "observer": observer,
        "returns": [(r[0], r.max()) for r in returns],
        "steps": int(max(curves[0]["curve"][0])),
        "runs": RUNS,
        "paths": PATHS,
        "drawn": DRAWN,
        "minutes": sum(row["seconds"] for row in curves) / 60,
    }


def _text(x: Estimate, unit: float, digits: int) -> str:
    value, low, high = (f"{unit * v:.{digits}f}" for v in x)
    return f"{value} ({low} to {high})"


def main() -> int:
    parser = STUDY.parser()
    parser.add_argument("--steps", type=int, default=STEPS, help="of a training")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    plan = Plan(steps=options.steps, runs=RUNS)
    trainings = [
        PushTraining(robot=ROBOT, experiment=EXPERIMENT, algorithm=ALGORITHM, run=k)
        for k in range(RUNS)
    ]
    paths = {t.run: folder(options.work, plan, t) for t in trainings}
    todo = {paths[t.run].name: (t, plan.steps, paths[t.run]) for t in trainings}
    trained = Rows(options.work / "trainings.jsonl", "").fill(
        todo, train_one, minutes=options.minutes
    )
    if len(trained) < RUNS:
        print(f"no page yet: {RUNS - len(trained)} trainings to go")
        return 1
    wanted = jobs({k: path / "policy.zip" for k, path in paths.items()})
    rows = STUDY.rows(options).fill({job.key: job for job in wanted}, measure)
    found: dict[tuple[str, float], list[Row]] = {}
    for job in wanted:
        found.setdefault((job.name, job.friction), []).extend(rows[job.key]["episodes"])
    STUDY.write_page(options, **page(found, list(trained.values())))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
