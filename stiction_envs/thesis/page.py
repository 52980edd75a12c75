"""The page of a ladder: `gap.md`, `ladder.md` and their pictures, all computed from the rungs.

write_page(folder, ladder.rungs, study=study_phase())
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from stiction_envs.errors import StictionError
from stiction_envs.gap.tables.cells import Cell, Score, cells
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.markdown import plural, table
from stiction_envs.thesis import figures, page_iiwa, page_joints, page_limits, page_questions
from stiction_envs.thesis.nested_models import Rung
from stiction_envs.thesis.nyquist_phase import PhaseStudy
from stiction_envs.thesis.scores import JOINTS, TARGETS, Findings
from stiction_envs.thesis.words import place

FILES = (
    "gap.md",
    "ladder.md",
    "ladder.png",
    "residuals.png",
    *(f"joint_{j}.png" for j in JOINTS),
)
"""What `write_page` always writes; with a study of the iiwa ``iiwa.png`` too."""


def ladder_table(findings: Findings) -> list[str]:
    """Return the table of rungs: mean with interval, median, each table and joint [%]."""
    scores = list(findings.scores.values())
    columns = list(scores[0].by_column)
    header = ["rung", "mean [95 %]", "median", *columns, *(f"J{j}" for j in JOINTS)]
    return table(header, [_score_row(s) for s in scores])


def _score_row(s: Score) -> list[str]:
    numbers = [*s.by_column.values(), *s.by_joint.values()]
    row = [s.name, f"{s.mean:.1f} [{s.low:.1f}, {s.high:.1f}]", f"{s.median:.1f}"]
    return [*row, *(f"{x:.1f}" for x in numbers)]


def ladder_page(findings: Findings) -> list[str]:
    """Return the lines of `ladder.md`."""
    f = findings
    held = int(f.held_out.sum())
    lines = [
        "# The thesis's dithered torques, one physical statement after the other",
        "",
        "Mean |predicted − measured| in per cent of the base torque on the "
        f"{plural(held, 'held-out cell')} of Tables 4.7, 4.8 and 4.10, with a 95 % bootstrap "
        "interval over the 28 configurations. Rungs with physics are fitted to Tables 4.3 and 4.6 "
        "only; priors and bounds are published or assumed values that have seen none of the "
        "tables held out (`stiction_envs/gap/dither_fit.toml`).",
        "",
        *ladder_table(f),
        f"The thesis repeats itself to {f.floor[0]:.1f} % mean, {f.floor[1]:.1f} % median. Target: "
        + ", ".join(f"{k} at most {v:g} %" for k, v in TARGETS.items())
        + ".",
        "",
        "![ladder](ladder.png)",
        "",
        "| rung | statement |",
        "|---|---|",
        *(f"| {r.name} | {r.statement.rstrip('.')} |" for r in f.rungs.values()),
        "",
    ]
    broken = [(i, c) for i, c in enumerate(f.cells) if c.row.outlier]
    if broken:
        lines += ["Broken cells, scored apart:", ""]
        shown = list(dict.fromkeys(k for k in (*list(f.rungs)[:1], f.last)))
        for i, c in broken:
            errors = [f"{f.scores[k].error[i]:.0f} % ({f.rungs[k].name})" for k in shown]
            lines.append(
                f"- Table {c.row.table}, joint {c.row.joint}, {place(c.configuration)}, "
                f"{c.row.frequency_hz:g} Hz, scale {c.row.scale:g}: error {', '.join(errors)}"
            )
        lines.append("")
    return lines


def gap_page(findings: Findings, study: PhaseStudy | None) -> list[str]:
    """Return the lines of `gap.md`."""
    f = findings
    held, broken = int(f.held_out.sum()), int((~f.sound).sum())
    last = f.scores[f.last]
    first = f.scores.get("nothing")
    lines = [
        "# Where a simulated Panda's dither differs from the real one, and why",
        "",
        f"A thesis (Lund 2023) measured {len(f.cells)} dithered breakaway torques on a Panda. Here "
        "a simulated joint is given one physical statement after the other, each fitted to Tables "
        f"4.3 and 4.6 alone, and asked for the {held} cells of Tables 4.7, 4.8 and 4.10 that no "
        f"fit has seen ({plural(broken, 'broken cell')} apart). Errors are in per cent of the base "
        "torque of the cell, the torque that moves the joint by 0.15 rad without dither.",
        "",
        (
            ""
            if first is None
            else f"If dither did nothing the mean error would be {first.mean:.1f} %. "
        )
        + f"The last rung, *{last.name}*, is off by {last.mean:.1f} % [{last.low:.1f}, "
        f"{last.high:.1f}] in the mean and {last.median:.1f} % in the median; the thesis repeats "
        f"itself to {f.floor[0]:.1f} and {f.floor[1]:.1f} %.",
        "",
    ]
    fitted = any(r.found for r in f.rungs.values())
    if not f.complete:
        lines += [
            f"> This ladder is not finished: its last rung is *{last.name}*. What follows is of "
            "that rung"
            + ("." if fitted else "; with nothing fitted yet, theory takes the priors' centres."),
            "",
        ]
    lines += [
        "![ladder](ladder.png)",
        "",
        "All rungs, by table and joint: [ladder.md](ladder.md).",
        "",
        "## The causes, joint by joint",
        "",
        "A cause is named where it lowers the joint's held-out error by more than the scatter of "
        "its cells (95 % bootstrap): as the rungs stand, or with each configuration's base free to "
        "move on both sides of the comparison, so that only the dependence on frequency and "
        "amplitude counts. Causes are added in the order of the ladder: each gain is over all "
        "statements before it, the first over the bare band. A *constant* is each configuration's "
        "median change in Table 4.6, at any frequency and amplitude; where it is as good, the "
        "tables do not show that physics is needed.",
        "",
        *page_joints.overview(f),
    ]
    for number in JOINTS:
        lines += page_joints.section(f, number)
    for part in (page_questions.band, page_questions.frequency, page_questions.asymmetry):
        lines += part(f)
    lines += page_iiwa.section(study)
    return [*lines, *page_limits.identification(f), *page_limits.remains(f)]


def write_page(
    folder: Path,
    rungs: Mapping[str, Rung],
    *,
    chosen: Sequence[Cell] | None = None,
    study: PhaseStudy | None = None,
    progress: Callable[[str, float, float], None] | None = None,
) -> dict[str, Any]:
    """Write the page and its pictures of a ladder, finished or not.

    Args:
        folder: where; it exists.
        rungs: by key, as `Ladder.rungs`; at least one.
        chosen: the cells the rungs predict; None for all of the Panda.
        study: the iiwa's phases; None leaves that picture out.
        progress: called with (stage, done, total).

    Returns:
        The summary that ``--json`` prints: scores of every rung, targets, causes by joint.

    Raises:
        StictionError: no rungs, or of another number of cells.
    """
    chosen = cells() if chosen is None else list(chosen)
    if not rungs:
        raise StictionError("a page needs at least one rung of the ladder")
    for key, rung in rungs.items():
        if len(rung.change) != len(chosen):
            raise StictionError(
                f"rung {key!r} predicts {len(rung.change)} cells, but there are {len(chosen)}"
            )
    findings = Findings(rungs, chosen)
    tasks: list[tuple[str, Callable[[Path], None]]] = [
        ("ladder.png", lambda path: figures.ladder(findings, path)),
        ("residuals.png", lambda path: figures.residuals(findings, path)),
    ]
    for number in JOINTS:

        def draw(path: Path, number: int = number) -> None:
            figures.joint(findings, number, path)

        tasks.append((f"joint_{number}.png", draw))
    if study is not None:
        tasks.append(("iiwa.png", lambda path: figures.iiwa(study, path)))
    for done, (name, task) in enumerate(tasks):
        task(folder / name)
        if progress is not None:
            progress("page", done + 1, len(tasks))
    for name, lines in (
        ("ladder.md", ladder_page(findings)),
        ("gap.md", gap_page(findings, study)),
    ):
        write_text_atomic(folder / name, "\n".join(lines).rstrip() + "\n")
    return summary(findings)


def summary(findings: Findings) -> dict[str, Any]:
    """Return scores, targets and causes as plain values, errors in % of the base torque."""
    return {
        "finished": findings.complete,
        "held_out_cells": int(findings.held_out.sum()),
        "repeats": {"mean": findings.floor[0], "median": findings.floor[1]},
        "rungs": [
            {
                "key": key,
                "name": s.name,
                "mean": s.mean,
                "ci95": [s.low, s.high],
                "median": s.median,
                "by_table": s.by_column,
                "by_joint": s.by_joint,
            }
            for key, s in findings.scores.items()
        ],
        "targets": {
            name: {"reached": reached, "target": aim, "met": reached <= aim}
            for name, (reached, aim) in findings.targets().items()
        },
        "causes": [
            {
                "joint": number,
                "name": g.key,
                "before": g.plain.before,
                "after": g.plain.after,
                "ci95": [g.plain.low, g.plain.high],
            }
            for number in JOINTS
            for g in findings.gains(number)
            if g.named
        ],
    }
