"""A diagnosis of logs with all that is written of it: model, forward validation, report."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from stiction_envs.gap.check import Check, describe
from stiction_envs.gap.diagnosis import Diagnosis, NamedCause, model_of
from stiction_envs.gap.extended_model import Extension, extend
from stiction_envs.gap.forward_validation import Proof, prove
from stiction_envs.gap.least_squares import LeastSquares, least_squares
from stiction_envs.gap.left_out_motion import LeftOutMotion, leave_out_motions
from stiction_envs.gap.result import DiagnosisResult
from stiction_envs.measured.logs.sources import LogSources
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.json_text import plain, write_json


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LogDiagnosis(DiagnosisResult):
    """What a simulation gets wrong about joint logs."""

    diagnosis: Diagnosis
    """With the signals and fits that it was worked out from."""
    torque: str
    """Side of the gear on which it was measured, "motor" or "link"."""
    nominal_name: str
    """What was judged: "rigid", "shipped" or a file's name."""
    with_lines: bool
    """Whether the thesis's least squares are told too."""
    sources: LogSources
    provenance: dict[str, Any]
    nthread: int = 0
    check: Check | None = None
    """The model held against logs that took no part, where there are any."""

    @property
    def robot(self) -> str:
        """Name of the arm."""
        return self.diagnosis.robot

    @property
    def verdict(self) -> str:
        """``explained``, ``partly explained``, ``no discrepancy`` or ``cannot tell``."""
        return self.diagnosis.verdict

    @property
    def causes(self) -> tuple[NamedCause, ...]:
        """Strongest first."""
        return self.diagnosis.causes

    @property
    def gain_percent(self) -> float:
        """100 (1 − mean over joints of extended over nominal held-out RMS) [%]."""
        return self.diagnosis.gain_percent

    @property
    def nominal_rms(self) -> NDArray[Any]:
        """(n,) held-out residual of the nominal model [N·m]."""
        return self.diagnosis.nominal_rms

    @property
    def extended_rms(self) -> NDArray[Any]:
        """(n,) held-out residual of the extended model [N·m]."""
        return self.diagnosis.extended_rms

    @property
    def summary(self) -> str:
        """The verdict in two sentences, and that of the check logs."""
        from stiction_envs.gap.report import verdict_sentences

        text = verdict_sentences(self.diagnosis, self.nominal_name)
        return text if self.check is None else f"{text} {describe(self.check)}"

    @cached_property
    def extension(self) -> Extension:
        """The model with its causes."""
        return extend(self.diagnosis.base, model_of(self.diagnosis))

    @cached_property
    def forward(self) -> Proof | str:
        """Both models driven by the measured torques, or why they were not."""
        return prove(self.diagnosis, nthread=self.nthread)

    @cached_property
    def left_out_motion(self) -> LeftOutMotion | None:
        """Errors on each log under the fit to the others; None for a single one."""
        return leave_out_motions(self.diagnosis)

    @cached_property
    def lines(self) -> LeastSquares | None:
        """The thesis's least squares, where they were asked for."""
        return least_squares(self.diagnosis.logs, self.diagnosis.base) if self.with_lines else None

    def to_json(self) -> dict[str, Any]:
        """Return ``diagnosis.json``; validates the model forward, which takes some seconds."""
        answer = self.diagnosis.to_json()
        if self.lines is not None:
            answer["lsm"] = self.lines.to_json()
        if not isinstance(self.forward, str):
            both = {"nominal": self.forward.nominal, "extended": self.forward.extended}
            answer["forward"] = {
                "windows": len(self.forward.start),
                "replay_rad": {k: x.position_rms for k, x in both.items()},
                "tracking_nm": {k: x.torque_rms for k, x in both.items()},
            }
            if self.forward.unstable:
                answer["forward"]["unstable"] = self.forward.unstable
        if self.check is not None:
            answer["check"] = self.check.to_json()
        if self.left_out_motion is not None:
            answer["left_out_motion"] = self.left_out_motion.to_json()
        answer = plain(answer)
        return dict(answer)

    def write(self, folder: Path, *, progress: Callable[[str, float], None] | None = None) -> None:
        """Write ``diagnosis.json``, ``model.xml``, ``model.toml``, report and plots.

        Args:
            folder: an existing one.
            progress: called with a stage and its part done.
        """
        from stiction_envs.gap.report import write_report

        say = progress or (lambda *_: None)
        say("extended model", 0.0)
        extension = self.extension
        say("forward validation", 0.0)
        forward = self.forward
        say("report", 0.0)
        hashes = self.sources.hashes(self.provenance)
        write_json(folder / "diagnosis.json", self.to_json())
        write_text_atomic(folder / "model.xml", extension.xml)
        meta = {
            "title": f"{self.robot} as its logs show it",
            "units": "SI",
            "verdict": self.verdict,
        }
        write_text_atomic(folder / "model.toml", extension.toml(meta=meta, provenance=hashes))
        write_report(
            folder,
            self.diagnosis,
            extension=extension,
            proof=forward,
            check=self.check,
            left_out=self.left_out_motion,
            nominal_name=self.nominal_name,
            squares=self.lines,
            provenance=self._rows(hashes),
        )
        say("report", 1.0)

    def _rows(self, hashes: dict[str, str]) -> list[tuple[str, str]]:
        """Return what made the result, for the end of the report."""
        found = self.provenance
        rows = [
            (re.sub(r"(\d+)$", r" \1", name), f"`{self.sources.names[name]}`, sha256 `{sha[:16]}…`")
            for name, sha in hashes.items()
        ]
        rows += [("commit", str(found["git_commit"])), ("seed", str(found["seed"]))]
        rows += [("torque", f"{self.torque} side"), ("nominal", self.nominal_name)]
        return rows + [(k, str(v)) for k, v in found["versions"].items() if v]
