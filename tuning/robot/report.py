"""Current results of a robot's study: tables to measure, the best settings, the report."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

from stiction_envs.experiments.sje.protocol import Configuration
from stiction_envs.friction.from_file import simulated_note
from stiction_envs.friction.model import StickingModel
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.measured.tables import AMPLITUDE_COLUMNS, SJE_COLUMNS, AmplitudeRow, write_final
from stiction_envs.reporting.json_text import JsonRecord
from stiction_envs.reporting.markdown import number, table_text
from stiction_envs.reporting.templates import write_md_and_html
from tuning.robot.posterior import CONFIGURATIONS, Posterior

TEMPLATE = Path(__file__).parents[1] / "templates" / "ask.md.j2"
INTERVAL = 1.96  # Half of a normal distribution's 95 % interval over its standard deviation [-]


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotState:
    """Current results of a robot."""

    sticking: StickingModel
    joints: Mapping[Posterior, Sequence[int]]
    """Every joint, and its settings to measure next; none where it is not worth it."""
    missing: Sequence[Configuration]  # Configurations whose base torque was not measured
    told: int = 0  # Number of settings that were new in the last table

    @property
    def final(self) -> list[AmplitudeRow]:
        """The rows of final.csv: no dither where it is not expected to lower the torque."""
        return [
            AmplitudeRow(p.candidates.joint, 0.0, 0.0)
            if p.mean[p.chosen] >= 1.0
            else p.candidates.row(p.chosen)
            for p in self.joints
        ]

    @property
    def asked(self) -> list[dict[str, float]]:
        """Settings to measure next, each with its number (1, 2, …) within its joint."""
        return [
            {**_cells(p.candidates.row(setting)), "setting": k}
            for p, settings in self.joints.items()
            for k, setting in enumerate(settings, 1)
        ]

    @property
    def stopped(self) -> list[int]:
        """Joints that are finished."""
        return [p.candidates.joint for p, settings in self.joints.items() if not settings]

    @property
    def unfinished(self) -> list[int]:
        """Joints with settings to measure."""
        return [p.candidates.joint for p, settings in self.joints.items() if settings]

    def to_json(self) -> dict[str, object]:
        """Return the JSON of ``stiction tune --ask --json``."""
        return {
            "robot": self.sticking.arm.name,
            "ask": self.asked,
            "final": [_cells(row) for row in self.final],
            "joints": [
                {
                    "joint": p.candidates.joint,
                    "measured_settings": len(measured_means(p)),
                    "believed_reduction": float(1.0 - p.mean[p.chosen]),
                    "half_interval": float(INTERVAL * p.sd[p.chosen]),
                    "chance_of_better": p.chance_of_better,
                    "stop": not settings,
                }
                for p, settings in self.joints.items()
            ],
            "told": self.told,
        }

    def __str__(self) -> str:
        """Return the rows of ask.csv and a line of advice."""
        lines: list[str] = []
        if rows := self.asked:
            header, settings = _ask_lines(rows)
            lines = [",".join(map(str, line)) for line in (header, *settings)]
        if stopped := ", ".join(map(str, self.stopped)):
            lines.append(f"done: joints {stopped}: no untried setting is likely to be better")
        return "\n".join(lines)


def measured_means(posterior: Posterior) -> dict[int, float]:
    """Return the mean measured |τ|/|τ_base| of settings, over the configurations read."""
    r = posterior.readings
    known = np.unique(r.cell)
    mean = {int(cell): r.ratio[r.cell == cell].mean() for cell in known}
    return {
        s: float(np.mean([x for cell, x in mean.items() if cell // 4 == s]))
        for s in np.unique(known // 4).tolist()
    }


def write_state(folder: Path, state: RobotState, *, asked: bool) -> None:
    """Write final.csv, final.yaml, report.md; if ``asked``, ask.csv and measure.csv."""
    arm = state.sticking.arm
    write_final(folder, state.final, arm.joint_names)
    if asked:
        _write_asked(folder, state)
    title = f"Dither for {arm.name}, measured on the robot"
    note = simulated_note(arm, state.sticking.parameters)
    write_md_and_html(folder, TEMPLATE, title, note=note, **_words(state))


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
    if not state.asked:
        for name in ("ask.csv", "measure.csv"):
            (folder / name).unlink(missing_ok=True)
        return
    write_lines(folder / "ask.csv", *_ask_lines(state.asked))
    rows: list[tuple[str | float, ...]] = [
        (*astuple(c), 0.0, 0.0) for c in state.missing if c.joint in state.unfinished
    ]
    for p, settings in state.joints.items():
        for s in settings:
            row = p.candidates.row(s)
            rows += [
                (row.joint, *cell, row.frequency_hz, row.amplitude_nm)
                for c, cell in enumerate(CONFIGURATIONS)
                if not p.readings.tried[s, c]
            ]
    empty = ("",) * (len(SJE_COLUMNS) - 6)
    cells = [(state.sticking.arm.name, *row, *empty) for row in rows]
    write_lines(folder / "measure.csv", SJE_COLUMNS, cells)


def _words(state: RobotState) -> dict[str, object]:
    """Return the variables of the report's template."""
    best, joints = [], []
    columns = ["f [Hz]", "A [N·m]", "simulated [%]", "measured [%]", "predicted [%]"]
    columns += ["displacement [mrad]", ""]
    for (p, settings), row in zip(state.joints.items(), state.final, strict=True):
        found = measured_means(p)
        best.append(
            [
                str(row.joint),
                f"{number(row.frequency_hz)} Hz, {number(row.amplitude_nm, 3)} N·m",
                "predicted only" if p.best is None else "measured",
                _interval(p, p.chosen),
                str(len(found)),
                f"{number(100 * p.chance_of_better, 0)} %",
                "go on" if settings else "stop",
            ]
        )
        rows = []
        for k in sorted({*found, *settings, p.chosen}, key=p.mean.tolist().__getitem__):
            tried = p.candidates.row(k)
            note = "next" if k in settings else ""
            if p.readings.failed[k]:
                note = "stuck in a configuration"
            elif not p.candidates.eligible[k]:
                note = "shakes more than the limit"
            rows.append(
                [
                    number(tried.frequency_hz),
                    number(tried.amplitude_nm, 3),
                    number(100 * (1 - float(p.candidates.predicted[k].mean()))),
                    number(100 * (1 - found.get(k, math.nan))),
                    _interval(p, k),
                    f"{1e3 * float(np.sqrt(np.mean(p.candidates.displacement[k] ** 2))):.3f}",
                    note,
                ]
            )
        joints.append((row.joint, table_text(columns, rows)))
    header = ["joint", "best setting", "", "predicted reduction [%]", "settings measured"]
    return {
        "robot": state.sticking.arm.name,
        "best": table_text([*header, "chance that another is better", "advice"], best),
        "joints": joints,
        "stop": state.stopped,
        "go_on": state.unfinished,
        "tolerance": 100 * p.settings.tolerance,
        "confidence": 100 * p.settings.confidence,
        "missing": len(state.missing),
        "cells": 4 * len(state.joints),
    }


def _interval(posterior: Posterior, setting: int) -> str:
    mean, half = posterior.mean[setting], INTERVAL * posterior.sd[setting]
    return f"{number(100 * (1 - float(mean)))} ± {number(100 * float(half))}"
