"""What the policy benchmark compares: agents, tasks, frictions, trainings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from benchmarks.learning.search_rows import JOINTS, KEPT, known_tables, table_of
from stiction_envs.control.compensation import Compensation
from stiction_envs.control.compensation_files import read_compensation
from stiction_envs.envs.agents import ConstantTable, GatedTable, NoDither, RandomDither, TorqueRule
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.rows import thesis_stiffness
from stiction_envs.measured import AmplitudeRow
from stiction_envs.method_settings import override
from stiction_envs.precomputed.store import digest
from stiction_envs.robots.registry import ARMS
from tuning.policies.evaluation import best_gated, gated_file, within_bounds
from tuning.policies.settings import PolicySettings, policy_settings
from tuning.policies.task import Task

Table = tuple[AmplitudeRow, ...]
SPREADS = {"friction": 0.2, "rotor": 0.2, "bristles": 0.3, "load": 0.5}
"""Of the arms that are trained on [-]: assumed, since no source says how far two arms of one make
are apart. Friction and rotor vary as far as the test's frictions do (`Plan.frictions`), bristle
stiffness and load dependence, which are known from fits alone, further."""
SHAKING_WEIGHT = 1.0
"""Of the GTE's reward here, assumed: a millimetre of shaking all along costs as much as the whole
undithered error. With the environment's 0.01 whoever shakes most is best."""
ALGORITHMS = ("ppo", "td3", "sac")
SJE_ALGORITHM = "ppo"
CHANGES = {"ppo": {"ppo.rollout": 128, "ppo.batch_size": 1024}}
"""Settings that are not the defaults, assumed: few, larger updates. With the defaults PPO left the
table that it began with, downhill: -0.926 to -0.955 and -0.960 to -0.990 in 120,000 steps."""
FROM_A_TABLE = ("ppo",)
"""Algorithms whose policies begin with the best constant table. The others forget it: with a critic
that knows nothing, 10,000 steps of the Panda's GTE took TD3 and SAC from -0.930 to -0.997."""
NOMINAL = 1.0
"""Friction over the one that is known."""
RANDOM_PATHS = "random paths"
TRAINED = {alg: alg.upper() for alg in ALGORITHMS}
BASELINES = {"panda": "Table 4.9", "iiwa7": "make tune"}
"""Whom an improvement is over: the thesis has Table 4.9 for the Panda alone."""
SEARCHED = "search, constant"
CONSTANT = ("Table 4.9", "make tune", SEARCHED)
RULES = ("gated", "rule")
BOUND = "no dither, 1 % of the friction"
"""What is left by the controller's lag alone: dither, which takes friction away at best, cannot do
better."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much is done; the defaults are the benchmark."""

    steps: int = 300_000
    """Of a training."""
    runs: int = 5
    """Trainings with other seeds; of an agent that learns nothing, repeats with other episodes."""
    paths: int = 50
    """Random paths that no training draws."""
    frictions: tuple[float, ...] = (NOMINAL, 0.8, 1.2)
    """Over the nominal one."""
    robots: tuple[str, ...] = ("panda", "iiwa7")
    """Of the benchmark."""


SMALL = Plan(steps=6000, runs=2, paths=3, frictions=(NOMINAL, 1.2))
"""All that the benchmark does, of each a little: it shows that it runs, and nothing else."""


@dataclass(frozen=True, kw_only=True)
class Contestant:
    """An agent that is compared, before there is an environment."""

    name: str
    """On the page."""
    make: Callable[[Any], Any]
    """Returns the agent of an environment."""
    made_of: str
    """Hash of what it is, besides code."""
    compensation: Compensation | None = None
    """Of the friction, besides what it does."""
    run: int | None = None
    """Its only run, as a training has one; None for all."""
    friction: float = 1.0
    """Over the cell's true one: below 1 it is no agent, but a bound of what any could do."""


@dataclass(frozen=True, kw_only=True)
class Training:
    """One training."""

    robot: str
    """Name of the arm."""
    experiment: str
    """``sje`` or ``gte``."""
    algorithm: str
    """One of `ALGORITHMS`."""
    run: int
    """Its seed."""

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.robot}-{self.experiment}-{self.algorithm}-{self.run}"

    @property
    def settings(self) -> PolicySettings:
        """How it is trained: by the defaults, but `CHANGES`."""
        return override(policy_settings(), CHANGES.get(self.algorithm, {}))

    @property
    def start(self) -> Table:
        """The constant table that its policy begins with: the best one that a search found.

        Amplitudes beyond the action's bounds are cut; none where the algorithm forgets it.
        """
        if self.algorithm not in FROM_A_TABLE:
            return ()
        env = environment(self.robot, self.experiment).make(1)
        out = within_bounds(env, tables(self.robot, self.experiment)[SEARCHED])
        env.close()
        return tuple(row for row in out if row.amplitude_nm)

    @property
    def task(self) -> Task:
        """What is trained on: random paths, other frictions."""
        more = {"fixed_options": {"trajectory": "random"}} if self.experiment == "gte" else {}
        return environment(self.robot, self.experiment, randomise=SPREADS, threads=1, **more)


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Episodes that all agents meet."""

    robot: str
    """Name of the arm."""
    experiment: str
    """``sje`` or ``gte``."""
    task: str
    """Name of the episodes, on the page."""
    friction: float
    """Over the nominal one."""
    options: tuple[Mapping[str, Any], ...] = field(repr=False, compare=False)
    """Reset options of each episode of a run: rliable's tasks."""


def environment(robot: str, experiment: str, *, threads: int = 0, **arguments: Any) -> Task:
    """Return the environment of trainings and tests, which differ in ``arguments``."""
    if experiment == "gte":
        arguments["shaking_weight"] = SHAKING_WEIGHT
    return Task(robot=robot, experiment=experiment, arguments=arguments, threads=threads)


def cells(plan: Plan) -> list[Cell]:
    """Return all that is measured."""
    first = policy_settings().evaluation.test_paths
    tasks: list[tuple[str, str, list[Any]]] = [
        ("gte", RANDOM_PATHS, [{"path": first + k} for k in range(plan.paths)])
    ]
    for name in ("triangle", "pentagon"):
        both = [{"trajectory": name, "stiffness": k} for k in thesis_stiffness()]
        tasks.append(("gte", name, both))
    names = "joint", "load", "direction"
    ramps = product(range(1, JOINTS + 1), ("load", "no_load"), "+-")
    tasks.append(("sje", "ramps", [dict(zip(names, x, strict=True)) for x in ramps]))
    return [
        Cell(robot=robot, experiment=e, task=name, friction=friction, options=tuple(options))
        for robot in plan.robots
        for e, name, options in tasks
        for friction in plan.frictions
    ]


def trainings(plan: Plan, best: str | None) -> list[Training]:
    """Return all trainings; ``best`` is the algorithm of the iiwa, None while nobody knows it."""
    out = [("panda", "gte", alg) for alg in ALGORITHMS] + [("panda", "sje", SJE_ALGORITHM)]
    out += [(robot, "gte", best) for robot in plan.robots if robot != "panda" and best]
    return [
        Training(robot=robot, experiment=e, algorithm=alg, run=k)
        for robot, e, alg in out
        for k in range(plan.runs)
    ]


# ---- agents that learn nothing -------------------------------------------------------------------


def tables(robot: str, experiment: str) -> dict[str, Table]:
    """Return the constant tables of an arm by name."""
    return known_tables(robot) | {SEARCHED: table_of(KEPT / f"{robot}_{experiment}.csv")}


def unlearned(robot: str, experiment: str) -> list[Contestant]:
    """Return the agents that learn nothing."""
    found = tables(robot, experiment)

    def plain(name: str, kind: Callable[[Any], Any] = NoDither, **more: Any) -> Contestant:
        return Contestant(name=name, make=kind, made_of=digest(name), **more)

    def of_table(name: str, kind: Any, table: Table) -> Contestant:
        made_of = digest(kind.__name__, table)
        return Contestant(
            name=name, make=lambda env: kind(env, within_bounds(env, table)), made_of=made_of
        )

    constant = [of_table(name, ConstantTable, table) for name, table in found.items()]
    rule = of_table("rule", TorqueRule, found[BASELINES[robot]])
    out = [plain("none"), plain("random", RandomDither)]
    if experiment == "sje":
        return [*out, *constant, rule]
    shipped = gated_file(robot)  # what ``--policy gated`` plays
    if shipped is None:
        gated = of_table("search, default gate", GatedTable, found[SEARCHED])
    else:
        make, made_of = partial(best_gated, robot), digest("gated", table_of(shipped))
        gated = Contestant(name="gated", make=make, made_of=made_of)
    compensated = [_compensated(robot, kind) for kind in ("feedforward", "push")]
    return [*out, plain(BOUND, friction=0.01), *constant, gated, rule, *compensated]


def _compensated(robot: str, kind: str) -> Contestant:
    """Return compensation without dither, as the search tuned it, else as the model has it."""
    path = KEPT / f"{robot}_{kind}_gains.csv"
    if path.exists():
        found = read_compensation(path, kind, JOINTS)
    else:
        experiment = environment(robot, "gte").make(1).core.experiment
        assert isinstance(experiment, GeneratedTrajectoryExperiment)
        found = experiment.compensation(kind)
    return Contestant(name=kind, make=NoDither, made_of=digest(kind, found), compensation=found)


def learned(training: Training, policy: Path) -> Contestant:
    """Return what a training gave: its ``policy.zip``."""
    from tuning.policies.evaluation import read_agent

    task = replace(training.task, threads=0)
    return Contestant(
        name=TRAINED[training.algorithm],
        make=lambda env: read_agent(str(policy), task, env),
        made_of=digest(policy.read_bytes()),
        run=training.run,
    )


def title(robot: str) -> str:
    """Return what people call an arm."""
    return ARMS[robot].environment or robot
