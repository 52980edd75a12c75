"""Rows of `search`: the tables and gains of ``search/``, measured on paths and joint by joint."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from benchmarks.harness import EPISODES, Row
from stiction_envs.control.compensation import Compensation
from stiction_envs.control.compensation_files import read_compensation
from stiction_envs.dither.tables import HERE as TABLES
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.rows import thesis_final_dither, thesis_stiffness
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import scaled
from stiction_envs.measured import read_amplitudes
from tuning.search.bounds import bounds_of
from tuning.search.breakaway import BreakawayObjective
from tuning.search.tracking import Table, TrackingObjective, Treatment
from tuning.search.verify import PATHS

KEPT = Path(__file__).parent / "search"
JOINTS = 7
"""Number of joints of every arm here."""
SEED = 4242
"""Seed of the measurements: no search has seen it."""
ITERATIONS = 4
"""Repeats of each case; assumed."""
ROBOTS = ("panda", "iiwa7", "iiwa14")
SJE = "single joints"
"""Place of the rows of the Single Joint Experiment, where others have a path."""
LEFT = ("position", "orientation", "resting_position", "resting_orientation")
MEASURED_BY = (
    *EPISODES,
    "!stiction_envs/envs",
    "tuning",
    "!tuning/policies",
    "benchmarks/learning/search_rows.py",
    "benchmarks/learning/search",
)
"""Code, tables and gains that decide a row."""


KNOWN = "friction known"
CONDITIONS = {
    KNOWN: 1.0,
    "friction believed 30 % too small": 1 / 0.7,
    "friction believed 30 % too large": 1 / 1.3,
}
"""Stiction over that which the controller believes [-]."""


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

    def gains(name: str, kind: str) -> Compensation:
        return read_compensation(KEPT / f"panda_{name}_gains.csv", kind, JOINTS)

    gated, both = (table_of(KEPT / f"panda_gte_{x}.csv") for x in ("gated_1600", "push_dither"))
    out["common gate, 1600 evaluations"] = Treatment(dither=gated)
    usual = GeneratedTrajectoryExperiment(robot, seed=SEED).compensation
    for kind in ("feedforward", "push"):
        out[kind] = Treatment(compensation=usual(kind))
        out[f"{kind}, searched"] = Treatment(compensation=gains(kind, kind))
    compensation = gains("push_dither", "push")
    out["push and dither, searched"] = Treatment(dither=both, compensation=compensation)
    return out


# ---- measuring -----------------------------------------------------------------------------------


def on_path(robot: str, condition: str, path: str) -> dict[str, Row]:
    """Return what every treatment leaves over nothing, and its vibration."""
    experiment, listed = GeneratedTrajectoryExperiment(robot, seed=SEED), treatments(robot)
    true = scaled(experiment.sticking.parameters, {"stiction": CONDITIONS[condition]})
    objective = TrackingObjective(
        experiment,
        bounds_of(SingleJointExperiment(robot)),
        [true],
        [(path, k) for k in thesis_stiffness()],
        iterations=ITERATIONS,
        joints=range(1, experiment.n + 1),
    )
    out = {}
    for name, one in zip(listed, objective.measure(list(listed.values())), strict=True):
        left = one.by_friction(objective.plain)
        out[name] = {f"{part}_percent": f"{100 * float(left[part].mean()):.0f}" for part in LEFT}
        names = ("vibration_mm", "vibration_at_rest_mm")
        out[name] |= {k: f"{1e3 * x:.3f}" for k, x in zip(names, one.shaking, strict=True)}
    return out


def of_joints(robot: str) -> dict[str, Row]:
    """Return the reduction of each joint's breakaway torque and its displacement, per table."""
    tables, experiment = joint_tables(robot), SingleJointExperiment(robot, seed=SEED)
    objective = BreakawayObjective(
        experiment,
        bounds_of(experiment),
        [experiment.sticking.parameters],
        iterations=ITERATIONS,
    )
    found = objective.measure([row for table in tables.values() for row in table])
    out: dict[str, Row] = {name: {} for name in tables}
    for name, table in tables.items():
        for row in table:
            key, one = f"joint_{row.joint}", found[row]
            out[name][f"{key}_reduction_percent"] = f"{100 * (1 - one.left):.1f}"
            out[name][f"{key}_displacement_mrad"] = f"{1e3 * one.displacement:.3f}"
    return out


def measure(job: tuple[str, str, str]) -> Row:
    """Return numbers, rounded, by treatment and name, of a robot, condition and path."""
    return of_joints(job[0]) if job[2] == SJE else on_path(*job)


def jobs() -> dict[str, tuple[str, str, str]]:
    """Return all that is measured, by key: the iiwas only where friction is known."""
    out = [
        (robot, condition, path)
        for robot in ROBOTS
        for condition in (CONDITIONS if robot == "panda" else (KNOWN,))
        for path in PATHS
    ]
    out += [(robot, KNOWN, SJE) for robot in ROBOTS]
    return {", ".join(job): job for job in out}
