"""Tracking error against shaking: which dither removes the one without the other.

    python -m benchmarks.learning.dither_tradeoff

Writes the page and picture of ``dither_tradeoff.csv``, whose rows were measured once: the page says
how. Beyond the thesis: its final dither (Table 4.9) at 0.25 to 1.5 times the amplitude, with other
waveforms, per-joint phases and gating by joint speed, on both of its paths at both stiffnesses.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from benchmarks.harness import Benchmark
from stiction_envs.experiments.sje.plots import plain_axes
from stiction_envs.reporting.markdown import percent, table_text
from stiction_envs.reporting.png import save_full

STUDY = Benchmark(__file__, __doc__)
ERRORS = ("position", "orientation", "window", "path")
NOTHING, THESIS = "no dither", "sine (thesis) × 1"
Row = dict[str, float]


def read(path: Path) -> dict[str, Row]:
    """Return the rows of the CSV by dither."""
    with path.open(encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    return {x.pop("dither"): {name: float(value) for name, value in x.items()} for x in lines}


def page(rows: dict[str, Row]) -> dict[str, Any]:
    """Return what the page's template asks for."""
    plain, thesis = rows[NOTHING], rows[THESIS]
    limit = 0.5 * (thesis["vibration_mm"] + plain["vibration_mm"])
    calm = [name for name, row in rows.items() if row["vibration_mm"] < limit]
    quiet = min(calm, key=lambda name: rows[name]["position_percent"])
    header = ["dither", "error left, position", "orientation", "window sum", "RMS along the path"]
    header += ["vibration [mm]", "at rest [mm]", "dither power [W]"]
    lines = [
        [
            name,
            *(percent(row[f"{error}_percent"]) for error in ERRORS),
            *(f"{row[key]:.3f}" for key in ("vibration_mm", "at_rest_mm")),
            f"{row['power_w']:.2f}",
        ]
        for name, row in rows.items()
    ]
    return {
        "quiet": quiet,
        "changes": [percent(row["position_percent"]) for row in (rows[quiet], thesis)],
        "added": [row["vibration_mm"] - plain["vibration_mm"] for row in (rows[quiet], thesis)],
        "plain": plain["vibration_mm"],
        "table": table_text(header, lines),
    }


def draw(rows: dict[str, Row], path: Path) -> None:
    """Draw the error over that without dither, against vibration."""
    families: dict[str, list[Row]] = {}
    for name, row in rows.items():
        families.setdefault(name.partition(" × ")[0], []).append(row)
    names = {
        "position": "error left 1 s after the last arrival (position)",
        "path": "RMS error along the path (all axes)",
    }
    figure = Figure(figsize=(12.6, 6.2), layout="constrained")
    for axes, (error, title) in zip(figure.subplots(1, 2, sharex=True), names.items(), strict=True):
        for k, (family, mine) in enumerate(families.items()):
            x = [row["vibration_mm"] for row in mine]
            y = [100 + row[f"{error}_percent"] for row in mine]
            line = "-" if 0 < k < 5 else ""
            axes.plot(
                x, y, "oo^sPvD*X<>"[k], color=f"C{k}" if k < 10 else "k", ls=line, label=family
            )
        axes.axhline(100, color="0.6", lw=0.8, ls=(0, (4, 3)), zorder=0)
        axes.set_title(title, loc="left", fontsize=10.5)
        axes.set_xlabel("vibration of the flange above 8 Hz [mm RMS]")
        axes.set_ylabel("error, no dither = 100 [%]")
        plain_axes(axes)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, frameon=False, fontsize=8.5)
    save_full(figure, path)


def main() -> None:
    options = STUDY.parser().parse_args()
    rows = read(STUDY.folder / "dither_tradeoff.csv")
    draw(rows, options.out / "dither_tradeoff.png")
    STUDY.write_page(options, **page(rows))


if __name__ == "__main__":
    main()
