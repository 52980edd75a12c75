"""How many evaluations a joint until a search is within two points of the best: by sampler.

    python -m benchmarks.search_evaluations [--work DIR] [--seeds 20]

The Panda's joints are mapped once, amplitude × frequency, in the plant (kept in DIR); searches then
run on the map, bilinear between its points, under the limit on displacement of thesis Table 4.9.
Writes search_evaluations.md and search_evaluations.png beside this file.
"""

from __future__ import annotations

import argparse
import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import optuna
from matplotlib.figure import Figure
from scipy.interpolate import RegularGridInterpolator

from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.markdown import table
from stiction_envs.reporting.png import save_full
from tuning.explore.bounds import bounds_of
from tuning.explore.breakaway import BreakawayObjective
from tuning.record import Outcome, Record, Search, run
from tuning.rules import frequencies_of
from tuning.samplers import sampler
from tuning.settings import tuning_settings

HERE = Path(__file__).parent
F = np.geomspace(15.0, 80.0, 15)
SHARE = np.linspace(0.0, 1.0, 13)
WITHIN = 0.02
MOST = {"gp": 24, "tpe": 60, "cmaes": 60, "random": 60}
POPULATION = 6


def mapped(work: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return left (7, 15, 13), displacement (7, 15, 13) [rad] and its limit (7,) [rad]."""
    kept = work / "map.json"
    if not kept.exists():
        experiment = SingleJointExperiment("panda")
        bounds = bounds_of(experiment)
        objective = BreakawayObjective(
            experiment,
            bounds,
            [experiment.sticking.parameters],
            iterations=1,
            limits=thesis_final_dither(),
        )
        rows = {
            (j, k, m): bounds.setting(j + 1, {"frequency_hz": float(f), "amplitude": float(s)})
            for j in range(7)
            for k, f in enumerate(F)
            for m, s in enumerate(SHARE)
        }
        found = objective.measure([r for r in rows.values() if r.amplitude_nm > 0])
        left, shaken = np.ones((7, 15, 13)), np.zeros((7, 15, 13))
        for at, row in rows.items():
            if row in found:
                left[at], shaken[at] = found[row].left, found[row].displacement
        limit = objective.displacement
        text = {"left": left.tolist(), "shaken": shaken.tolist(), "limit": limit.tolist()}
        write_text_atomic(kept, json.dumps(text))
    read = json.loads(kept.read_text())
    return np.array(read["left"]), np.array(read["shaken"]), np.array(read["limit"])


class Reached(Exception):
    """A search is within two points of the best: there is no need to go on."""


class Joint:
    """One joint's map, continuous."""

    def __init__(self, left: np.ndarray, shaken: np.ndarray, limit: float) -> None:
        axes = (np.log(F), SHARE)
        self.left, self.shaken = (RegularGridInterpolator(axes, x) for x in (left, shaken))
        self.limit = limit
        f, s = np.meshgrid(np.linspace(*np.log(F[[0, -1]]), 400), np.linspace(0, 1, 400))
        points = np.stack([f.ravel(), s.ravel()], axis=1)
        allowed = self.shaken(points) <= limit
        self.best = float(self.left(points)[allowed].min())

    def at(self, frequency_hz: float, share: float) -> tuple[float, float]:
        point = [[np.log(frequency_hz), share]]
        return float(self.left(point)[0]), float(self.shaken(point)[0])

    def evaluate(self, asked: list) -> list[Outcome]:
        out = []
        for _, parameters in asked:
            left, shaken = self.at(parameters["frequency_hz"], parameters["amplitude"])
            over = shaken / self.limit - 1.0
            out.append(Outcome(values=(left,), constraints=(over,), measures={"left": left}))
        return out


def needed(joint: Joint, bounds, number: int, name: str, seed: int) -> int:
    """Return how many evaluations until an allowed setting is within 2 points of the best."""
    most = MOST[name]
    space = bounds.space(number)
    search = Search(
        record=Record("sqlite://", "map", about={}),
        space=space,
        sampler=sampler(
            name,
            space,
            seed=seed,
            startup=tuning_settings().search.startup,
            population=POPULATION,
        ),
        evaluations=most,
        batch=POPULATION if name == "cmaes" else 1,
    )

    tried = 0

    def evaluate(asked):
        nonlocal tried
        outcomes = joint.evaluate(asked)
        for o in outcomes:
            tried += 1
            if o.constraints[0] <= 0 and o.values[0] <= joint.best + WITHIN:
                raise Reached
        if name != "cmaes":
            return outcomes
        penalty = tuning_settings().search.penalty
        return [
            replace(o, values=(o.values[0] + penalty * max(o.constraints[0], 0.0),))
            for o in outcomes
        ]

    try:
        run([search], evaluate)
    except Reached:
        return tried
    return most + 1


def grid_misses(joint: Joint, bounds, number: int, base: float) -> float:
    """Return by how many points the best allowed point of the thesis's grid misses the best."""
    settings = tuning_settings().thesis
    best = 1.0
    for f in frequencies_of("panda"):
        for scale in settings.scales:
            share = min(scale * base / bounds.largest(number, f), 1.0)
            left, shaken = joint.at(f, share)
            if shaken <= joint.limit:
                best = min(best, left)
    return 100 * (best - joint.best)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("runs/benchmarks/map"))
    parser.add_argument("--seeds", type=int, default=20)
    asked = parser.parse_args()
    asked.work.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    left, shaken, limit = mapped(asked.work)
    experiment = SingleJointExperiment("panda")
    bounds = bounds_of(experiment)
    joints = [Joint(*x) for x in zip(left, shaken, limit, strict=True)]
    kept = asked.work / "needed.json"
    counts = json.loads(kept.read_text()) if kept.exists() else {}
    for name in MOST:
        for j, joint in enumerate(joints, 1):
            for seed in range(asked.seeds):
                key = f"{name} {j} {seed}"
                if key not in counts:
                    counts[key] = needed(joint, bounds, j, name, seed)
                    kept.write_text(json.dumps(counts))
            print(name, j, flush=True)
    rows = []
    for name, most in MOST.items():
        row = [name]
        for j in range(1, 8):
            mine = np.array([counts[f"{name} {j} {s}"] for s in range(asked.seeds)])
            low, middle, high = np.percentile(mine, [25, 50, 75])
            text = [f"{x:.0f}" if x <= most else f"> {most}" for x in (middle, low, high)]
            row.append(f"{text[0]} ({text[1]} … {text[2]})")
        rows.append(row)
    base = bounds.amplitude_nm[:, 1] / tuning_settings().bounds.largest_scale
    misses = [f"{grid_misses(x, bounds, j, base[j - 1]):.1f}" for j, x in enumerate(joints, 1)]
    best = [f"{100 * (1 - x.best):.1f}" for x in joints]
    write_text_atomic(
        HERE / "search_evaluations.md",
        "\n".join(
            [
                "# How many evaluations does a search need?",
                "",
                "Made by `python -m benchmarks.search_evaluations`. The Panda's joints, amplitude "
                "× frequency, mapped in the plant without drawn frictions "
                f"({len(F)} × {len(SHARE)} points a joint); searches run on the map. Evaluations "
                "until an allowed setting is within 2 points of the best allowed one of the map: "
                f"median and quartiles of {asked.seeds} seeds. Allowed is what displaces the joint "
                "no more than thesis Table 4.9 does. cmaes asks in generations of "
                f"{POPULATION}, all others one by one.",
                "",
                *table(["sampler", *(f"joint {j}" for j in range(1, 8))], rows),
                "",
                *table(
                    ["", *(f"joint {j}" for j in range(1, 8))],
                    [
                        ["best allowed reduction [%]", *best],
                        ["the thesis's grid (12 settings) misses it by [points]", *misses],
                    ],
                ),
                "",
                "![the maps](search_evaluations.png)",
                "",
            ]
        ),
    )
    figure = Figure(figsize=(13, 6), layout="constrained")
    axes = np.ravel(figure.subplots(2, 4))
    axes[7].axis("off")
    image = None
    for j, axis in enumerate(axes[:7]):
        amplitude = np.array([[s * bounds.largest(j + 1, f) for s in SHARE] for f in F])
        f = np.repeat(F[:, None], len(SHARE), axis=1)
        levels = np.arange(-10, 101, 5)
        reduction = 100 * (1 - left[j])
        image = axis.contourf(f, amplitude, reduction, levels=levels, cmap="viridis")
        axis.contour(f, amplitude, shaken[j] / limit[j], levels=[1.0], colors="w", linestyles="--")
        row = thesis_final_dither()[j]
        axis.plot(row.frequency_hz, row.amplitude_nm, "s", color="#d1701a", mec="w", label="4.9")
        axis.set_xscale("log")
        axis.set_xticks([15, 20, 30, 50, 80], ["15", "20", "30", "50", "80"])
        axis.minorticks_off()
        axis.set(title=f"joint {j + 1}", xlabel="frequency [Hz]", ylabel="amplitude [N·m]")
    figure.colorbar(image, ax=axes, label="reduction of the breakaway torque [%]", shrink=0.7)
    axes[7].text(
        0.0,
        0.5,
        "dashed: displacement of Table 4.9\nsquare: Table 4.9",
        transform=axes[7].transAxes,
    )
    save_full(figure, HERE / "search_evaluations.png")


if __name__ == "__main__":
    main()
