"""Treatments of friction side by side: error left, vibration, rest and softness on random paths.

    python -m benchmarks.learning.treatments [--robot R …] [--found FOLDER …] [--minutes M]

A row is one condition: robot, stiffness, how wrong the believed friction is, and what the
controller sees (delay and noise). In it every treatment follows the same random paths; then it
moves a little, holds still, and a hand pushes it slowly. Treatments have the gains of the model's
friction. With ``--found`` they are compared, on ``--paths`` random paths and on the pentagon, with
those that ``stiction tune --treatment all`` wrote there.
"""

from __future__ import annotations

import dataclasses
import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import EPISODES, Benchmark, Row
from benchmarks.learning.treatments_page import DITHER, NOTHING, SEARCHED, draw, page, searched_page
from benchmarks.learning.treatments_plan import (
    PENTAGON,
    ROBOTS,
    Condition,
    Places,
    conditions,
    random_places,
    searched,
)
from stiction_envs.control.compensation import KINDS
from stiction_envs.control.compensation_files import read_compensation
from stiction_envs.control.sensing import load_sensing
from stiction_envs.control.trajectory import Path as Goals
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.rig import dither_arrays
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import scaled, stack_friction
from stiction_envs.measured import read_amplitudes
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import load_arm
from tuning.search.bounds import bounds_of
from tuning.search.tracking import Tracking, TrackingObjective, Treatment
from tuning.search.verify import digest

Array = NDArray[np.float64]
STUDY = Benchmark(
    __file__,
    __doc__,
    made_by=(
        *EPISODES,
        "tuning/search/tracking.py",
        "benchmarks/learning/treatments.py",
        "benchmarks/learning/treatments_plan.py",
    ),
)
TABLES = Path(__file__).parents[2] / "stiction_envs" / "dither" / "tables"
SEED = 29
PATHS = random_places(8)
STEP_M, STILL_S, PUSH_S = 0.03, 4.0, 4.0
"""A goal this far away, then rest; of that the last half is looked at. Then a push of this time."""
PUSH_N = 10.0
"""Force of the hand at its end, in the direction of the step."""
LOAD_AT = (0.0, 0.0, 0.05)
"""Where a load hangs, from the flange [m]."""
SHARP = {"smooth_sign": 0.01}
"""Switch-over speed [rad/s] of a second variant: as sharp as the feedforward's is not."""


def sensing_of(condition: Condition, experiment: GeneratedTrajectoryExperiment) -> dict[str, Any]:
    """Return the argument ``sensing`` of an experiment, none where senses are ideal."""
    if condition.delay_ms is None:
        return {}
    own = load_sensing(experiment.sticking.arm, "robot")
    noisy = ("angle_noise", "speed_noise", "torque_noise")
    changes: dict[str, Any] = {
        name: tuple(condition.noise * own.of_joint(name, experiment.n)) for name in noisy
    }
    changes |= {"measurement_delay": 1e-3 * condition.delay_ms, "command_delay": 0.0}
    return {"sensing": dataclasses.replace(own, **changes, measurement_jitter=0.0)}


def treatments(robot: str) -> dict[str, Treatment]:
    """Return what is compared, by name; ``nothing`` is the first."""
    e = GeneratedTrajectoryExperiment(robot)
    dither = thesis_final_dither()
    if robot != "panda":
        dither = tuple(read_amplitudes(TABLES / f"{robot}.csv", n_joints=e.n))
    out = {NOTHING: Treatment(), DITHER: Treatment(dither=dither)}
    for kind in KINDS:
        c = e.compensation(kind)
        out[kind] = Treatment(compensation=c)
        if kind in SHARP:
            sharp = dataclasses.replace(c, speed=(SHARP[kind],) * e.n)
            out[f"{kind}, sharp"] = Treatment(compensation=sharp)
    push = dataclasses.replace(e.compensation("push"), load=(0.05,) * e.n)
    out["push, load gain 0.05"] = Treatment(compensation=push)
    out["momentum_observer and dither"] = dataclasses.replace(
        out["momentum_observer"], dither=dither
    )
    return out


def beside_found(folder: Path) -> dict[str, Treatment]:
    """Return nothing, and treatments that ``stiction tune`` found, each after its default."""
    robot, usual = told(folder)["robot"], treatments(told(folder)["robot"])
    n, out = load_arm(robot).n, {NOTHING: usual[NOTHING]}
    for name in (DITHER, *KINDS):
        path, out[name] = folder / name / "final.csv", usual[name]
        if not path.exists():
            continue
        out[name + SEARCHED] = (
            Treatment(dither=tuple(read_amplitudes(path, n_joints=n)))
            if name == DITHER
            else Treatment(compensation=read_compensation(path, name, n))
        )
    return out


def told(folder: Path) -> dict[str, Any]:
    """Return the arguments of a run of ``stiction tune``."""
    out: dict[str, Any] = json.loads((folder / "provenance.json").read_text("utf-8"))["arguments"]
    return out


# ---- measuring -----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Job:
    """What makes a row."""

    condition: Condition
    listed: Mapping[str, Treatment]
    """By name; ``nothing`` is the first."""
    places: Places

    @property
    def key(self) -> str:
        """Of its row."""
        return repr((self.condition, digest((self.places, list(self.listed.items())))))


def measure(job: Job) -> Row:
    """Return what every treatment does in a condition."""
    condition, listed, places = job.condition, job.listed, job.places
    ideal = GeneratedTrajectoryExperiment(condition.robot, seed=SEED)
    arm = ideal.sticking.arm
    loaded = load_arm(condition.robot, payload=(condition.load_kg, *LOAD_AT))
    e = GeneratedTrajectoryExperiment(
        loaded if condition.load_kg else arm,
        controller_model=arm if condition.load_kg else None,
        seed=SEED,
        threads=1,
        paths={"step": Goals("step", np.array([[STEP_M, 0, 0]]), np.array([[1.0, 0, 0, 0]]))},
        **sensing_of(condition, ideal),
    )
    true = scaled(e.sticking.parameters, {"stiction": condition.friction})
    objective = TrackingObjective(
        e,
        bounds_of(SingleJointExperiment(condition.robot)),
        [true],
        [(name, condition.stiffness) for name in places.names],
        iterations=places.iterations,
        joints=(),
    )
    plain, held = objective.plain, hold_and_push(e, listed, condition.stiffness, true)
    out: Row = {}
    for (name, treatment), rest in zip(listed.items(), held, strict=True):
        one = objective.measure([treatment])[0]  # a batch of all needs much memory
        position, orientation = one.left(plain)
        moving, resting = one.shaking
        out[name] = {
            "position_left": position,
            "orientation_left": orientation,
            "position_m": float(np.nanmean(one.position)),
            "orientation_rad": float(np.nanmean(one.orientation)),
            "left_by_path": by_path(one, plain),
            "vibration_m": moving,
            "vibration_at_rest_m": resting,
            "torque_rate_nm_s": float(one.torque_rate.max()),
            **rest,
        }
    return out


def by_path(one: Tracking, plain: Tracking) -> list[float]:
    """Return log of what is left on each path, mean of both errors over its goals."""
    ratios = (one.position / plain.position, one.orientation / plain.orientation)
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(np.concatenate(ratios, axis=-1)).reshape(len(one.position), -1)
    return [float(x[np.isfinite(x)].mean()) for x in logs]


def hold_and_push(
    experiment: GeneratedTrajectoryExperiment,
    listed: Mapping[str, Treatment],
    stiffness: tuple[float, float, float],
    true: Any,
) -> list[dict[str, float]]:
    """Return what arms do that hold still after a step, and that a hand pushes then.

    At rest: how far they are from their goal, how fast they creep, and the largest distance and
    strongest frequency of what moves about that, which is a limit cycle where there is one. The
    push: force over displacement, which is the chosen stiffness of an arm without friction.
    """
    n, count = experiment.n, len(listed)
    path = experiment.path("step")
    rig = experiment.rig(count, len(path.position), stack_friction([true] * count))
    ids = np.arange(count)
    rig.begin(ids, [path] * count, np.tile(stiffness, (count, 1)), [(0,)] * count)
    dither = [dither_arrays(t.dither, n, np.inf) for t in listed.values()]
    rig.set_dither(ids, **{k: np.stack([d[k] for d in dither]) for k in dither[0]})
    rig.compensator.set_rows(ids, [t.compensation for t in listed.values()])
    positions: list[Array] = []
    force = rig.plant.batch.bind("xfrc_applied")
    model = experiment.sticking.model
    hand = int(model.site_bodyid[model.site(experiment.sticking.arm.end_effector).id])
    still = round((experiment.nominal_duration(path) + STILL_S) / CONTROL_DT)
    push = round(PUSH_S / CONTROL_DT)

    def watch() -> None:
        positions.append(rig.end_effector.position.copy())
        force[:, hand, 0] = PUSH_N * min(max(len(positions) - still, 0) / push, 1.0)

    rig.advance(still + push, watch)
    x = np.stack(positions, axis=1)
    goal = path.goals(rig.start_position[None], rig.start_quaternion[None])[0][0, -1]
    rest = x[:, still - round(STILL_S / 2 / CONTROL_DT) : still]
    out, time = [], CONTROL_DT * np.arange(rest.shape[1])
    window = np.hanning(len(time))[:, None]
    frequencies = np.fft.rfftfreq(len(time), CONTROL_DT)
    for one, whole in zip(rest, x, strict=True):
        slope, start = np.polyfit(time, one, 1)
        off = one.mean(axis=0) - goal
        swing = one - start - time[:, None] * slope
        spectrum = np.abs(np.fft.rfft(window * swing, axis=0)).sum(axis=1)
        moved = float(whole[-1, 0] - whole[still - 1, 0])
        out.append(
            {
                "creep_m_s": float(np.linalg.norm(slope)),
                "rest_error_m": float(np.linalg.norm(off)),
                "hold_m": float(np.linalg.norm(np.ptp(swing, axis=0))),
                "hold_hz": float(frequencies[1 + int(np.argmax(spectrum[1:]))]),
                "push_n_per_m": PUSH_N / moved if moved > 0 else float("inf"),
            }
        )
    return out


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--robot", nargs="+", choices=ROBOTS, default=ROBOTS)
    parser.add_argument("--found", nargs="+", type=Path, default=(), help="folders of tune")
    parser.add_argument("--paths", type=int, default=50, help="random paths for what was found")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    usual: list[Job] = []
    again: list[Job] = []
    for robot in options.robot:
        listed = treatments(robot)
        usual += [Job(condition=c, listed=listed, places=PATHS) for c in conditions(robot)]
    for folder in options.found:
        listed = beside_found(folder)
        for c in searched(told(folder)["robot"]):
            for places in (random_places(options.paths), PENTAGON):
                again.append(Job(condition=c, listed=listed, places=places))
    jobs = {job.key: job for job in (*usual, *again)}
    rows = STUDY.rows(options).fill(jobs, measure, minutes=options.minutes)
    if rows:
        measured = {job.condition: rows[job.key] for job in usual if job.key in rows}
        judged = {(job.condition, job.places): rows[job.key] for job in again if job.key in rows}
        draw(measured, options.out / "treatments.png")
        runs = [told(folder) for folder in options.found]
        values = page(measured, len(usual)) | {"found": searched_page(judged, runs)}
        STUDY.write_page(options, **values)


if __name__ == "__main__":
    main()
