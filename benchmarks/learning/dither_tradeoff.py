"""Tracking error against shaking: which dither removes the one without the other.

    python -m benchmarks.learning.dither_tradeoff [--iterations 3] [--kept]

Beyond the thesis: its final dither (Table 4.9) at 0.25 to 1.5 times the amplitude, with other
waveforms, per-joint phases and gating by joint speed, on both of its paths at both stiffnesses.
Writes dither_tradeoff.csv and the page of it; ``--kept`` reads the CSV.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from benchmarks.harness import Benchmark
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import Measures, measure
from stiction_envs.experiments.gte.protocol import TRAJECTORIES, Case
from stiction_envs.experiments.gte.rows import thesis_final_dither, thesis_stiffness
from stiction_envs.experiments.sje.plots import plain_axes
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.markdown import percent, table_text
from stiction_envs.reporting.png import save_full

STUDY = Benchmark(__file__, __doc__)
FINAL = thesis_final_dither()
PLACES = [(t, k) for t in TRAJECTORIES for k in thesis_stiffness()]
SCALES = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
"""Amplitudes over the thesis's [-]; assumed."""
TOGETHER = 32
"""Number of cases in one batch."""
GATES = (0.02, 0.05, 0.1, 0.2)
"""Speeds above which a gated dither is off [rad/s]; assumed."""
ERRORS = ("position", "orientation", "window", "path")
COLUMNS = ("dither", *(f"{name}_percent" for name in ERRORS), "vibration_mm", "at_rest_mm")
COLUMNS += ("power_w",)
NOTHING, THESIS = "no dither", "sine (thesis) × 1"
Row = dict[str, float]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One dither, made from the thesis's final one."""

    family: str
    scale: float = 1.0
    gate: float = np.inf
    """Speed above which it is off [rad/s]."""
    waveform: str = "sine"
    phases: str = "random"
    joints: tuple[int, ...] = (1, 2, 3, 4, 5, 6, 7)

    @property
    def name(self) -> str:
        """Family, and what is particular about the dither within its family."""
        gate = f", gate {self.gate:g} rad/s" if np.isfinite(self.gate) else ""
        return f"{self.family} × {self.scale:g}{gate}"

    def cases(self) -> list[Case]:
        """Return the experiment's cases, one of each place."""
        rows = tuple(
            replace(r, amplitude_nm=self.scale * r.amplitude_nm, waveform=self.waveform)
            for r in FINAL
            if r.joint in self.joints
        )
        more: dict[str, Any] = {"gate_velocity": self.gate, "phases": self.phases}
        return [Case(trajectory=t, stiffness=k, dither=rows, **more) for t, k in PLACES]


def kinds() -> list[Kind]:
    """Return all dithers that are compared."""
    out = [Kind(family="sine (thesis)", scale=s) for s in SCALES]
    for waveform in ("triangle", "square", "random"):
        out += [Kind(family=waveform, scale=s, waveform=waveform) for s in SCALES[1::2]]
    for name, phases in (("0", "zero"), ("spread", "spread")):
        out.append(Kind(family=f"sine, phases {name}", phases=phases))
    out += [Kind(family="sine, gated", scale=s, gate=g) for s in (1.0, 1.5) for g in GATES]
    square: dict[str, Any] = {"family": "square, gated", "gate": 0.05, "waveform": "square"}
    out += [Kind(scale=s, **square) for s in (0.5, 1.0, 1.5)]
    out.append(Kind(family="sine, wrist only", joints=(5, 6, 7)))
    out.append(Kind(family="sine, joints 1-4 only", joints=(1, 2, 3, 4)))
    return out


def compared(found: list[Measures], plain: list[Measures]) -> tuple[str, ...]:
    """Return the numbers of a dither over those without [%], geometric means over all places.

    Position and orientation are left 1 s after the last arrival; the window is that of Table 4.11;
    the path's is the error's root mean square.
    """

    def errors(m: Measures) -> list[Any]:
        left = [
            np.linalg.norm(m.settling[:, -1, part], axis=1).mean()
            for part in (slice(0, 3), slice(3, 6))
        ]
        return [*left, m.window_sum.mean(axis=0), m.rms.mean(axis=0)]

    logs = [
        [np.mean(np.log(x / y)) for x, y in zip(errors(a), errors(b), strict=True)]
        for a, b in zip(found, plain, strict=True)
    ]
    shaken = [
        1e3 * np.mean([getattr(m, name).mean() for m in found])
        for name in ("shaking", "shaking_at_rest")
    ]
    power = np.mean([(m.dither_energy / m.duration).mean() for m in found])
    changes = (f"{100 * (np.exp(x) - 1):.1f}" for x in np.mean(logs, axis=0))
    return (*changes, *(f"{x:.3f}" for x in shaken), f"{power:.2f}")


def run_all(iterations: int) -> list[tuple[str, ...]]:
    """Return the rows of the CSV: no dither, then every kind."""
    bench = GeneratedTrajectoryExperiment("panda")
    chosen, measured = kinds(), list[Measures]()
    cases = [Case(trajectory=t, stiffness=k) for t, k in PLACES]
    cases += [case for kind in chosen for case in kind.cases()]
    for k in tqdm(range(0, len(cases), TOGETHER)):
        runs = bench.run(cases[k : k + TOGETHER], iterations=iterations)
        measured += [measure(r, bench.protocol, bench.motion) for r in runs]
    groups = [measured[k : k + len(PLACES)] for k in range(0, len(measured), len(PLACES))]
    names = (NOTHING, *(kind.name for kind in chosen))
    return [(name, *compared(g, groups[0])) for name, g in zip(names, groups, strict=True)]


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
    families: dict[str, list[Row]] = {NOTHING: [rows[NOTHING]]}
    for kind in kinds():
        families.setdefault(kind.family, []).append(rows[kind.name])
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
    parser = STUDY.parser()
    parser.add_argument("--iterations", type=int, default=3)
    parser.add_argument("--kept", action="store_true", help="page of the CSV that is there")
    options = parser.parse_args()
    path = STUDY.folder / "dither_tradeoff.csv"
    if not options.kept:
        write_lines(path, COLUMNS, run_all(options.iterations))
    rows = read(path)
    draw(rows, options.out / "dither_tradeoff.png")
    STUDY.write_page(options, iterations=options.iterations, **page(rows))


if __name__ == "__main__":
    main()
