"""The ensemble of Table 4.11 as files: `ensemble.csv`, `ensemble.png` and a section of the page."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from stiction_envs.control.settings import gte_default
from stiction_envs.experiments.gte.plots import MEASURED
from stiction_envs.experiments.gte.protocol import AXES
from stiction_envs.experiments.gte.rows import unit
from stiction_envs.experiments.sje.plots import WITH, WITHOUT
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.markdown import listed, percent, plural, short, table_text
from stiction_envs.reporting.png import save_full
from stiction_envs.reporting.templates import render
from stiction_envs.robots import arm_title
from stiction_envs.thesis.ensemble import Member
from stiction_envs.thesis.ensemble_prior import bare_arm
from stiction_envs.thesis.ensemble_scores import (
    Coverage,
    Sums,
    factor,
    inside,
    intervals,
    lag,
    measured_sums,
    rank_correlation,
    scores,
    signs_right,
    stack,
)
from stiction_envs.thesis.ensemble_settings import RunSettings, ensemble_settings
from stiction_envs.thesis.gte import ROBOT, thesis_cases

Array = NDArray[np.float64]
LAWS = {"diagonal": "the package's damping (2√K)", "mass": "that of eq. 2.14"}
KINDS = {
    "both": "two sessions",
    "dither": "dither alone",
    "session": "another session alone",
}
SHADES = {"both": WITH, "dither": "#7b3fa0", "session": WITHOUT}


def write_ensemble(
    folder: Path,
    members: Sequence[Member],
    shipped: Mapping[str, float],
    settings: RunSettings | None = None,
) -> tuple[str, dict[str, Any]]:
    """Write `ensemble.csv` and `ensemble.png`; return the section for `gte.md` and its numbers.

    Args:
        folder: where; it exists.
        members: of `run_ensemble`.
        shipped: share of the error that is lag in the shipped set-up, by damping law.
        settings: None for the defaults.
    """
    s = ensemble_settings().run if settings is None else settings
    measured, sums = measured_sums(), stack(members)
    found = scores(members, measured, fitting=s.fitting)
    write_lines(folder / "ensemble.csv", *_lines(members, sums, measured))
    plot_ensemble(sums, measured, folder / "ensemble.png")
    return section(found, sums, measured, shipped, s), _numbers(found)


def _numbers(found: Any) -> Any:
    """Return scores as JSON has them."""
    if isinstance(found, Coverage):
        return dataclasses.asdict(found)
    return {k: _numbers(v) for k, v in found.items()} if isinstance(found, dict) else found


def _lines(
    members: Sequence[Member], sums: Sums, measured: tuple[Array, Array]
) -> tuple[list[str], list[list[Any]]]:
    """Return header and rows of `ensemble.csv`: what was drawn, then what came of it."""
    change = np.log(measured[1] / measured[0])
    results: dict[str, Array] = {
        "factor": factor(sums.no_dither, measured[0]),
        "size": np.exp(np.log(sums.no_dither / measured[0]).mean(axis=1)),
        "lag_share": lag(sums.free, sums.no_dither),
    }
    for name, values in (
        ("two_sessions", sums.change),
        ("dither_alone", sums.by_dither),
        ("session_alone", sums.by_session),
    ):
        results[f"signs_right_{name}"] = signs_right(values, change).astype(float)
        results[f"rank_correlation_{name}"] = rank_correlation(values, change)
        results[f"median_change_{name}"] = np.expm1(np.median(values, axis=1))
    for kind, values in (("no_dither", sums.no_dither), ("dither", sums.dither)):
        for k, cell in enumerate(_names("_")):
            results[f"{kind}_{cell}"] = values[:, k]
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


def _names(between: str = " ") -> list[str]:
    """Return the 24 cells: path, translational stiffness, axis."""
    return [
        between.join((c.trajectory, f"{c.stiffness[0]:g}", axis))
        for c in thesis_cases()[::2]
        for axis in AXES
    ]


# ---- section -------------------------------------------------------------------------------------


def section(
    found: dict[str, Any],
    sums: Sums,
    measured: tuple[Array, Array],
    shipped: Mapping[str, float],
    s: RunSettings,
) -> str:
    """Return the Markdown of the ensemble; its sentences follow the numbers."""
    settle = found["settle"]
    p = bare_arm().parameters
    dry = (p.stiction * p.coulomb_ratio).mean(axis=1)
    steps = dry / np.repeat([s.log_proximal, s.log_wrist], [4, 3])
    return render(
        Path(__file__).parent / "templates" / "ensemble.md.j2",
        s=found,
        margin=gte_default("impedance.limit_margin"),
        laws=LAWS,
        shipped=shipped,
        outside=(
            _outside(np.log(sums.no_dither), np.log(measured[0]), "no dither"),
            _outside(sums.change, np.log(measured[1] / measured[0]), "change, two sessions"),
        ),
        verdict=partial(_verdict, rare=s.rare),
        logged=(s.log_proximal, s.log_wrist),
        kinds=_kinds(found),
        reach=_reach(found),
        settle=_settle(settle),
        dry=(float(dry.min()), float(dry.max())),
        steps=(float(steps.min()), float(steps.max())),
        speeds=", ".join(short(x, 2) for x in settle["speed"]),
        shaking=", ".join(short(x, 2) for x in settle["shaking"]),
        half=", ".join(short(x, 2) for x in settle["half"]),
        cells=_cells(sums, measured),
    )


def _verdict(c: Coverage, what: str, *, rare: float) -> str:
    """Return how usual a coverage is for the ensemble's own set-ups."""
    low, middle, high = c.own_90
    text = (
        f"A set-up of the ensemble itself, held against the others, has {middle:.0f} of its cells "
        f"in their 90 % intervals ({low:.0f} to {high:.0f} in nine of ten), and {c.as_few} of "
        f"{c.set_ups} have no more than {c.in_90}"
    )
    if c.as_few < rare * c.set_ups:
        return f"{text}: the prior or the model lacks something that the measured {what} have."
    return f"{text}: the measured {what} are such as one of these set-ups may have."


def _outside(values: Array, measured: Array, what: str) -> str:
    """Return which measured values are beyond the 90 % intervals."""
    names = np.array(_names())[~inside(intervals(values), measured)[1]]
    return f"Outside the 90 %: {listed(names) or 'no cell'} ({what})."


def _kinds(found: dict[str, Any]) -> str:
    header = ["what differs", "in 50 %", "in 90 %", f"signs right of {found['cells']}"]
    header += [f"set-ups above {found['always_falls']}", "rank correlation", "median change"]
    rows = []
    for name, title in KINDS.items():
        k, c = found["kinds"][name], found["changes"][name]
        rows.append(
            [
                title,
                str(c.in_50),
                str(c.in_90),
                f"{k['signs']['median']:.0f} ({k['signs']['low']:.0f} to {k['signs']['high']:.0f})",
                str(k["above_falls"]),
                _ranged(k["rank"], lambda x: f"{x:.2f}".replace("-", "−")),
                _ranged(k["median_change"], lambda x: percent(100 * x)),
            ]
        )
    rows.append(['"every error falls"', "", "", str(found["always_falls"]), "", "", ""])
    rows.append(["measured", "", "", "", "", "", percent(100 * found["measured_median_change"])])
    return table_text(header, rows)


def _ranged(spread: dict[str, float], text: Any) -> str:
    return f"{text(spread['median'])} ({text(spread['low'])} to {text(spread['high'])})"


def _reach(found: dict[str, Any]) -> str:
    """Return who reaches the measured median change, and what another session would have to be."""
    count, change = found["set_ups"], found["measured_median_change"]
    dither, session, both = (found["kinds"][k]["reach"] for k in ("dither", "session", "both"))
    text = (
        f"The measured median change of {percent(100 * change)} is reached by dither alone in "
        f"{dither} of {count} set-ups, by another session alone in {session}, by both in {both}"
    )
    if session and session >= dither:
        text += ": another session explains it at least as well as dither does"
    gone = found["friction_gone"]
    usual, least = (f"{100 * gone[k]:.0f} %" for k in ("median", "low"))
    text += (
        f". Where error rises with dry friction in a straight line, {usual} of the friction would "
        f"have to be gone in the session with dither ({least} in the set-ups with the least lag)"
    )
    return f"{text}."


def _settle(t: dict[str, Any]) -> str:
    """Return what interleaved runs are worth."""
    pairs, days = _count(t["mean_pairs"], "pair"), _count(t["mean_repeats"], "day")
    effect, drift, run = (f"{100 * t[f'cell_{k}']:.1f} %" for k in ("effect", "drift", "run"))
    return (
        f"Interleaved, {pairs} of runs let it stand at two standard errors; in two blocks it "
        f"takes both of them on {days}, however many runs a block has. Of one cell, dither changes "
        f"the sum by {effect} (median of the sizes over set-ups and cells), another session by "
        f"{drift}, another run by {run} (standard deviations): the median cell needs "
        f"{_count(t['cell_pairs'], 'pair')}, ten are enough for {100 * t['in_ten']:.0f} % of the "
        f"cells, and in two blocks {100 * t['above_drift']:.0f} % exceed two standard deviations "
        "of the session."
    )


def _count(needed: float, noun: str) -> str:
    return plural(int(needed), noun) if np.isfinite(needed) else f"no number of {noun}s"


def _cells(sums: Sums, measured: tuple[Array, Array]) -> str:
    """Return the table of the 24 cells."""
    change = np.log(measured[1] / measured[0])
    columns = (
        (sums.no_dither, measured[0], lambda x: short(x, 3)),
        (sums.dither, measured[1], lambda x: short(x, 3)),
        (sums.change, change, lambda x: percent(100 * np.expm1(x), 0)),
    )
    header = ["cell"]
    for name in ("no dither", "with dither", "change, two sessions"):
        header += [name, "50 %", "90 %", ""]
    drawn = [(intervals(v), m, text) for v, m, text in columns]
    marks = [inside(ends, m) for ends, m, _ in drawn]
    rows = []
    for k, name in enumerate(_names()):
        row = [f"{name} [{unit(AXES[k % 6])}·samples]"]
        for (ends, m, text), (half, most) in zip(drawn, marks, strict=True):
            mark = "●" if half[k] else "○" if most[k] else "×"
            row += [text(m[k]), *(_to(ends[:, k], i, text) for i in (1, 0)), mark]
        rows.append(row)
    return table_text(header, rows)


def _to(ends: Array, k: int, text: Any) -> str:
    return f"{text(ends[k])} to {text(ends[-1 - k])}"


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
    kinds = {"both": sums.change, "dither": sums.by_dither, "session": sums.by_session}
    for (name, values), shift in zip(kinds.items(), (-0.27, 0.0, 0.27), strict=True):
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
    left.set_xticks(ticks, [f"{t:g}" for t in ticks])
    left.set_xticks([], minor=True)
    changes = [-80, -50, -25, 0, 50, 100, 200]
    right.set_xticks([1 + c / 100 for c in changes], [percent(c, 0) for c in changes], fontsize=8)
    right.set_xticks([], minor=True)
    left.set_yticks(
        range(24), [f"{AXES[k % 6]} [{unit(AXES[k % 6])}·samples]" for k in range(24)], fontsize=9
    )
    left.set_ylim(23.6, -0.6)
    for k, case in enumerate(thesis_cases()[::2]):
        title = f"{case.trajectory} {'/'.join(f'{x:g}' for x in case.stiffness)}"
        left.text(0.005, 6 * k - 0.42, title, fontsize=9, va="top", transform=_mixed(left))
    left.set_xlabel("sum of |error| over 200 samples")
    right.set_xlabel("change of the sum by dither")
    for axes, handles in ((left, _left_legend()), (right, _right_legend())):
        axes.legend(
            handles=handles,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.05),
            ncols=2,
            frameon=False,
            fontsize=9,
        )
    figure.suptitle(
        f"{arm_title(ROBOT)}: Table 4.11 in an ensemble of {len(sums.no_dither)} set-ups, 50 % "
        "(thick) and 90 % (thin) intervals",
        fontsize=11,
    )
    save_full(figure, path)


def _mixed(axes: Axes) -> Any:
    """Return coordinates along the axes in x, of the data in y."""
    return axes.get_yaxis_transform()


def _bars(axes: Axes, ends: Array, shade: str, shift: float, thick: float = 6.0) -> None:
    y = np.arange(ends.shape[1]) + shift
    axes.hlines(y, ends[0], ends[-1], color=shade, lw=1.4, zorder=2)
    axes.hlines(y, ends[1], ends[-2], color=shade, lw=thick, alpha=0.75, zorder=3)
    axes.plot(ends[2], y, "|", ms=7, mew=1.4, color="white", zorder=4)


def _left_legend() -> list[Any]:
    return [
        Patch(color=WITHOUT, label="ensemble, no dither"),
        Patch(color=WITH, label="ensemble, with dither"),
        _dot("white", "o", "measured, no dither"),
        _dot(MEASURED, "o", "measured, with dither"),
    ]


def _right_legend() -> list[Any]:
    return [
        *(Patch(color=SHADES[k], label=f"ensemble, {title}") for k, title in KINDS.items()),
        _dot(MEASURED, "D", "measured"),
    ]


def _dot(face: str, marker: str, text: str) -> Line2D:
    return Line2D([], [], ls="", marker=marker, ms=5.5, mfc=face, mec=MEASURED, label=text)
