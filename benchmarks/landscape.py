"""What the SJE environments pay for: return over amplitude and frequency, joint by joint.

    python benchmarks/landscape.py [--joints 1 7] [--fresh]

Every joint is dithered alone, in its load pose, direction +, without scatter, with constant
amplitudes and frequencies. Terms of the reward are kept with weight 1 in ``landscape.csv``, one
joint after the other: a run that was stopped goes on where it was. Page and picture beside this
file are made of that table, for the default weights and for others.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from stiction_envs.envs.settings import sje_settings
from stiction_envs.envs.sje import SJEVectorEnv
from stiction_envs.measured.csv_text import write_lines

HERE = Path(__file__).parent
ROBOTS = ("panda", "iiwa7")
SHARES = np.linspace(0.125, 1.0, 8)
"""Amplitudes over A_max."""
FREQUENCIES = np.geomspace(5.0, 100.0, 7)
PENALTIES = ("power", "torque_rate", "shaking")
COLUMNS = ("robot", "joint", "share", "frequency_hz", "reduction", "oscillation_rad", *PENALTIES)
WEIGHTS = (0.0, 1e4, 3e4, 1e5, 2e5, 4e5)
SMALL = 0.01
"""Weight of power and torque rate, as by default."""


def measure(robot: str, joint: int) -> list[tuple]:
    """Return rows of the table: the grid, then the ramp without dither."""
    grid = [*((a, f) for a in SHARES for f in FREQUENCIES), (0.0, FREQUENCIES[0])]
    count = len(grid)
    env = SJEVectorEnv(
        count,
        robot=robot,
        scatter=False,
        power_weight=1.0,
        torque_rate_weight=1.0,
        shaking_weight=1.0,
        autoreset_mode="Disabled",
    )
    low, high = env.single_action_space.low, env.single_action_space.high
    action = np.tile(low.astype(float), (count, 1))
    action[:, joint - 1] = [a * high[joint - 1] for a, _ in grid]
    action[:, low.size // 2 + joint - 1] = [f for _, f in grid]
    env.reset(seed=0, options={"joint": joint, "load": "load", "direction": "+"})
    terms = {name: np.zeros(count) for name in PENALTIES}
    reduction, oscillation = np.zeros(count), np.zeros(count)
    alive = np.ones(count, dtype=bool)
    while alive.any():
        ids = np.flatnonzero(alive)
        step = env.tiles.step(ids, action[ids])
        for name in PENALTIES:
            terms[name][ids] += step.terms[name]
        over = step.terminated | step.truncated
        done = ids[over]
        reduction[done], oscillation[done] = step.reduction[over], step.shaking[over]
        alive[done] = False
    values = zip(reduction, oscillation, *terms.values(), strict=True)
    rows = [(a, f, *v) for (a, f), v in zip(grid, values, strict=True)]
    return [(robot, joint, *(float(f"{x:.6g}") for x in row)) for row in rows]


def table(joints: list[int], fresh: bool) -> dict[tuple[str, int], dict[str, np.ndarray]]:
    """Return columns by robot and joint, measuring what ``landscape.csv`` lacks."""
    path, rows = HERE / "landscape.csv", []
    if path.is_file() and not fresh:
        with path.open(encoding="utf-8") as file:
            for r in csv.DictReader(file):
                rows.append((r["robot"], int(r["joint"]), *(float(r[c]) for c in COLUMNS[2:])))
    for robot in ROBOTS:
        for joint in joints:
            if not any(row[:2] == (robot, joint) for row in rows):
                rows += measure(robot, joint)
                write_lines(path, COLUMNS, rows)
                print(robot, joint)
    out = {}
    for key in sorted({row[:2] for row in rows}, key=lambda k: (ROBOTS.index(k[0]), k[1])):
        mine = np.array([row[2:] for row in rows if row[:2] == key])
        out[key] = dict(zip(COLUMNS[2:], mine.T, strict=True))
    return out


def returns(cells: dict[str, np.ndarray], weight: float) -> tuple[np.ndarray, float]:
    """Return the returns of the grid (amplitudes, frequencies), and without dither."""
    value = cells["reduction"] + weight * cells["shaking"]
    value = value + SMALL * (cells["power"] + cells["torque_rate"])
    return value[:-1].reshape(len(SHARES), len(FREQUENCIES)), float(value[-1])


def best(cells: dict[str, np.ndarray], weight: float) -> tuple[int, int, float]:
    """Return the best constant: its place in the grid, and its return over no dither."""
    grid, still = returns(cells, weight)
    a, f = np.unravel_index(np.argmax(grid), grid.shape)
    return int(a), int(f), float(grid[a, f] - still)


def main() -> None:
    """Measure, draw, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--joints", type=int, nargs="*", default=list(range(1, 8)))
    parser.add_argument("--fresh", action="store_true", help="measure everything anew")
    given = parser.parse_args()
    found, usual = table(given.joints, given.fresh), sje_settings().reward.shaking_weight
    draw(found, usual)
    lines = [
        "# What the SJE environments pay for",
        "",
        "Return of one constant amplitude and frequency on the tested joint (load pose, direction",
        "+, no scatter), over that without dither. "
        f"`python benchmarks/landscape.py`; grid of {len(SHARES)} amplitudes",
        f"and {len(FREQUENCIES)} frequencies within the action's bounds. The best of each joint:",
        "",
        "| weight of shaking | robot | " + " | ".join(f"joint {j}" for j in given.joints) + " |",
        "| --- | --- |" + " --- |" * len(given.joints),
    ]
    inside = []
    for weight in WEIGHTS:
        edges = np.zeros(2, dtype=int)
        for robot in ROBOTS:
            words = []
            for joint in given.joints:
                a, f, gain = best(found[robot, joint], weight)
                edges += [a == len(SHARES) - 1, f in (0, len(FREQUENCIES) - 1)]
                words.append(f"{SHARES[a]:.2f} A_max, {FREQUENCIES[f]:.0f} Hz: {gain:+.2f}")
            lines.append(f"| {weight:g} | {robot} | {' | '.join(words)} |")
        inside.append((weight, *edges))
    total = len(ROBOTS) * len(given.joints)
    lines += ["", "On the edge of the bounds, of all joints:", ""]
    lines += ["| weight | amplitude | frequency |", "| --- | --- | --- |"]
    lines += [f"| {w:g} | {a} of {total} | {f} of {total} |" for w, a, f in inside]
    lines += [
        "",
        f"The default weight is {usual:g}, the least of these with which every joint's best",
        "frequency is inside. A price on shaking alone does not bring the amplitude inside: until",
        "a joint slides, torque reduction and oscillation grow together, a higher frequency pays",
        "for a larger amplitude, and joints 1 to 3 do not slide at A_max (2.5 × stiction).",
        "",
        "![return over amplitude and frequency](landscape.png)",
        "",
    ]
    (HERE / "landscape.md").write_text("\n".join(lines), encoding="utf-8")


def draw(found: dict[tuple[str, int], dict[str, np.ndarray]], usual: float) -> None:
    """Draw the landscapes without a price on shaking, and with the default one."""
    joints = sorted({joint for _, joint in found})
    kinds = [(robot, weight) for robot in ROBOTS for weight in (0.0, usual)]
    figure, axes = plt.subplots(
        len(kinds),
        len(joints),
        figsize=(1.9 * len(joints), 1.8 * len(kinds)),
        squeeze=False,
        sharex=True,
        sharey=True,
        layout="constrained",
    )
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
    figure.colorbar(picture, ax=axes, shrink=0.5, label="return over no dither")
    figure.savefig(HERE / "landscape.png", dpi=80)


if __name__ == "__main__":
    main()
