"""The ensemble of Table 4.11 as files: `ensemble.csv`, `ensemble.png` and a section of the page."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from benchmarks.thesis.ensemble.runs import ROBOT, Member, measured_sums, thesis_cases
from benchmarks.thesis.ensemble.scores import (
    Sums,
    coverage,
    factor,
    friction_gone,
    inside,
    intervals,
    lag,
    pairs_needed,
    rank_correlation,
    signs_right,
    stack,
)
from stiction_envs.experiments.gte.plots import MEASURED
from stiction_envs.experiments.gte.protocol import AXES
from stiction_envs.experiments.gte.rows import unit
from stiction_envs.experiments.sje.plots import WITH, WITHOUT
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.markdown import number, percent, short, table
from stiction_envs.reporting.png import save_full
from stiction_envs.robots import arm_title

Array = NDArray[np.float64]
LAWS = {"diagonal": "the package's damping (2√K)", "mass": "that of eq. 2.14"}
SHADES = {"two sessions": WITH, "dither alone": "#7b3fa0", "another session alone": WITHOUT}


def write_ensemble(folder: Path, members: Sequence[Member], shipped: Mapping[str, float]) -> str:
    """Write `ensemble.csv` and `ensemble.png`; return the section of the page.

    Args:
        folder: where; it exists.
        members: of `run_ensemble`.
        shipped: share of the error that is lag in the shipped set-up, by damping law.
    """
    measured, sums = measured_sums(), stack(members)
    write_lines(folder / "ensemble.csv", *_rows(members, sums, measured))
    plot_ensemble(sums, measured, folder / "ensemble.png")
    return section(members, sums, measured, shipped)


def cell_names(between: str = " ") -> list[str]:
    """Return the 24 cells: path, translational stiffness, axis."""
    return [
        between.join((c.trajectory, f"{c.stiffness[0]:g}", axis))
        for c in thesis_cases()[::2]
        for axis in AXES
    ]


def _rows(
    members: Sequence[Member], sums: Sums, measured: tuple[Array, Array]
) -> tuple[list[str], list[list[Any]]]:
    """Return header and rows of `ensemble.csv`: what was drawn, then what came of it."""
    change = np.log(measured[1] / measured[0])
    results: dict[str, Array] = {
        "factor": factor(sums.no_dither, measured[0]),
        "size": np.exp(np.log(sums.no_dither / measured[0]).mean(axis=1)),
        "lag_share": lag(sums.free, sums.no_dither),
    }
    names = ("two_sessions", "dither_alone", "session_alone")
    for name, values in zip(names, sums.changes().values(), strict=True):
        results[f"signs_right_{name}"] = signs_right(values, change).astype(float)
        results[f"rank_correlation_{name}"] = rank_correlation(values, change)
        results[f"median_change_{name}"] = np.expm1(np.median(values, axis=1))
    for kind, values in (("no_dither", sums.no_dither), ("dither", sums.dither)):
        results |= {f"{kind}_{cell}": values[:, k] for k, cell in enumerate(cell_names("_"))}
    rows, header = [], []
    for i, m in enumerate(members):
        drawn: dict[str, Any] = {"set_up": m.number}
        for name, value in dataclasses.asdict(m.set_up).items():
            if isinstance(value, tuple):
                drawn |= {f"{name}_{j}": x for j, x in enumerate(value, 1)}
            else:
                drawn[name] = value
        drawn |= {f"refused_{k}": v for k, v in m.refused.items()}
        drawn |= {f"flag_{k}": v for k, v in m.flags.items()}
        header = [*drawn, *results]
        rows.append([*drawn.values(), *(v[i] for v in results.values())])
    return header, rows


# ---- section -------------------------------------------------------------------------------------


def section(
    members: Sequence[Member],
    sums: Sums,
    measured: tuple[Array, Array],
    shipped: Mapping[str, float],
) -> str:
    """Return the Markdown of the ensemble."""
    refused = sum(sum(m.refused.values()) for m in members)
    near = sum(m.flags["near_limit"] > 0 for m in members)
    share = 100 * refused / (refused + len(members))
    lines = [
        "#### Table 4.11 as it can be known",
        "",
        f"The thesis prints no path sizes, start pose, speeds, tool point or frame. So "
        f"{len(members)} set-ups were drawn from what it leaves open (`ensemble.toml` has every "
        "range with its reason; nothing is fitted to the table), "
        f"{members[0].sums.shape[2]} iterations each; {share:.0f} % of the draws were refused "
        f"because the arm cannot follow the paths from there, and {near} set-ups came near a joint "
        "limit. Both halves of the table have a session of their own, whose dry friction differs "
        "as Table 4.10 differs from Tables 4.6 and 4.7. `ensemble.csv` has a row per set-up.",
        "",
        "![The ensemble](ensemble.png)",
        "",
        *_coverages(sums, measured),
        *_changes(sums, measured),
        *_numbers(members, sums, measured, shipped),
        "50 and 90 % intervals of the ensemble; ● measured is inside the 50 %, ○ inside the 90 %, "
        "× outside.",
        "",
        *_cells(sums, measured),
    ]
    return "\n".join(lines)


def _coverages(sums: Sums, measured: tuple[Array, Array]) -> list[str]:
    change = np.log(measured[1] / measured[0])
    both = {
        "sums without dither": (np.log(sums.no_dither), np.log(measured[0])),
        "sums with dither": (np.log(sums.dither), np.log(measured[1])),
        **{f"changes, {name}": (values, change) for name, values in sums.changes().items()},
    }
    rows = []
    for name, (values, of) in both.items():
        c = coverage(values, of)
        low, middle, high = c.own_90
        usual = f"{middle:.0f} ({low:.0f} to {high:.0f})"
        fewer = f"{c.as_few} of {len(values)}"
        rows.append([name, f"{c.in_50} of 24", f"{c.in_90} of 24", usual, fewer])
    header = ["measured", "in the 50 % intervals", "in the 90 %", "of a set-up's own cells"]
    return table([*header, "set-ups with no more"], rows)


def _spread(values: Array, text: Callable[[float], str]) -> str:
    """Return the median over set-ups and what nine of ten of them have."""
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95)).tolist()
    return f"{text(middle)} ({text(low)} to {text(high)})"


def _two(value: float) -> str:
    return number(value, 2)


def _share(value: float) -> str:
    return f"{100 * value:.0f} %"


def _changes(sums: Sums, measured: tuple[Array, Array]) -> list[str]:
    change = np.log(measured[1] / measured[0])
    falls, rows = int((change < 0).sum()), []
    for name, values in sums.changes().items():
        signs, middle = signs_right(values, change), np.expm1(np.median(values, axis=1))
        rows.append(
            [
                name,
                _spread(signs.astype(float), lambda x: f"{x:.0f}"),
                str(np.sum(signs > falls)),
                _spread(rank_correlation(values, change), _two),
                _spread(middle, lambda x: percent(100 * x)),
                str(np.sum(middle <= np.expm1(np.median(change)))),
            ]
        )
    rows.append(['"every error falls"', str(falls), "", "", "", ""])
    rows.append(["measured", "", "", "", percent(100 * np.expm1(np.median(change))), ""])
    header = ["what differs", f"signs right of {len(change)}", f"set-ups above {falls}"]
    header += ["rank correlation", "median change", "set-ups that reach the measured median"]
    return table(header, rows)


def _numbers(
    members: Sequence[Member],
    sums: Sums,
    measured: tuple[Array, Array],
    shipped: Mapping[str, float],
) -> list[str]:
    """Return sizes, lag, and how far dither, session and run change a sum."""
    lags = lag(sums.free, sums.no_dither)
    laws = np.array([m.set_up.damping_design for m in members])
    change = np.log(measured[1] / measured[0])
    _, dither, session = sums.changes().values()
    run = np.sqrt((sums.scatter**2).mean(axis=0))
    # what iterations scatter is no effect
    effect = np.sqrt(np.maximum(dither**2 - run**2, 0.0))
    need = pairs_needed(effect, run)
    ratio = np.exp(np.mean(np.log(sums.no_dither / measured[0]), axis=1))
    rows = [
        ["sums without dither off by a factor", _spread(factor(sums.no_dither, measured[0]), _two)],
        ["simulated over measured sums, geometric mean", _spread(ratio, _two)],
        ["share of the sums that next to no friction leaves (lag)", _spread(lags, _share)],
        *(
            [
                f"with {name}; shipped set-up",
                f"{_share(np.median(lags[mine]))}; {_share(shipped[k])}",
            ]
            for k, name in LAWS.items()
            if (mine := laws == k).any()
        ),
        [
            "share of dry friction that would have to be gone for the measured median change",
            _spread(friction_gone(change, lags), _share),
        ],
        [
            "one cell: size of the change by dither (median)",
            percent(100 * np.median(np.abs(dither))),
        ],
        [
            "by another session (standard deviation)",
            f"{100 * np.median(session.std(axis=0, ddof=1)):.1f} %",
        ],
        ["by another run (standard deviation)", f"{100 * np.median(run):.1f} %"],
        ["interleaved pairs of runs that show it, median cell", short(float(np.median(need)), 3)],
        ["cells for which ten pairs are enough", _share(float(np.mean(need <= 10)))],
    ]
    return table(["", "median (nine of ten set-ups)"], rows)


def _cells(sums: Sums, measured: tuple[Array, Array]) -> list[str]:
    """Return the table of the 24 cells."""

    def change_text(x: float) -> str:
        return percent(100 * np.expm1(x), 0)

    change = sums.changes()["two sessions"]
    columns: tuple[tuple[Array, Array, Callable[[float], str]], ...] = (
        (sums.no_dither, measured[0], short),
        (sums.dither, measured[1], short),
        (change, np.log(measured[1] / measured[0]), change_text),
    )
    header = ["cell"]
    for name in ("no dither", "with dither", "change, two sessions"):
        header += [name, "50 %", "90 %", ""]
    rows = []
    for k, name in enumerate(cell_names()):
        row = [f"{name} [{unit(AXES[k % 6])}·samples]"]
        for values, m, text in columns:
            ends = intervals(values)
            half, most = inside(ends, m)[:, k]
            row.append(text(m[k]))
            row += [f"{text(ends[i, k])} to {text(ends[-1 - i, k])}" for i in (1, 0)]
            row.append("●" if half else "○" if most else "×")
        rows.append(row)
    return table(header, rows)


# ---- picture -------------------------------------------------------------------------------------


def plot_ensemble(sums: Sums, measured: tuple[Array, Array], path: Path) -> None:
    """Draw the 24 cells: measured on the ensemble's intervals, sums and changes.

    Args:
        sums: of the set-ups.
        measured: sums (24,) without dither and with it.
        path: PNG to write.
    """
    figure = Figure(figsize=(13.0, 11.5), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.15, 1.0))
    for values, m, shade, shift, fill in (
        (sums.no_dither, measured[0], WITHOUT, -0.2, "white"),
        (sums.dither, measured[1], WITH, 0.2, MEASURED),
    ):
        _bars(left, intervals(values), shade, shift)
        left.plot(m, np.arange(24) + shift, "o", ms=5, mfc=fill, mec=MEASURED, mew=1.3, zorder=5)
    for (name, values), shift in zip(sums.changes().items(), (-0.27, 0.0, 0.27), strict=True):
        _bars(right, np.exp(intervals(values)), SHADES[name], shift, thick=3.6)
    right.plot(measured[1] / measured[0], np.arange(24), "D", ms=5, color=MEASURED, zorder=5)
    right.axvline(1.0, color="0.3", lw=1.0)
    for axes in (left, right):
        axes.set_xscale("log")
        axes.grid(alpha=0.25, lw=0.6, axis="x", which="both")
        axes.spines[["top", "right"]].set_visible(False)
        for k in (5.5, 11.5, 17.5):
            axes.axhline(k, color="0.4", lw=0.8)
    ticks = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20]
    changes = [-80, -50, -25, 0, 50, 100, 200]
    left.set_xticks(ticks, [f"{t:g}" for t in ticks])
    right.set_xticks([1 + c / 100 for c in changes], [percent(c, 0) for c in changes], fontsize=8)
    names = [f"{AXES[k % 6]} [{unit(AXES[k % 6])}·samples]" for k in range(24)]
    left.set_yticks(range(24), names, fontsize=9)
    left.set_ylim(23.6, -0.6)
    for k, case in enumerate(thesis_cases()[::2]):
        title = f"{case.trajectory} {'/'.join(f'{x:g}' for x in case.stiffness)}"
        place: Any = left.get_yaxis_transform()
        left.text(0.005, 6 * k - 0.42, title, fontsize=9, va="top", transform=place)
    left.set_xlabel("sum of |error| over 200 samples")
    right.set_xlabel("change of the sum by dither")
    legends = (
        [
            Patch(color=WITHOUT, label="ensemble, no dither"),
            Patch(color=WITH, label="ensemble, with dither"),
            _dot("white", "o", "measured, no dither"),
            _dot(MEASURED, "o", "measured, with dither"),
        ],
        [
            *(Patch(color=shade, label=f"ensemble, {name}") for name, shade in SHADES.items()),
            _dot(MEASURED, "D", "measured"),
        ],
    )
    for axes, handles in zip((left, right), legends, strict=True):
        axes.set_xticks([], minor=True)
        style: dict[str, Any] = {"ncols": 2, "frameon": False, "fontsize": 9}
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.05), **style)
    figure.suptitle(
        f"{arm_title(ROBOT)}: Table 4.11 in an ensemble of {len(sums.no_dither)} set-ups, 50 % "
        "(thick) and 90 % (thin) intervals",
        fontsize=11,
    )
    save_full(figure, path)


def _bars(axes: Axes, ends: Array, shade: str, shift: float, thick: float = 6.0) -> None:
    y = np.arange(ends.shape[1]) + shift
    axes.hlines(y, ends[0], ends[-1], color=shade, lw=1.4, zorder=2)
    axes.hlines(y, ends[1], ends[-2], color=shade, lw=thick, alpha=0.75, zorder=3)
    axes.plot(ends[2], y, "|", ms=7, mew=1.4, color="white", zorder=4)


def _dot(face: str, marker: str, text: str) -> Line2D:
    return Line2D([], [], ls="", marker=marker, ms=5.5, mfc=face, mec=MEASURED, label=text)
