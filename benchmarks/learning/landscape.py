"""What the SJE environments pay for: return over amplitude and frequency, joint by joint.

    python -m benchmarks.learning.landscape [--kept]

Every joint is dithered alone, in its load pose, direction +, without scatter, with constant
amplitudes and frequencies. Writes landscape.csv, with terms of the reward for a weight of 1, and
the page for the default weights and for others. It takes some minutes; ``--kept`` reads the CSV.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import Benchmark
from stiction_envs.envs.evaluation import evaluate
from stiction_envs.envs.sje import SJEVectorEnv
from stiction_envs.experiments.sje.protocol import sje_reward_settings
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.markdown import signed, table_text
from stiction_envs.reporting.png import save_full

STUDY = Benchmark(__file__, __doc__)
ROBOTS, JOINTS = ("panda", "iiwa7"), range(1, 8)
SHARES = np.linspace(0.125, 1.0, 8)
"""Amplitudes over A_max [-]; assumed."""
FREQUENCIES = np.geomspace(5.0, 100.0, 7)
"""[Hz]; assumed."""
PENALTIES = ("power", "torque_rate", "shaking")
COLUMNS = ("robot", "joint", "share", "frequency_hz", "reduction", "oscillation_rad", *PENALTIES)
WEIGHTS = (0.0, 1e4, 3e4, 1e5, 2e5, 4e5)
"""Of shaking, of the mean square over the threshold's square [-]; assumed."""
Cells = dict[str, np.ndarray]
"""Columns of a joint's rows: the grid, then the ramp without dither."""


class Grid:
    """Constant actions (N, 2n) [N·m, Hz], one of each environment of a batch."""

    def __init__(self, action: np.ndarray) -> None:
        self._action = action

    def predict(self, *arguments: Any, **named: Any) -> tuple[np.ndarray, None]:
        return self._action, None


def measure(robot: str, joint: int) -> list[tuple]:
    """Return rows of the table: the grid, then the ramp without dither."""
    grid = [*((a, f) for a in SHARES for f in FREQUENCIES), (0.0, FREQUENCIES[0])]
    weights: dict[str, Any] = {f"{name}_weight": 1.0 for name in PENALTIES}
    env: Any = SJEVectorEnv(len(grid), robot=robot, scatter=False, **weights)
    low, high = env.single_action_space.low, env.single_action_space.high
    action = np.tile(low.astype(float), (len(grid), 1))
    action[:, joint - 1] = [a * high[joint - 1] for a, _ in grid]
    action[:, low.size // 2 + joint - 1] = [f for _, f in grid]
    options = {"joint": joint, "load": "load", "direction": "+"}
    rows = evaluate(env, Grid(action), [0] * len(grid), options)
    return [
        (
            *(robot, joint),
            *(
                float(f"{x:.6g}")
                for x in (
                    *(a, f, row["reduction"], 1e-3 * row["oscillation_mrad"]),
                    *(row[f"reward_{name}"] for name in PENALTIES),
                )
            ),
        )
        for (a, f), row in zip(grid, rows, strict=True)
    ]


def read(path: Path) -> dict[tuple[str, int], Cells]:
    """Return the columns of the CSV by robot and joint."""
    found: dict[tuple[str, int], list[list[float]]] = {}
    with path.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            values = [float(row[name] or "nan") for name in COLUMNS[2:]]
            found.setdefault((row["robot"], int(row["joint"])), []).append(values)
    return {k: dict(zip(COLUMNS[2:], np.array(v).T, strict=True)) for k, v in found.items()}


def returns(cells: Cells, weight: float) -> tuple[np.ndarray, float]:
    """Return the returns of the grid (amplitudes, frequencies), and without dither."""
    s = sje_reward_settings()
    value = cells["reduction"] + weight * cells["shaking"]
    value = value + s.power_weight * cells["power"] + s.torque_rate_weight * cells["torque_rate"]
    return value[:-1].reshape(len(SHARES), len(FREQUENCIES)), float(value[-1])


def best(cells: Cells, weight: float) -> tuple[int, int, float]:
    """Return the best constant: its place in the grid, and its return over no dither."""
    grid, still = returns(cells, weight)
    a, f = np.unravel_index(np.nanargmax(grid), grid.shape)  # NaN: truncated
    return int(a), int(f), float(grid[a, f] - still)


def on_edge(cells: Cells, weight: float) -> tuple[bool, bool]:
    """Return whether the best constant has the largest amplitude, and an outer frequency."""
    a, f, _ = best(cells, weight)
    return a == len(SHARES) - 1, f in (0, len(FREQUENCIES) - 1)


def page(found: dict[tuple[str, int], Cells], usual: float) -> dict[str, Any]:
    """Return what the page's template asks for."""
    rows = []
    for weight in WEIGHTS:
        for robot in ROBOTS:
            places = [best(found[robot, joint], weight) for joint in JOINTS]
            words = [
                f"{SHARES[a]:.2f} A_max, {FREQUENCIES[f]:.0f} Hz: {signed(gain, 2)}"
                for a, f, gain in places
            ]
            rows.append([f"{weight:g}", robot, *words])
    edges = {w: np.sum([on_edge(c, w) for c in found.values()], axis=0) for w in WEIGHTS}
    counts = [[f"{w:g}", *(f"{x} of {len(found)}" for x in edge)] for w, edge in edges.items()]
    return {
        "best": table_text(["weight of shaking", "robot", *(f"joint {j}" for j in JOINTS)], rows),
        "edges": table_text(["weight", "amplitude", "frequency"], counts),
        "weight": usual,
        "inside": [w for w, (_, outer) in edges.items() if not outer],
        "largest": {w: int(edge[0]) for w, edge in edges.items()},
        "total": len(found),
    }


def draw(found: dict[tuple[str, int], Cells], usual: float, path: Path) -> None:
    """Draw the landscapes without a price on shaking, and with the default one."""
    kinds = [(robot, weight) for robot in ROBOTS for weight in (0.0, usual)]
    size = (1.9 * len(JOINTS), 1.8 * len(kinds))
    figure = Figure(figsize=size, layout="constrained")
    axes: Any = figure.subplots(len(kinds), len(JOINTS), squeeze=False, sharex=True, sharey=True)
    look: dict[str, Any] = {"cmap": "RdBu", "vmin": -0.8, "vmax": 0.8, "shading": "nearest"}
    for row, (robot, weight) in zip(axes, kinds, strict=True):
        for axis, joint in zip(row, JOINTS, strict=True):
            grid, still = returns(found[robot, joint], weight)
            picture = axis.pcolormesh(FREQUENCIES, SHARES, grid - still, **look)
            a, f, gain = best(found[robot, joint], weight)
            axis.plot(FREQUENCIES[f], SHARES[a], "k*", markersize=7)
            axis.set_title(f"{robot} {joint}: {gain:+.2f}", fontsize=8)
            axis.set_xscale("log")
            axis.set_xticks([5, 20, 100], ["5", "20", "100"])
            axis.minorticks_off()
            axis.tick_params(labelsize=7)
        row[0].set_ylabel(f"amplitude / A_max\nshaking weight {weight:g}", fontsize=7)
    for axis in axes[-1]:
        axis.set_xlabel("frequency [Hz]", fontsize=7)
    figure.colorbar(picture, ax=axes, shrink=0.5, extend="both", label="return over no dither")
    save_full(figure, path)


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--kept", action="store_true", help="page of the CSV that is there")
    options = parser.parse_args()
    path, usual = STUDY.folder / "landscape.csv", sje_reward_settings().shaking_weight
    if not options.kept:
        rows = [row for robot in ROBOTS for joint in JOINTS for row in measure(robot, joint)]
        write_lines(path, COLUMNS, rows)
    found = read(path)
    STUDY.write_page(options, **page(found, usual))
    draw(found, usual, options.out / "landscape.png")


if __name__ == "__main__":
    main()
