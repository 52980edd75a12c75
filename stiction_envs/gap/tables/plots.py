"""Picture of a table diagnosis: the error of each joint, nominal, extended, and its noise floor."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from stiction_envs.reporting.png import save_small


def plot_errors(
    nominal: Mapping[int, float],
    extended: Mapping[int, float],
    noise: Mapping[int, float],
    path: Path,
) -> None:
    """Draw errors and write a PNG.

    Args:
        nominal: mean |error| by joint (from 1), over the joint's friction [%].
        extended: the same with the causes, held out.
        noise: standard deviation of a reading.
        path: of the PNG.
    """
    figure = Figure(figsize=(4.0 + 0.8 * len(nominal), 3.6), layout="constrained")
    axes = figure.subplots()
    at = range(len(nominal))
    axes.bar([x - 0.2 for x in at], list(nominal.values()), 0.38, color="#c2590c", label="nominal")
    axes.bar(
        [x + 0.2 for x in at], list(extended.values()), 0.38, color="#1f5fa8", label="extended"
    )
    axes.plot(at, list(noise.values()), "_", color="0.1", ms=30, mew=1.6, label="noise floor")
    axes.set_xticks(list(at), [f"joint {j}" for j in nominal])
    axes.set_ylabel("mean error over friction [%]")
    axes.legend(fontsize=8, frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, lw=0.6, axis="y")
    axes.set_axisbelow(True)
    save_small(figure, path)
