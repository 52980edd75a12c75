"""Tracking error against shaking: which dither removes the one without the other.

    python -m benchmarks.learning.dither_tradeoff [--iterations 3]

Beyond the thesis: its final dither (Table 4.9) at 0.25 to 1.5 times the amplitude, with other
waveforms, per-joint phases and gating by joint speed, on both of its paths at both stiffnesses.
"""

from __future__ import annotations

from collections.abc import Callable
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
from stiction_envs.reporting.markdown import percent, signed, table_text
from stiction_envs.reporting.png import save_full

STUDY = Benchmark(__file__, __doc__)
FINAL = thesis_final_dither()
PLACES = [(t, k) for t in TRAJECTORIES for k in thesis_stiffness()]
SCALES = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
"""Over the thesis's amplitudes [-]; assumed."""
TOGETHER = 32
"""Cases at once."""
GATES = (0.02, 0.05, 0.1, 0.2)
"""Speeds above which a gated dither is off [rad/s]; assumed."""
FAMILIES = {
    "sine (thesis)": ("#d1701a", "o", "-"),
    "triangle": ("#2b7bba", "^", "-"),
    "square": ("#4a9a4a", "s", "-"),
    "random": ("#8c6bb1", "P", "-"),
    "sine, phases 0": ("#8a5a2b", "v", ""),
    "sine, phases spread": ("#8a5a2b", "D", ""),
    "sine, gated": ("#c0285f", "*", ""),
    "square, gated": ("#1a7a6a", "X", ""),
    "sine, wrist only": ("#555555", "<", ""),
    "sine, joints 1-4 only": ("#555555", ">", ""),
}
"""Colour, marker and line of each family of dithers."""


@dataclass(frozen=True)
class Kind:
    """One dither, made from the thesis's final one."""

    family: str
    scale: float = 1.0
    gate: float = float("inf")
    """v_gate [rad/s]."""
    waveform: str = "sine"
    phases: str = "random"
    joints: tuple[int, ...] = (1, 2, 3, 4, 5, 6, 7)

    @property
    def label(self) -> str:
        """What is particular about it within its family."""
        gate = f", gate {self.gate:g} rad/s" if np.isfinite(self.gate) else ""
        return f"{self.family} × {self.scale:g}{gate}"

    def case(self, trajectory: str, stiffness: tuple[float, float, float]) -> Case:
        """Return the experiment's case."""
        rows = tuple(
            replace(r, amplitude_nm=self.scale * r.amplitude_nm, waveform=self.waveform)
            for r in FINAL
            if r.joint in self.joints
        )
        return Case(
            trajectory=trajectory,
            stiffness=stiffness,
            dither=rows,
            gate_velocity=self.gate,
            phases=self.phases,
        )


def kinds() -> list[Kind]:
    """Return all dithers that are compared."""
    out = [Kind("sine (thesis)", s) for s in SCALES]
    for waveform in ("triangle", "square", "random"):
        out += [Kind(waveform, s, waveform=waveform) for s in SCALES[1::2]]
    out += [Kind(f"sine, phases {n}", phases=p) for n, p in (("0", "zero"), ("spread", "spread"))]
    out += [Kind("sine, gated", s, g) for s in (1.0, 1.5) for g in GATES]
    out += [Kind("square, gated", s, 0.05, "square") for s in (0.5, 1.0, 1.5)]
    out.append(Kind("sine, wrist only", joints=(5, 6, 7)))
    out.append(Kind("sine, joints 1-4 only", joints=(1, 2, 3, 4)))
    return out


@dataclass(frozen=True)
class Outcome:
    """What a dither did, geometric means over paths, stiffnesses and axes."""

    name: str
    family: str
    tracking: float
    """RMS error along the path over that without dither [-]."""
    window: float
    """Sum of Table 4.11 over that without dither [-]."""
    standing: float
    """Error left 1 s after the last arrival over that without dither, its norm in position [-]."""
    turned: float
    """The same of the orientation [-]."""
    vibration: float
    """RMS of the flange above 8 Hz, turns times 0.1 m included, mean over the cases [m]."""
    at_rest: float
    """The same after the last arrival [m]."""
    energy: float
    """Dither energy per second [W]."""


def outcome(name: str, family: str, found: list[Measures], plain: list[Measures]) -> Outcome:
    """Compare the measures of a dither with those without, one of each place."""

    def ratio(of: Callable[[Measures], Any]) -> float:
        values = [np.log(of(a) / of(b)) for a, b in zip(found, plain, strict=True)]
        return float(np.exp(np.mean(values)))

    def left(columns: slice) -> float:
        return ratio(lambda m: np.linalg.norm(m.settling[:, -1, columns], axis=1).mean())

    return Outcome(
        name=name,
        family=family,
        tracking=ratio(lambda m: m.rms.mean(axis=0)),
        window=ratio(lambda m: m.window_sum.mean(axis=0)),
        standing=left(slice(0, 3)),
        turned=left(slice(3, 6)),
        vibration=float(np.mean([m.shaking.mean() for m in found])),
        at_rest=float(np.mean([m.shaking_at_rest.mean() for m in found])),
        energy=float(np.mean([(m.dither_energy / m.duration).mean() for m in found])),
    )


def run_all(iterations: int) -> list[Outcome]:
    """Return the outcomes of no dither, then of every kind."""
    bench = GeneratedTrajectoryExperiment("panda")
    chosen, measured = kinds(), list[Measures]()
    cases = [Case(trajectory=t, stiffness=k) for t, k in PLACES]
    cases += [kind.case(t, k) for kind in chosen for t, k in PLACES]
    for k in tqdm(range(0, len(cases), TOGETHER)):
        runs = bench.run(cases[k : k + TOGETHER], iterations=iterations)
        measured += [measure(r, bench.protocol, bench.motion) for r in runs]
    plain = measured[:4]
    out = [outcome("no dither", "", plain, plain)]
    for i, kind in enumerate(chosen):
        out.append(outcome(kind.label, kind.family, measured[4 * i + 4 : 4 * i + 8], plain))
    return out


def front(outcomes: list[Outcome], of: Callable[[Outcome], float]) -> set[str]:
    """Return names of outcomes that no other beats in both error and shaking."""
    return {
        a.name
        for a in outcomes
        if not any(
            of(b) <= of(a)
            and b.vibration <= a.vibration
            and (of(b), b.vibration) != (of(a), a.vibration)
            for b in outcomes
        )
    }


MEASURES = {
    "error left 1 s after the last arrival (position)": lambda o: o.standing,
    "RMS error along the path (all axes)": lambda o: o.tracking,
}


def draw(outcomes: list[Outcome], path: Path) -> None:
    """Draw the error over that without dither, against vibration; the front is drawn through."""
    figure = Figure(figsize=(12.6, 6.2), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True)
    plain = outcomes[0]
    for axes, (name, of) in zip(panels, MEASURES.items(), strict=True):
        on_front = front(outcomes, of)
        best = sorted((o for o in outcomes if o.name in on_front), key=lambda o: o.vibration)
        x, y = [1e3 * o.vibration for o in best], [100 * of(o) for o in best]
        axes.step(x, y, where="post", color="0.8", lw=6, zorder=1, label="Pareto front")
        style: dict[str, Any] = {"ms": 9, "mfc": "white", "mec": "0.2", "zorder": 4}
        axes.plot(1e3 * plain.vibration, 100.0, "o", label="no dither", **style)
        for family, (shade, marker, line) in FAMILIES.items():
            mine = [o for o in outcomes if o.family == family]
            x, y = [1e3 * o.vibration for o in mine], [100 * of(o) for o in mine]
            style = {"ms": 11 if marker == "*" else 7, "lw": 1.2, "zorder": 3}
            axes.plot(x, y, color=shade, marker=marker, ls=line, label=family, **style)
        axes.axhline(100, color="0.6", lw=0.8, ls=(0, (4, 3)), zorder=0)
        axes.set_title(name, loc="left", fontsize=10.5)
        axes.set_xlabel("vibration of the flange above 8 Hz [mm RMS]")
        axes.set_ylabel("error, no dither = 100 [%]")
        plain_axes(axes)
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=6, frameon=False, fontsize=8.5)
    figure.suptitle(
        "Panda: tracking error against shaking, mean of two paths at two stiffnesses", fontsize=12
    )
    save_full(figure, path)


def page(outcomes: list[Outcome]) -> dict[str, Any]:
    """Return what the page's template asks for."""
    plain, named = outcomes[0], {o.name: o for o in outcomes}
    thesis = named["sine (thesis) × 1"]
    limit = 0.5 * (thesis.vibration + plain.vibration)
    best = front(outcomes, lambda o: o.standing)
    header = ["dither", "error left, position", "orientation", "window sum", "RMS along the path"]
    header += ["vibration [mm]", "added", "at rest [mm]", "dither power [W]", "front"]
    rows = [
        [
            o.name,
            *(percent(100 * (x - 1)) for x in (o.standing, o.turned, o.window, o.tracking)),
            *(f"{1e3 * o.vibration:.3f}", signed(1e3 * (o.vibration - plain.vibration), 3)),
            *(f"{1e3 * o.at_rest:.3f}", f"{o.energy:.2f}", "yes" if o.name in best else ""),
        ]
        for o in outcomes
    ]
    return {
        "plain": plain,
        "thesis": thesis,
        "quiet": min((o for o in outcomes if o.vibration < limit), key=lambda o: o.standing),
        "change": lambda x: percent(100 * (x - 1)),
        "added": lambda o: f"{signed(1e3 * (o.vibration - plain.vibration), 3)} mm",
        "table": table_text(header, rows),
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--iterations", type=int, default=3)
    options = parser.parse_args()
    outcomes = run_all(options.iterations)
    STUDY.write_page(options, iterations=options.iterations, **page(outcomes))
    draw(outcomes, options.out / "dither_tradeoff.png")


if __name__ == "__main__":
    main()
