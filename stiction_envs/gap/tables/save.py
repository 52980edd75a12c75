"""A diagnosis of torque tables with all that is written of it: model, report, picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from stiction_envs.friction.assumed import friction_note
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters
from stiction_envs.friction.plain_mjcf import plain_mjcf
from stiction_envs.gap.extended_model import Extension
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.result import DiagnosisResult
from stiction_envs.gap.tables.extended import extended_friction
from stiction_envs.gap.tables.sentences import TableCause, TableDiagnosis
from stiction_envs.measured.logs.sources import LogSources
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.json_text import write_json
from stiction_envs.reporting.markdown import joints, listed, short, table_text
from stiction_envs.reporting.templates import write_md_and_html
from stiction_envs.robots import Arm

TEMPLATE = Path(__file__).parents[1] / "templates" / "tables.md.j2"
HEADLINES = {
    "explained": "The named causes explain what the simulation gets wrong, down to the noise.",
    "partly explained": "The named causes explain part of what the simulation gets wrong.",
    "no discrepancy": "The simulation agrees with the tables; no cause is significant.",
    "cannot tell": "These tables cannot tell what the simulation gets wrong.",
}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TableResult(DiagnosisResult):
    """What a simulation gets wrong about torque tables."""

    diagnosis: TableDiagnosis
    """With errors per joint."""
    arm: Arm
    friction: FrictionParameters
    """Nominal."""
    nominal_name: str
    """What was judged: "shipped" or a file's name."""
    sources: LogSources
    provenance: dict[str, Any]

    @property
    def robot(self) -> str:
        """Name of the arm."""
        return self.diagnosis.robot

    @property
    def verdict(self) -> str:
        """``explained``, ``partly explained``, ``no discrepancy`` or ``cannot tell``."""
        return self.diagnosis.verdict

    @property
    def causes(self) -> tuple[TableCause, ...]:
        """Strongest first."""
        return self.diagnosis.causes

    @property
    def gain_percent(self) -> float:
        """100 (1 − mean over joints of extended over nominal error) [%]."""
        return self.diagnosis.gain_percent

    @property
    def summary(self) -> str:
        """The verdict in sentences."""
        text = HEADLINES[self.verdict]
        if self.causes:
            names = [f"{c.name} ({joints(c.joints)})" for c in self.causes]
            text += (
                f" {listed(names)}, strongest first, take {self.gain_percent:.0f} % off the "
                "held-out error."
            )
        reason = self.diagnosis.reason
        return f"{text} {reason[:1].upper()}{reason[1:]}." if reason else text

    @cached_property
    def extension(self) -> Extension:
        """The arm with its causes."""
        friction, changed, missing = extended_friction(self.arm, self.friction, self.causes)
        found = {k: f"stiction diagnose: {v} in torque tables" for k, v in changed.items()}
        sources = dict.fromkeys(QUANTITIES, f"nominal friction: {self.nominal_name}") | found
        return Extension(
            xml=plain_mjcf(build(self.arm, friction), friction_name="a diagnosis of torque tables"),
            friction=friction,
            sources=sources,
            nominal=Nominal(
                friction=friction,
                robot=self.arm.name,
                payload=self.arm.payload,
                tilt=self.arm.tilt,
            ),
            missing=missing,
            friction_missing=missing,
            left_out=np.zeros((0, self.arm.n)),
        )

    def to_json(self) -> dict[str, Any]:
        """Return ``diagnosis.json``."""
        return self.diagnosis.as_dict()

    def write(self, folder: Path, *, progress: Callable[[str, float], None] | None = None) -> None:
        """Write ``diagnosis.json``, ``model.xml``, ``model.toml``, report and a picture.

        Args:
            folder: an existing one.
            progress: called with a stage and its part done.
        """
        from stiction_envs.gap.tables.plots import plot_errors

        (progress or (lambda *_: None))("report", 0.0)
        hashes = self.sources.hashes(self.provenance)
        write_json(folder / "diagnosis.json", self.to_json())
        write_text_atomic(folder / "model.xml", self.extension.xml)
        meta = {
            "title": f"{self.robot} as its torque tables show it",
            "units": "SI",
            "verdict": self.verdict,
        }
        write_text_atomic(folder / "model.toml", self.extension.toml(meta=meta, provenance=hashes))
        (folder / "plots").mkdir(exist_ok=True)
        d = self.diagnosis
        if any(math.isfinite(x) for x in d.nominal.values()):
            plot_errors(d.nominal, d.extended, d.noise_floor, folder / "plots" / "summary.png")
        write_md_and_html(
            folder,
            TEMPLATE,
            f"Diagnosis of {self.robot}: {self.verdict}",
            note=friction_note(self.arm, self.friction),
            d=d,
            summary=self.summary,
            nominal_name=self.nominal_name,
            drawn=(folder / "plots" / "summary.png").is_file(),
            errors=self._errors(),
            parameters=[_parameters(c) for c in d.causes],
            extension=self.extension,
            provenance=table_text(["", ""], [[a, b] for a, b in self._rows(hashes)]),
        )

    def _errors(self) -> str:
        d = self.diagnosis
        rows = [
            [f"joint {j}", *(short(x[j]) for x in (d.nominal, d.extended, d.noise_floor))]
            for j in d.joints
        ]
        return table_text(["joint", "nominal [%]", "extended [%]", "noise floor [%]"], rows)

    def _rows(self, hashes: dict[str, str]) -> list[tuple[str, str]]:
        """Return what made the result, for the end of the report."""
        found = self.provenance
        rows = [
            (name.replace("log", "table "), f"`{self.sources.names[name]}`, sha256 `{sha[:16]}…`")
            for name, sha in hashes.items()
        ]
        rows += [("commit", str(found["git_commit"])), ("nominal", self.nominal_name)]
        return rows + [(k, str(v)) for k, v in found["versions"].items() if v]


def _parameters(cause: TableCause) -> str:
    rows = [
        [
            f"`{name}`",
            short(p.value),
            f"{short(p.ci95[0])} to {short(p.ci95[1])}",
            "**on its bound**" if p.on_bound else "",
        ]
        for name, p in cause.parameters.items()
    ]
    return table_text(["parameter", "value", "95 % interval", ""], rows) if rows else ""
