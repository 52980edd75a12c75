"""What the SJE environments pay for: return over amplitude and frequency, joint by joint.

    python -m benchmarks.landscape

Every joint is dithered alone, in its load pose, direction +, without scatter, with constant
amplitudes and frequencies. Writes landscape.csv, with terms of the reward for a weight of 1, and
landscape.md and landscape.png, for the default weights and for others, beside this file. It takes
some minutes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.envs.evaluation import evaluate
from stiction_envs.envs.settings import sje_settings
from stiction_envs.envs.sje import SJEVectorEnv
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.markdown import signed, table_text
from stiction_envs.reporting.png import save_full
from stiction_envs.reporting.templates import write_page
from stiction_envs.robots import load_arm

HERE = Path(__file__).parent
ROBOTS = ("panda", "iiwa7")
SHARES = np.linspace(0.125, 1.0, 8)
"""Amplitudes over A_max."""
FREQUENCIES = np.geomspace(5.0, 100.0, 7)
PENALTIES = ("power", "torque_rate", "shaking")
COLUMNS = ("robot", "joint", "share", "frequency_hz", "reduction", "oscillation_rad", *PENALTIES)
WEIGHTS = (0.0, 1e4, 3e4, 1e5, 2e5, 4e5)
TRIED = np.geomspace(1e2, 1e9, 141)
"""Weights of shaking, to see whether any puts a best constant inside all bounds."""


class Grid:
    """Constant actions (N, 2n) [N·m, Hz], one of each environment of a batch."""

    def __init__(self, action: np.ndarray) -> None:
        self._action = action

    def predict(self, *arguments: Any, **named: Any) -> tuple[np.ndarray, None]:
        return self._action, None


def measure(robot: str, joint: int) -> list[tuple]:
    """Return rows of the table: the grid, then the ramp without dither."""
    grid = [*((a, f) for a in SHARES for f in FREQUENCIES), (0.0, FREQUENCIES[0])]
    env = SJEVectorEnv(
        len(grid),
        robot=robot,
        scatter=False,
        power_weight=1.0,
        torque_rate_weight=1.0,
        shaking_weight=1.0,
    )
    low, high = env.single_action_space.low, env.single_action_space.high
    action = np.tile(low.astype(float), (len(grid), 1))
    action[:, joint - 1] = [a * high[joint - 1] for a, _ in grid]
    action[:, low.size // 2 + joint - 1] = [f for _, f in grid]
    options = {"joint": joint, "load": "load", "direction": "+"}
    rows = evaluate(env, Grid(action), [0] * len(grid), options)
    out = []
    for (a, f), row in zip(grid, rows, strict=True):
        values = [a, f, row["reduction"], 1e-3 * row["oscillation_mrad"]]
        values += [row[f"reward_{name}"] for name in PENALTIES]
        out.append((robot, joint, *(float(f"{x:.6g}") for x in values)))
    return out


def table() -> dict[tuple[str, int], dict[str, np.ndarray]]:
    """Measure all joints, write ``landscape.csv``; return columns by robot and joint."""
    rows, out = [], {}
    for robot in ROBOTS:
        for joint in range(1, load_arm(robot).n + 1):
            new = measure(robot, joint)
            rows += new
            columns = np.array([row[2:] for row in new]).T
            out[robot, joint] = dict(zip(COLUMNS[2:], columns, strict=True))
            print(robot, joint, flush=True)
    write_lines(HERE / "landscape.csv", COLUMNS, rows)
    return out


def returns(cells: dict[str, np.ndarray], weight: float) -> tuple[np.ndarray, float]:
    """Return the returns of the grid (amplitudes, frequencies), and without dither."""
    s = sje_settings().reward
    value = cells["reduction"] + weight * cells["shaking"]
    value = value + s.power_weight * cells["power"] + s.torque_rate_weight * cells["torque_rate"]
    return value[:-1].reshape(len(SHARES), len(FREQUENCIES)), float(value[-1])


def best(cells: dict[str, np.ndarray], weight: float) -> tuple[int, int, float]:
    """Return the best constant: its place in the grid, and its return over no dither."""
    grid, still = returns(cells, weight)
    a, f = np.unravel_index(np.nanargmax(grid), grid.shape)  # NaN: truncated
    return int(a), int(f), float(grid[a, f] - still)


def inside(cells: dict[str, np.ndarray]) -> np.ndarray:
    """Return with which of `TRIED` the best constant is on no edge (weights,)."""
    places = [best(cells, float(weight))[:2] for weight in TRIED]
    return np.array([a < len(SHARES) - 1 and 0 < f < len(FREQUENCIES) - 1 for a, f in places])


def write(found: dict[tuple[str, int], dict[str, np.ndarray]], usual: float) -> None:
    """Write ``landscape.md`` about all joints."""
    joints = sorted({joint for _, joint in found})
    rows, on_edge = [], []
    for weight in WEIGHTS:
        edges = {"amplitude": 0, "frequency": 0}
        for robot in ROBOTS:
            words = []
            for joint in joints:
                a, f, gain = best(found[robot, joint], weight)
                edges["amplitude"] += a == len(SHARES) - 1
                edges["frequency"] += f in (0, len(FREQUENCIES) - 1)
                words.append(f"{SHARES[a]:.2f} A_max, {FREQUENCIES[f]:.0f} Hz: {signed(gain, 2)}")
            rows.append([f"{weight:g}", robot, *words])
        on_edge.append({"weight": weight, **edges})
    header = ["weight of shaking", "robot", *(f"joint {j}" for j in joints)]
    total = len(ROBOTS) * len(joints)
    counts = [
        [f"{x['weight']:g}", *(f"{x[name]} of {total}" for name in ("amplitude", "frequency"))]
        for x in on_edge
    ]
    free = {joint: inside(cells) for joint, cells in found.items()}
    at_once = np.sum(list(free.values()), axis=0)
    write_page(
        HERE / "landscape.md",
        HERE / "templates" / "landscape.md.j2",
        amplitudes=len(SHARES),
        frequencies=len(FREQUENCIES),
        best=table_text(header, rows),
        edges=table_text(["weight", "amplitude", "frequency"], counts),
        on_edge=on_edge,
        weight=usual,
        total=total,
        tried=TRIED,
        quieter=sum(np.nanmax(c["shaking"][:-1]) > c["shaking"][-1] for c in found.values()),
        at_once=int(at_once.max()),
        at_weight=float(TRIED[at_once.argmax()]),
        never=[f"{robot}'s {joint}" for (robot, joint), ok in free.items() if not ok.any()],
    )


def draw(found: dict[tuple[str, int], dict[str, np.ndarray]], usual: float) -> None:
    """Draw the landscapes without a price on shaking, and with the default one."""
    joints = sorted({joint for _, joint in found})
    kinds = [(robot, weight) for robot in ROBOTS for weight in (0.0, usual)]
    size = (1.9 * len(joints), 1.8 * len(kinds))
    figure = Figure(figsize=size, layout="constrained")
    axes: Any = figure.subplots(len(kinds), len(joints), squeeze=False, sharex=True, sharey=True)
    for row, (robot, weight) in zip(axes, kinds, strict=True):
        for axis, joint in zip(row, joints, strict=True):
            grid, still = returns(found[robot, joint], weight)
            picture = axis.pcolormesh(
                FREQUENCIES,
                SHARES,
                grid - still,
                cmap="RdBu",
                vmin=-0.8,
                vmax=0.8,
                shading="nearest",
            )
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
    save_full(figure, HERE / "landscape.png")


def main() -> int:
    """Measure, draw, write."""
    argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]).parse_args()
    found, usual = table(), sje_settings().reward.shaking_weight
    draw(found, usual)
    write(found, usual)
    return 0


if __name__ == "__main__":
    sys.exit(main())
