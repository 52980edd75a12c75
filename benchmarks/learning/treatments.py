"""Treatments of friction side by side: error left, vibration, rest and softness on random paths.

    python -m benchmarks.learning.treatments [--minutes M] [--kept]

A row is one treatment in one condition: robot, stiffness, how wrong the believed friction is, and
what the controller sees (delay and noise). Every treatment follows the same random paths; then it
moves a little, holds still, and a hand pushes it slowly. Treatments have the gains of the model's
friction. Writes treatments.csv and the page of it; ``--kept`` reads the CSV.
"""

from __future__ import annotations

import csv
import dataclasses
import warnings
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.harness import EPISODES, Benchmark, Row
from stiction_envs.control.compensation import KINDS
from stiction_envs.control.laws import LAWS
from stiction_envs.control.sensing import load_sensing
from stiction_envs.control.trajectory import Path as Goals
from stiction_envs.dither.tables import HERE as TABLES
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.rig import dither_arrays
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import scaled, stack_friction
from stiction_envs.measured import read_amplitudes
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.plant import CONTROL_DT
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.png import save_full
from stiction_envs.robots import load_arm
from tuning.search.bounds import bounds_of
from tuning.search.tracking import TrackingObjective, Treatment
from tuning.settings import tuning_settings

Array = NDArray[np.float64]
MADE_BY = (*EPISODES, "tuning/search/tracking.py", "benchmarks/learning/treatments.py")
STUDY = Benchmark(__file__, __doc__, made_by=MADE_BY)
ROBOTS = ("panda", "iiwa7", "iiwa14")
SEED = 29
PATHS = tuple(f"random-{1000 + k}" for k in range(8))
"""Random paths that no search draws."""
STEP_M, STILL_S, PUSH_S = 0.03, 4.0, 4.0
"""A goal this far away, then rest; of that the last half is looked at. Then a push of this time."""
PUSH_N = 10.0
"""Force of the hand at its end, in the direction of the step."""
LOAD_AT = (0.0, 0.0, 0.05)
"""Where a load hangs, from the flange [m]."""
SHARP = 0.01
"""Switch-over speed of a second variant of the smooth sign [rad/s]."""
SWING_MM = 1.0
"""A treatment that swings by more at rest hunts, and is not recommended; assumed."""
AIM = 33
"""A third: share of each error that the best treatment is to leave at most [%]."""
NOTHING, DITHER = "nothing", "dither"
NUMBERS = {
    **dict.fromkeys(("position_percent", "orientation_percent"), 0),
    **dict.fromkeys(("vibration_mm", "vibration_at_rest_mm"), 4),
    **{"torque_rate_nm_s": 0, "still_off_mm": 2, "creep_mm_s": 4, "swing_mm": 4, "swing_hz": 1},
    "push_n_per_m": 0,
}
"""Numbers of a row, and their digits after the point."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What is the same for all treatments of a row."""

    robot: str
    stiffness_n_per_m: int = 200
    believed_percent: int = 0
    """How wrong the friction is that the controller believes."""
    delay_ms: float | None = None
    """Age of what the controller sees; None: ideal senses."""
    noise: float = 1.0
    """Noise over the robot's own [-]; counts with a delay."""
    load_kg: float = 0.0
    """On the flange, of which the controller was not told."""

    @property
    def stiffness(self) -> tuple[float, float, float]:
        """Stiffness of the impedance [N/m, N·m/rad, N·m/rad]."""
        return (self.stiffness_n_per_m, self.stiffness_n_per_m / 10, 0.0)


COLUMNS = (*(f.name for f in dataclasses.fields(Condition)), "treatment", "best", *NUMBERS)
Lines = list[dict[str, str]]
"""Rows of a CSV."""


def conditions(robot: str) -> list[Condition]:
    """Return the conditions of a robot: wrong friction, delays, noise, a load."""
    wrong = [{"delay_ms": d, "believed_percent": b} for d in (None, 1.0) for b in (0, -30, 30)]
    late = [{"delay_ms": d} for d in (0.0, 3.0, 5.0)]
    others = [{"noise": 0.33}, {"noise": 3.0}, {"load_kg": 0.5}]
    changes: list[dict[str, Any]] = [*wrong, *late, *({"delay_ms": 1.0, **x} for x in others)]
    return [Condition(robot=robot, stiffness_n_per_m=k, **x) for k in (200, 400) for x in changes]


def treatments(robot: str) -> dict[str, Treatment]:
    """Return what is compared, by name; ``nothing`` is the first."""
    e = GeneratedTrajectoryExperiment(robot)
    dither = thesis_final_dither()
    if robot != "panda":
        dither = tuple(read_amplitudes(TABLES / f"{robot}.csv", n_joints=e.n))
    usual = {kind: e.compensation(kind) for kind in KINDS}
    compensations = {
        **usual,
        "smooth_sign, sharp": dataclasses.replace(usual["smooth_sign"], speed=(SHARP,) * e.n),
        "push, load gain 0.05": dataclasses.replace(usual["push"], load=(0.05,) * e.n),
    }
    return {
        NOTHING: Treatment(),
        DITHER: Treatment(dither=dither),
        **{name: Treatment(compensation=c) for name, c in compensations.items()},
        "momentum_observer and dither": Treatment(
            dither=dither, compensation=usual["momentum_observer"]
        ),
    }


# ---- measuring -----------------------------------------------------------------------------------


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


def measure(c: Condition) -> Row:
    """Return what every treatment does in a condition, rounded, and which is best."""
    ideal = GeneratedTrajectoryExperiment(c.robot, seed=SEED)
    arm = ideal.sticking.arm
    e = GeneratedTrajectoryExperiment(
        load_arm(c.robot, payload=(c.load_kg, *LOAD_AT)) if c.load_kg else arm,
        controller_model=arm if c.load_kg else None,
        seed=SEED,
        threads=1,
        paths={"step": Goals("step", np.array([[STEP_M, 0, 0]]), np.array([[1.0, 0, 0, 0]]))},
        **sensing_of(c, ideal),
    )
    true = scaled(e.sticking.parameters, {"stiction": 1 / (1 + c.believed_percent / 100)})
    objective = TrackingObjective(
        e,
        bounds_of(SingleJointExperiment(c.robot)),
        [true],
        [(name, c.stiffness) for name in PATHS],
        iterations=1,
        joints=(),
    )
    listed, found = treatments(c.robot), {}
    held = hold_and_push(e, listed, c.stiffness, true)
    for (name, treatment), rest in zip(listed.items(), held, strict=True):
        one = objective.measure([treatment])[0]  # a batch of all needs much memory
        position, orientation = one.left(objective.plain)
        moving, resting = one.shaking
        found[name] = {
            "position_percent": 100 * position,
            "orientation_percent": 100 * orientation,
            "vibration_mm": 1e3 * moving,
            "vibration_at_rest_mm": 1e3 * resting,
            "torque_rate_nm_s": float(one.torque_rate.max()),
            **rest,
        }
    winner = best(found)
    return {
        name: {"best": int(name == winner)} | {k: f"{one[k]:.{d}f}" for k, d in NUMBERS.items()}
        for name, one in found.items()
    }


def best(found: Mapping[str, Mapping[str, float]]) -> str:
    """Return the treatment that leaves least error among those that neither shake nor hunt at rest.

    They shake at rest by no more than nothing does and the tuner's margin.
    """
    margin = 1e3 * tuning_settings().search.rest_margin
    most = found[NOTHING]["vibration_at_rest_mm"] + margin
    calm = {
        name: m["position_percent"] * m["orientation_percent"]
        for name, m in found.items()
        if m["vibration_at_rest_mm"] <= most and m["swing_mm"] <= SWING_MM
    }
    return min(calm, key=calm.__getitem__)


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
                "still_off_mm": 1e3 * float(np.linalg.norm(off)),
                "creep_mm_s": 1e3 * float(np.linalg.norm(slope)),
                "swing_mm": 1e3 * float(np.linalg.norm(np.ptp(swing, axis=0))),
                "swing_hz": float(frequencies[1 + int(np.argmax(spectrum[1:]))]),
                "push_n_per_m": PUSH_N / moved if moved > 0 else float("inf"),
            }
        )
    return out


# ---- the page ------------------------------------------------------------------------------------


def read_rows(path: Path) -> Lines:
    """Return the rows of a CSV."""
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def page(lines: Lines, searched: Lines) -> dict[str, Any]:
    """Return what the page's template asks for; rows of searched gains are shown as they are."""
    winners = [line for line in lines if line["best"] == "1"]
    wins = Counter(line["treatment"] for line in winners).most_common()
    aims = Counter(
        line["robot"]
        for line in winners
        if max(float(line["position_percent"]), float(line["orientation_percent"])) <= AIM
    )
    header = ["robot", "friction believed", "best with the model's gains", "left [%]", "both [%]"]
    header += ["best of all", "left [%]", "both [%]", "dither: left [%]"]
    rows = []
    for case in dict.fromkeys((x["robot"], x["believed_percent"]) for x in searched):
        mine = [x for x in searched if (x["robot"], x["believed_percent"]) == case]
        (usual,) = (x for x in mine if "default" in x["best"])
        (whole,) = (x for x in mine if "all" in x["best"])
        (dither,) = (x for x in mine if x["treatment"] == DITHER)
        wrong = f"{int(case[1]):+} %" if int(case[1]) else "known"
        rows.append([case[0], wrong, *_cells(usual), *_cells(whole), _cells(dither)[1]])
    return {
        "wins": [f"{name} in {count}" for name, count in wins],
        "dither_wins": dict(wins).get(DITHER, 0),
        "measured": len(winners),
        "aims": [f"{aims[robot]} of {len(winners) // 3} on the {robot}" for robot in ROBOTS],
        "table": table_text(header, rows),
        "needs": {name: law.knows for name, law in LAWS.items()},
        "margin_mm": 1e3 * tuning_settings().search.rest_margin,
        "swing_mm": SWING_MM,
    }


def _cells(line: Mapping[str, str]) -> list[str]:
    left = f"{line['position_percent']} / {line['orientation_percent']}"
    both = f"{line['both_percent']} ({line['low_percent']} to {line['high_percent']})"
    return [line["treatment"], left, both]


def draw(lines: Lines, path: Path) -> None:
    """Draw error left against vibration of every treatment, a field per robot, 200 N/m, 1 ms late.

    Sizes of points are noise levels.
    """
    usual = {"stiffness_n_per_m": "200", "believed_percent": "0", "delay_ms": "1.0"}
    usual["load_kg"] = "0.0"
    shown = [line for line in lines if all(line[k] == x for k, x in usual.items())]
    figure = Figure(figsize=(14.8, 4.2), layout="constrained")
    for axes, robot in zip(figure.subplots(1, len(ROBOTS)), ROBOTS, strict=True):
        mine = [line for line in shown if line["robot"] == robot]
        for j, name in enumerate(dict.fromkeys(line["treatment"] for line in mine)):
            at = sorted((x for x in mine if x["treatment"] == name), key=lambda x: x["noise"])
            left = [
                np.array([float(x[f"{k}_percent"]) for x in at])
                for k in ("position", "orientation")
            ]
            axes.scatter(
                [float(x["vibration_at_rest_mm"]) for x in at],
                np.sqrt(left[0] * left[1]),
                s=[14 + 26 * i for i in range(len(at))],
                color=f"C{j % 10}",
                marker="os"[j // 10],
                label=name,
            )
        axes.set(title=robot, xlabel="vibration at rest [mm]", ylabel="error left at goals [%]")
        axes.axhline(AIM, color="0.7", linewidth=1, zorder=0)
        axes.set(xlim=(0, None), ylim=(0, 130))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    save_full(figure, path)


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--kept", action="store_true", help="page of the CSV that is there")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    path = STUDY.folder / "treatments.csv"
    if not options.kept:
        jobs = {repr(c): c for robot in ROBOTS for c in conditions(robot)}
        rows = STUDY.rows(options).fill(jobs, measure, minutes=options.minutes)
        write_lines(path, COLUMNS, [x for key, row in rows.items() for x in _of(jobs[key], row)])
    lines, searched = read_rows(path), read_rows(STUDY.folder / "treatments_searched.csv")
    draw(lines, options.out / "treatments.png")
    STUDY.write_page(options, **page(lines, searched))


def _of(c: Condition, row: Row) -> list[tuple[Any, ...]]:
    """Return a condition's lines of the CSV."""
    place = ["" if x is None else x for x in dataclasses.astuple(c)]
    return [(*place, name, *one.values()) for name, one in row.items() if name != "seconds"]


if __name__ == "__main__":
    main()
