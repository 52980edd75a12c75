"""Table 4.11 and Figures 4.6 to 4.8, E.1, F.1 and F.2 of the thesis, simulated and measured.

    measured = run_thesis_cases(GeneratedTrajectoryExperiment("panda"))
    write_gte(folder, measured)

Triangle and pentagon, both stiffnesses, without dither and with the final one of Table 4.9.
`benchmarks/gte_table_4_11` goes on from here: what in the model would change the table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from stiction_envs.experiments.gte import plots as gte_plots
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import Measures, measure
from stiction_envs.experiments.gte.protocol import AXES, TRAJECTORIES, Case, Run
from stiction_envs.experiments.gte.rows import (
    thesis_final_dither,
    thesis_stiffness,
    thesis_window_sums,
    unit,
)
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.measured.thesis_robots import thesis_robots
from stiction_envs.reporting.markdown import percent, table_text
from stiction_envs.reporting.templates import write_md_and_html

(ROBOT,) = thesis_robots("4.11")
Measured = tuple[Run, Measures]
Pair = tuple[Measured, Measured]
"""The run without dither and the one with it."""
FIGURES = {
    ("triangle", "path_xy"): "4.6",
    ("pentagon", "path_xy"): "4.6",
    ("triangle", "path_3d"): "E.1",
    ("pentagon", "path_3d"): "E.1",
    ("triangle", "error_position"): "4.7",
    ("pentagon", "error_position"): "4.8",
    ("triangle", "error_orientation"): "F.1",
    ("pentagon", "error_orientation"): "F.2",
}
"""The thesis's figure by path and kind of plot; each has one plot per stiffness."""


@dataclass(frozen=True, kw_only=True)
class WindowSum:
    """One axis of Table 4.11: sums of the absolute error over 200 samples [m or rad, samples]."""

    trajectory: str
    stiffness: str
    """``KT/KR/KN``."""
    axis: str
    unit: str
    measured_no_dither: float
    measured_dither: float
    simulated_no_dither: float
    """Mean over iterations."""
    simulated_no_dither_std: float
    """NaN for one iteration."""
    simulated_dither: float
    simulated_dither_std: float

    @property
    def measured_change(self) -> float:
        """Relative change by dither [-]."""
        return self.measured_dither / self.measured_no_dither - 1.0

    @property
    def simulated_change(self) -> float:
        """Relative change by dither [-]."""
        return self.simulated_dither / self.simulated_no_dither - 1.0

    def clear(self, iterations: int) -> bool:
        """Whether the simulated change is above twice its standard error."""
        spread = math.hypot(self.simulated_no_dither_std, self.simulated_dither_std)
        change = abs(self.simulated_dither - self.simulated_no_dither)
        return change > 2.0 * spread / math.sqrt(iterations)


def thesis_cases() -> list[Case]:
    """Return the eight cases: each path and stiffness without dither, then with it."""
    dither = thesis_final_dither()
    return [
        Case(trajectory=t, stiffness=k, dither=d)
        for t in TRAJECTORIES
        for k in thesis_stiffness()
        for d in ((), dither)
    ]


def run_thesis_cases(
    bench: GeneratedTrajectoryExperiment,
    *,
    iterations: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Pair]:
    """Run the eight cases.

    Args:
        bench: of the Panda.
        iterations: None for the protocol's ten.
        progress: called with simulated seconds, summed over arms.
    """
    runs = bench.run(thesis_cases(), iterations=iterations, progress=progress)
    done = [(run, measure(run, bench.protocol, bench.motion)) for run in runs]
    return list(zip(done[::2], done[1::2], strict=True))


def window_sums(pairs: Sequence[Pair]) -> list[WindowSum]:
    """Return the rows of the table, in the order of the thesis."""
    return [row for pair in pairs for row in _rows(pair)]


def _rows(pair: Pair) -> Iterator[WindowSum]:
    printed = [thesis_window_sums(run.case) for run, _ in pair]
    simulated = [m.window_sum for _, m in pair]
    case = pair[0][0].case
    for k, axis in enumerate(AXES):
        before, after = (float(p[axis]) if p else math.nan for p in printed)
        spread = [float(s[:, k].std(ddof=1)) if len(s) > 1 else math.nan for s in simulated]
        yield WindowSum(
            trajectory=case.trajectory,
            stiffness=_stiffness(case),
            axis=axis,
            unit=f"{unit(axis)}·samples",
            measured_no_dither=before,
            measured_dither=after,
            simulated_no_dither=float(simulated[0][:, k].mean()),
            simulated_no_dither_std=spread[0],
            simulated_dither=float(simulated[1][:, k].mean()),
            simulated_dither_std=spread[1],
        )


def _stiffness(case: Case) -> str:
    return "/".join(f"{k:g}" for k in case.stiffness)


def score(rows: Sequence[WindowSum]) -> dict[str, float]:
    """Return how many signs of the dither's effect come out, and how far off the sums are.

    Beside them how many a rule has right that says that every error falls: the yardstick.
    """
    right = [np.sign(r.simulated_change) == np.sign(r.measured_change) for r in rows]
    rises = [ok for ok, r in zip(right, rows, strict=True) if r.measured_change > 0]
    logs = [np.log(r.simulated_no_dither / r.measured_no_dither) for r in rows]
    return {
        "axes": len(rows),
        "signs_right": int(np.sum(right)),
        "always_falls": sum(r.measured_change < 0 for r in rows),
        "rises": len(rises),
        "rises_right": int(np.sum(rises)),
        "factor": float(np.exp(np.sqrt(np.mean(np.square(logs))))),
    }


def write_gte(
    folder: Path,
    pairs: Sequence[Pair],
    *,
    ensemble: str = "",
    progress: Callable[[str, float, float], None] | None = None,
) -> dict[str, float]:
    """Write `table_4_11.csv`, `gte.md` and the figures.

    Args:
        folder: where; it exists.
        pairs: of `run_thesis_cases`.
        ensemble: section of the page on other set-ups, of `ensemble_page.write_ensemble`.
        progress: called with (stage, done, total).

    Returns:
        `score` of the table.
    """
    rows = window_sums(pairs)
    write_lines(
        folder / "table_4_11.csv", [f.name for f in fields(WindowSum)], [astuple(r) for r in rows]
    )
    gte_plots.plot_window_sums(pairs, folder / "table_4_11.png", robot=ROBOT)
    (folder / "plots").mkdir(exist_ok=True)
    shown: dict[str, list[str]] = {}
    for k, pair in enumerate(pairs):
        runs = [run for run, _ in pair]
        name = f"{runs[0].case.trajectory}_{_stiffness(runs[0].case).replace('/', '_')}"
        for kind, draw, options in (
            ("path_xy", gte_plots.plot_path_xy, {}),
            ("path_3d", gte_plots.plot_path_3d, {}),
            ("error_position", gte_plots.plot_errors, {}),
            ("error_orientation", gte_plots.plot_errors, {"orientation": True}),
        ):
            file = f"plots/{name}_{kind}.png"
            draw(runs, folder / file, robot=ROBOT, **options)
            shown.setdefault(FIGURES[runs[0].case.trajectory, kind], []).append(file)
        if progress is not None:
            progress("figures", k + 1, len(pairs))
    iterations = len(pairs[0][0][0].accepted)
    found = score(rows)
    write_md_and_html(
        folder,
        Path(__file__).parent / "templates" / "gte.md.j2",
        "Table 4.11, simulated beside measured",
        ("gte.md", "report.html"),
        iterations=iterations,
        s=found,
        ensemble=ensemble,
        table=_table(rows, iterations),
        figures=shown,
    )
    return found


# ---- page ----------------------------------------------------------------------------------------


def _table(rows: Sequence[WindowSum], iterations: int) -> str:
    header = ["case", "axis", *("measured", "with dither", "change")]
    return table_text(
        [*header, "simulated", "with dither", "change"],
        [
            [
                f"{r.trajectory} {r.stiffness}",
                f"{r.axis} [{r.unit}]",
                f"{r.measured_no_dither:.3f}",
                f"{r.measured_dither:.3f}",
                percent(100 * r.measured_change),
                _sum(r.simulated_no_dither, r.simulated_no_dither_std),
                _sum(r.simulated_dither, r.simulated_dither_std),
                percent(100 * r.simulated_change)
                + ("" if r.clear(iterations) else " (within noise)"),
            ]
            for r in rows
        ],
    )


def _sum(mean: float, spread: float) -> str:
    return f"{mean:.3f}" + ("" if math.isnan(spread) else f" ± {spread:.3f}")
