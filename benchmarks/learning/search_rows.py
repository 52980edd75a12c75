"""Rows of `search`: the tables of ``search/``, measured on paths and joint by joint."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import EPISODES, Row, Rows
from benchmarks.learning.search_page import Measured
from stiction_envs.control.compensation_files import read_compensation
from stiction_envs.dither.tables import HERE as TABLES
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.rows import thesis_final_dither, thesis_stiffness
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.measured import read_amplitudes
from tuning.search.bounds import bounds_of
from tuning.search.breakaway import BreakawayObjective
from tuning.search.frictions import scaled
from tuning.search.tracking import Table, TrackingObjective, Treatment
from tuning.search.verify import PATHS, another_start
from tuning.settings import tuning_settings

KEPT = Path(__file__).parent / "search"
JOINTS = 7
"""Of every arm here."""
SEED = 4242
"""Of what is measured here: no search has seen it."""
ITERATIONS, STARTS = 4, 4
"""Of each case, and other start poses; assumed."""
WIDTHS = (5e-5, 2e-4, 5e-4, 2e-3)
"""Of pushes, whose limit cycles are looked for [rad]; assumed."""
GAINS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
"""Of these, over the friction [-]; assumed."""
MEASURED_BY = (
    *EPISODES,
    "!stiction_envs/envs",
    "tuning",
    "!tuning/policies",
    "benchmarks/learning/search_rows.py",
)
"""Code that decides a row; tables and gains are in its key."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What is otherwise than the controller believes."""

    factors: Mapping[str, float] = field(default_factory=dict)
    """Of the friction's quantities, over those that are believed [-]."""
    starts: int = 0
    """Other poses that the arm starts from, instead of its rest."""


NOMINAL = "friction known"
CONDITIONS = {
    NOMINAL: Condition(),
    "friction believed 30 % too small": Condition(factors={"stiction": 1 / 0.7}),
    "friction believed 30 % too large": Condition(factors={"stiction": 1 / 1.3}),
    "friction and rotor +20 %": Condition(factors={"stiction": 1.2, "rotor_inertia": 1.2}),
    "friction and rotor −20 %": Condition(factors={"stiction": 0.8, "rotor_inertia": 0.8}),
    f"{STARTS} other start poses": Condition(starts=STARTS),
}


# ---- what is compared ----------------------------------------------------------------------------


def table_of(path: Path) -> Table:
    """Return a table of amplitudes."""
    return tuple(read_amplitudes(path, n_joints=JOINTS))


def known_tables(robot: str) -> dict[str, Table]:
    """Return the tables of an arm that no search has found, by name."""
    thesis = {"Table 4.9": thesis_final_dither()} if robot == "panda" else {}
    return {**thesis, "make tune": table_of(TABLES / f"{robot}.csv")}


def joint_tables(robot: str) -> dict[str, Table]:
    """Return tables for the SJE, by name."""
    known, found = known_tables(robot), table_of(KEPT / f"{robot}_sje.csv")
    nothing = [replace(r, frequency_hz=0.0, amplitude_nm=0.0) for r in known["make tune"]]
    return {"nothing": tuple(nothing), **known, "search": found}


def treatments(robot: str) -> dict[str, Treatment]:
    """Return what is done on paths, by name, as the controller believes the friction to be."""
    tables = known_tables(robot) | {"search, constant": table_of(KEPT / f"{robot}_gte.csv")}
    out = {"nothing": Treatment(), **{k: Treatment(dither=x) for k, x in tables.items()}}
    if robot != "panda":
        return out

    def gains(name: str, kind: str) -> Any:
        return read_compensation(KEPT / f"panda_{name}_gains.csv", kind, JOINTS)

    experiment = GeneratedTrajectoryExperiment(robot, seed=SEED)
    longer = table_of(KEPT / "panda_gte_gated_1600.csv")
    return {
        **out,
        "search, gated": Treatment(dither=table_of(KEPT / "panda_gte_gated.csv")),
        "common gate, 1600 evaluations": Treatment(dither=longer),
        "the same without its gate": Treatment(
            dither=tuple(replace(row, gate_rad_s=0.0) for row in longer)
        ),
        "the same from another seed": Treatment(
            dither=table_of(KEPT / "panda_gte_gated_1600_seed1.csv")
        ),
        "feedforward": Treatment(compensation=experiment.compensation("feedforward")),
        "feedforward, searched": Treatment(compensation=gains("feedforward", "feedforward")),
        "push": Treatment(compensation=experiment.compensation("push")),
        "push, searched": Treatment(compensation=gains("push", "push")),
        "push and dither, searched": Treatment(
            dither=table_of(KEPT / "panda_gte_push_dither.csv"),
            compensation=gains("push_dither", "push"),
        ),
    }


# ---- measuring -----------------------------------------------------------------------------------


def measured(
    rows: Rows, keys: Sequence[Any], measure: Callable[[list[int]], list[Row]]
) -> list[Row]:
    """Return the rows of some things; what is kept is not measured again.

    Args:
        rows: those that are kept.
        keys: all that a row depends on besides the code.
        measure: returns the rows of places in ``keys``.
    """
    texts = [repr(key) for key in keys]
    missing = [k for k, text in enumerate(texts) if text not in rows]
    for k, row in zip(missing, measure(missing) if missing else (), strict=True):
        rows.add(texts[k], row)
    return [rows[text] for text in texts]


def paths(robot: str, rows: Rows, conditions: Sequence[str]) -> Measured:
    """Return what every treatment leaves, per condition and path, over nothing."""
    listed = treatments(robot)
    out: Measured = {}
    for name in conditions:
        out[name] = {}
        for path in PATHS:
            keys = [(robot, name, path, treatment) for treatment in listed.values()]
            measure = partial(_on_path, robot, CONDITIONS[name], path, list(listed.values()))
            out[name][path] = dict(zip(listed, measured(rows, keys, measure), strict=True))
            print(robot, name, path, flush=True)
    return out


def _on_path(
    robot: str, condition: Condition, path: str, listed: list[Treatment], wanted: list[int]
) -> list[Row]:
    rest = GeneratedTrajectoryExperiment(robot, seed=SEED)
    arm, most = rest.sticking.arm, tuning_settings().search.verify_start
    starts = [another_start(arm, most, [SEED, k]) for k in range(condition.starts)]
    factors = {name: factor * np.ones(arm.n) for name, factor in condition.factors.items()}
    found: list[list[dict[str, float]]] = []
    for start in starts or [rest.start]:
        objective = TrackingObjective(
            GeneratedTrajectoryExperiment(robot, seed=SEED, start=start),
            bounds_of(SingleJointExperiment(robot)),
            [scaled(rest.sticking.parameters, factors)],
            [(path, k) for k in thesis_stiffness()],
            iterations=ITERATIONS,
            joints=range(1, arm.n + 1),
        )
        found.append([])
        for one in objective.measure([listed[k] for k in wanted]):
            row = {name: float(x.mean()) for name, x in one.by_friction(objective.plain).items()}
            moving, resting = one.shaking
            found[-1].append({**row, "vibration_m": moving, "vibration_at_rest_m": resting})
    # geometric means over starts
    return [
        {name: float(np.exp(np.mean([np.log(row[name]) for row in rows]))) for name in rows[0]}
        for rows in zip(*found, strict=True)
    ]


def joints(robot: str, rows: Rows) -> dict[str, list[Row]]:
    """Return the share left of each joint's breakaway torque, and its displacement, per table."""
    tables = joint_tables(robot)
    flat = [row for table in tables.values() for row in table]

    def measure(wanted: list[int]) -> list[Row]:
        experiment = SingleJointExperiment(robot, seed=SEED)
        objective = BreakawayObjective(
            experiment,
            bounds_of(experiment),
            [experiment.sticking.parameters],
            iterations=ITERATIONS,
        )
        found = objective.measure([flat[k] for k in wanted])
        return [
            {"left": found[flat[k]].left, "displacement_rad": found[flat[k]].displacement}
            for k in wanted
        ]

    found = iter(measured(rows, [(robot, "sje", row) for row in flat], measure))
    out = {name: [next(found) for _ in table] for name, table in tables.items()}
    print(robot, "joints", flush=True)
    return out


def hunting(rows: Rows) -> list[list[float]]:
    """Return the vibration at rest [m] of pushes, by width and by gain over the friction."""
    experiment = GeneratedTrajectoryExperiment("panda", seed=SEED)
    usual = [experiment.compensation("push", gain) for gain in GAINS]
    listed = [
        Treatment(compensation=replace(push, error=(width,) * push.n))
        for width in WIDTHS
        for push in usual
    ]

    def measure(wanted: list[int]) -> list[Row]:
        objective = TrackingObjective(
            experiment,
            bounds_of(SingleJointExperiment("panda")),
            [experiment.sticking.parameters],
            [(PATHS[0], thesis_stiffness()[0])],
            iterations=2,
            joints=(),
        )
        tried = objective.measure([listed[k] for k in wanted])
        return [{"vibration_at_rest_m": one.shaking[1]} for one in tried]

    found = measured(rows, [("hunting", t) for t in listed], measure)
    shaken = [row["vibration_at_rest_m"] for row in found]
    return np.reshape(shaken, (len(WIDTHS), len(GAINS))).tolist()
