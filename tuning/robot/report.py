"""Current results of a robot's study: tables to measure, the best settings, the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.from_file import simulated_note
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.measured.tables import AMPLITUDE_COLUMNS, SJE_COLUMNS, AmplitudeRow, write_final
from stiction_envs.reporting.json_text import JsonRecord
from stiction_envs.reporting.kept_rows import KeptRows
from stiction_envs.reporting.markdown import number, table_text
from stiction_envs.reporting.templates import write_md_and_html
from tuning.robot.measured_table import readings
from tuning.robot.posterior import (
    CONFIGURATIONS,
    Candidates,
    Posterior,
    Readings,
    best_measured,
    chance_of_better,
    next_settings,
    posterior_of,
)
from tuning.robot.prediction import Cell, Predicted
from tuning.settings import RobotSettings

TEMPLATE = Path(__file__).parents[1] / "templates" / "ask.md.j2"
INTERVAL = 1.96
"""Half of a normal distribution's 95 % interval over its standard deviation [-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointState:
    """Current results of one joint."""

    candidates: Candidates
    readings: Readings
    posterior: Posterior
    asked: tuple[int, ...]
    """Settings to measure next; none where it is not worth it."""
    best: int | None
    """Setting with the lowest posterior mean among those measured in all four configurations."""
    chance: float
    """Probability that an untried setting is better by more than the tolerance [-]."""

    def row(self, setting: int) -> AmplitudeRow:
        """Return a setting as a row of an amplitude table."""
        c = self.candidates
        return AmplitudeRow(c.joint, float(c.frequency_hz[setting]), float(c.amplitude_nm[setting]))

    @property
    def chosen(self) -> int:
        """The best measured setting, or else the best predicted one."""
        mean = np.where(self.candidates.eligible, self.posterior.mean, np.inf)
        return int(mean.argmin()) if self.best is None else self.best

    @property
    def final(self) -> AmplitudeRow:
        """The row of final.csv: no dither where it is not expected to lower the torque."""
        if self.posterior.mean[self.chosen] >= 1.0:
            return AmplitudeRow(self.candidates.joint, 0.0, 0.0)
        return self.row(self.chosen)

    def measured(self) -> dict[int, float]:
        """Return the mean measured |τ|/|τ_base| of settings, over the configurations read."""
        r, known = self.readings, np.unique(self.readings.cell)
        mean = {int(cell): r.ratio[r.cell == cell].mean() for cell in known}
        return {
            s: float(np.mean([x for cell, x in mean.items() if cell // 4 == s]))
            for s in np.unique(known // 4).tolist()
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotState:
    """Current results of a robot."""

    robot: str
    joint_names: tuple[str, ...]
    joints: tuple[JointState, ...]
    missing: tuple[Cell, ...]
    """Cells whose base torque was not measured."""
    settings: RobotSettings
    told: int = 0
    """Number of settings that were new in the last table."""
    note: str = ""

    @property
    def asked(self) -> list[dict[str, float]]:
        """Settings to measure next, each with its number (1, 2, …) within its joint."""
        numbered = [(k, j.row(s)) for j in self.joints for k, s in enumerate(j.asked, 1)]
        return [{**_cells(row), "setting": k} for k, row in numbered]

    def to_json(self) -> dict[str, object]:
        """Return the JSON of ``stiction tune --ask --json``."""
        return {
            "robot": self.robot,
            "ask": self.asked,
            "final": [_cells(j.final) for j in self.joints],
            "joints": [
                {
                    "joint": j.candidates.joint,
                    "measured_settings": len(j.measured()),
                    "believed_reduction": float(1.0 - j.posterior.mean[j.chosen]),
                    "half_interval": float(INTERVAL * j.posterior.sd[j.chosen]),
                    "chance_of_better": j.chance,
                    "stop": not j.asked,
                }
                for j in self.joints
            ],
            "told": self.told,
        }

    def __str__(self) -> str:
        """Return the rows of ask.csv and a line of advice."""
        lines: list[str] = []
        if rows := self.asked:
            header, settings = _ask_lines(rows)
            lines = [",".join(map(str, line)) for line in (header, *settings)]
        stopped = ", ".join(str(j.candidates.joint) for j in self.joints if not j.asked)
        if stopped:
            lines.append(f"done: joints {stopped}: no untried setting is likely to be better")
        return "\n".join(lines)


def state_of(
    experiment: SingleJointExperiment,
    study: KeptRows,
    predicted: Predicted,
    settings: RobotSettings,
    count: int,
) -> RobotState:
    """Return the present state of the study, and up to ``count`` settings per joint to measure."""
    measured, missing = readings(study, predicted, settings.same)
    joints = []
    for j, c in sorted(predicted.candidates.items()):
        posterior = posterior_of(c, measured[j], settings)
        chance = chance_of_better(posterior, measured[j], settings)
        asked = []
        if chance >= 1.0 - settings.confidence:
            asked = next_settings(c, measured[j], count, settings)
        joints.append(
            JointState(
                candidates=c,
                readings=measured[j],
                posterior=posterior,
                asked=tuple(asked),
                best=best_measured(posterior, measured[j]),
                chance=chance,
            )
        )
    return RobotState(
        robot=experiment.sticking.arm.name,
        joint_names=experiment.sticking.arm.joint_names,
        joints=tuple(joints),
        missing=tuple(missing),
        settings=settings,
        note=simulated_note(experiment.sticking.arm, experiment.sticking.parameters),
    )


def write_state(folder: Path, state: RobotState, *, asked: bool) -> None:
    """Write final.csv, final.yaml, report.md; if ``asked``, ask.csv and measure.csv."""
    write_final(folder, [j.final for j in state.joints], state.joint_names)
    if asked:
        _write_asked(folder, state)
    title = f"Dither for {state.robot}, measured on the robot"
    write_md_and_html(folder, TEMPLATE, title, note=state.note, **_words(state))


def _ask_lines(rows: Sequence[JsonRecord]) -> tuple[tuple[str, ...], list[tuple[str | float, ...]]]:
    """Return header and lines of ask.csv; with numbers within a joint if there are several."""
    several = max(r["setting"] for r in rows) > 1
    columns = (*AMPLITUDE_COLUMNS, "setting") if several else AMPLITUDE_COLUMNS
    return columns, [tuple(r[c] for c in columns) for r in rows]


def _cells(row: AmplitudeRow) -> dict[str, float]:
    """Return a setting by `AMPLITUDE_COLUMNS`."""
    return {name: getattr(row, name) for name in AMPLITUDE_COLUMNS}


def _write_asked(folder: Path, state: RobotState) -> None:
    """Write ask.csv, and measure.csv: every cell to measure, with an empty torque."""
    if not (asked := state.asked):
        for name in ("ask.csv", "measure.csv"):
            (folder / name).unlink(missing_ok=True)
        return
    write_lines(folder / "ask.csv", *_ask_lines(asked))
    open_joints = {r["joint"] for r in asked}
    missing = [cell for cell in state.missing if cell[0] in open_joints]
    rows: list[tuple[str | float, ...]] = [(*cell, 0.0, 0.0) for cell in missing]
    for j in state.joints:
        for s in j.asked:
            row = j.row(s)
            rows += [
                (row.joint, *cell, row.frequency_hz, row.amplitude_nm)
                for c, cell in enumerate(CONFIGURATIONS)
                if not j.readings.tried[s, c]
            ]
    empty = ("",) * (len(SJE_COLUMNS) - 6)
    cells = [(state.robot, *row, *empty) for row in rows]
    write_lines(folder / "measure.csv", SJE_COLUMNS, cells)


def _words(state: RobotState) -> dict[str, object]:
    """Return the variables of the report's template."""
    s = state.settings
    best = []
    for j in state.joints:
        row = j.final
        best.append(
            [
                str(row.joint),
                f"{number(row.frequency_hz)} Hz, {number(row.amplitude_nm, 3)} N·m",
                "measured" if j.best is not None else "predicted only",
                _interval(j, j.chosen),
                str(len(j.measured())),
                f"{number(100 * j.chance, 0)} %",
                "go on" if j.asked else "stop",
            ]
        )
    joints = []
    for j in state.joints:
        found = j.measured()
        mean = j.posterior.mean.tolist()
        shown = sorted({*found, *j.asked, j.chosen}, key=mean.__getitem__)
        rows = []
        for k in shown:
            row = j.row(k)
            note = "next" if k in j.asked else ""
            if j.readings.failed[k]:
                note = "stuck in a configuration"
            elif not j.candidates.eligible[k]:
                note = "shakes more than the limit"
            rows.append(
                [
                    number(row.frequency_hz),
                    number(row.amplitude_nm, 3),
                    number(100 * (1 - float(j.candidates.predicted[k].mean()))),
                    number(100 * (1 - found.get(k, math.nan))),
                    _interval(j, k),
                    f"{1e3 * float(np.sqrt(np.mean(j.candidates.displacement[k] ** 2))):.3f}",
                    note,
                ]
            )
        header = ["f [Hz]", "A [N·m]", "simulated [%]", "measured [%]", "predicted [%]"]
        joints.append((j.candidates.joint, table_text([*header, "displacement [mrad]", ""], rows)))
    header = ["joint", "best setting", "", "predicted reduction [%]", "settings measured"]
    return {
        "robot": state.robot,
        "best": table_text([*header, "chance that another is better", "advice"], best),
        "joints": joints,
        "stop": [j.candidates.joint for j in state.joints if not j.asked],
        "go_on": [j.candidates.joint for j in state.joints if j.asked],
        "tolerance": 100 * s.tolerance,
        "confidence": 100 * s.confidence,
        "missing": len(state.missing),
        "cells": 4 * len(state.joints),
    }


def _interval(j: JointState, setting: int) -> str:
    mean, half = j.posterior.mean[setting], INTERVAL * j.posterior.sd[setting]
    return f"{number(100 * (1 - float(mean)))} ± {number(100 * float(half))}"
