"""A diagnosis of logs or of torque tables, and the files that are written of it."""

from __future__ import annotations

import abc
import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from stiction_envs.errors import StictionError
from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.gap.extended_model import Extension
from stiction_envs.gap.judge.judgement import NamedCause
from stiction_envs.gap.report.series import Series
from stiction_envs.gap.servo.diagnosis import ServoDiagnosis
from stiction_envs.gap.tables.found import TableDiagnosis
from stiction_envs.measured.logs.sources import LogSources
from stiction_envs.reporting.atomic import write_bytes_atomic, write_text_atomic
from stiction_envs.reporting.json_text import JsonRecord, plain, write_json
from stiction_envs.reporting.markdown import joints, listed, number, table_text
from stiction_envs.reporting.provenance import Provenance
from stiction_envs.reporting.result import Result
from stiction_envs.reporting.templates import write_md_and_html

TEMPLATES = Path(__file__).parent / "templates"
PLOTS = "plots"
HEADLINES = {
    "explained": "The named causes explain what the simulation gets wrong, down to the noise.",
    "partly explained": "The named causes explain part of what the simulation gets wrong.",
    "no discrepancy": "The simulation agrees with the {data}; no cause is significant.",
    "cannot tell": "These {data} disagree with the simulation, or show too little; they cannot "
    "tell what it gets wrong.",
}


@dataclass(frozen=True)
class Picture:
    """One picture of a report and what it shows."""

    file: str
    caption: str


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DiagnosisResult(Result):
    """What a simulation gets wrong about measured data."""

    template: ClassVar[str]
    """Of the report, in ``templates/``."""
    data: ClassVar[str]
    """What was measured: "logs" or "torque tables"."""
    diagnosis: Diagnosis | ServoDiagnosis | TableDiagnosis
    nominal_name: str
    """The nominal model: "rigid", "shipped", a file's name, or "given"."""
    sources: LogSources
    provenance: Provenance
    threads: int = 0

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
        """100 (1 − mean over joints of extended over nominal held-out error) [%]."""
        return self.diagnosis.gain_percent

    def to_json(self) -> dict[str, object]:
        """Return ``diagnosis.json``."""
        return dict(plain(self.diagnosis.to_json()))

    def headline(self, amount: str = "") -> str:
        """Return the verdict in a sentence, and what the causes explain, with an ``amount``."""
        text = HEADLINES[self.verdict].format(data=self.data)
        if not self.causes:
            return text
        names = listed(f"{c.name} ({where(c.joints)})" for c in self.causes)
        share = number(self.gain_percent, 0)
        return f"{text} {names}, strongest first, take {share} % off the held-out error{amount}."

    @property
    @abc.abstractmethod
    def summary(self) -> str:
        """The verdict in sentences."""

    @property
    def note(self) -> str:
        """A note at the top of the report, where friction is assumed."""
        return ""

    @property
    @abc.abstractmethod
    def extension(self) -> Extension:
        """The model with its causes."""

    @abc.abstractmethod
    def page(self, plots: Path) -> dict[str, object]:
        """Draw the report's pictures into a folder; return the variables of its template."""

    def series(self) -> Series | None:
        """Return what was measured and simulated over time; None of torque tables."""
        return None

    def write_rrd(self, path: str | os.PathLike[str], *, force: bool = False) -> Path:
        """Write a recording for Rerun, of the extra rerun.

        Args:
            path: ends in ``.rrd``, in a folder that is there.
            force: whether it may replace another file.

        Raises:
            StictionError: the extra is missing, the path is wrong, or torque tables were diagnosed.
        """
        from stiction_envs.gap.report.rerun_file import check_rrd, rrd_bytes

        series, path = self.series(), Path(path)
        if series is None:
            raise StictionError(f"{self.data} have no time: expected joint logs or servo logs")
        check_rrd(path, force=force)
        write_bytes_atomic(path, rrd_bytes(series))
        return path

    def rows(self) -> list[tuple[str, str]]:
        """Return rows of the report's provenance, besides inputs and versions."""
        return [("nominal", self.nominal_name)]

    def validate(self, say: Callable[[str, float], None]) -> None:
        """Compute what takes long before the report is written; ``say`` is called as progress."""

    def write(self, folder: Path, *, progress: Callable[[str, float], None] | None = None) -> None:
        """Write ``diagnosis.json``, model, report with pictures, and ``series.csv`` of logs.

        Args:
            folder: an existing one.
            progress: called with a stage and its part done.
        """
        say = progress or (lambda *_: None)
        say("extended model", 0.0)
        extension = self.extension
        self.validate(say)
        say("report", 0.0)
        hashes = self.sources.hashes(self.provenance)
        write_json(folder / "diagnosis.json", self.to_json())
        write_text_atomic(folder / "model.xml", extension.xml)
        title = f"{self.robot} as its {self.data} show it"
        meta = {"title": title, "units": "SI", "verdict": self.verdict}
        write_text_atomic(folder / "model.toml", extension.toml(meta=meta, provenance=hashes))
        if (series := self.series()) is not None:
            write_text_atomic(folder / "series.csv", series.csv())
        (folder / PLOTS).mkdir(exist_ok=True)
        inputs = [
            (re.sub(r"(\d+)$", r" \1", name), f"`{self.sources.names[name]}`, sha256 `{sha[:16]}…`")
            for name, sha in hashes.items()
        ]
        made = [*inputs, ("commit", str(self.provenance["git_commit"])), *self.rows()]
        made += [(k, str(v)) for k, v in self.provenance["versions"].items() if v]
        write_md_and_html(
            folder,
            TEMPLATES / self.template,
            f"Diagnosis of {self.robot}: {self.verdict}",
            note=self.note,
            d=self.diagnosis,
            data=self.data,
            plots=PLOTS,
            nominal_name=self.nominal_name,
            extension=extension,
            provenance=table_text(["", ""], made),
            **self.page(folder / PLOTS),
        )
        say("report", 1.0)

    def __repr__(self) -> str:
        names = ", ".join(c.name for c in self.causes) or "no cause"
        return f"<{type(self).__name__} of {self.robot}: {self.verdict}, {names}>"

    def __str__(self) -> str:
        keys = ("name", "joints", "gain_percent", "confused_with")
        causes = [{k: getattr(c, k) for k in keys} for c in self.causes]
        return describe(self.verdict, self.summary, causes)


def where(numbers: tuple[int, ...]) -> str:
    """Return ``joint 3``, ``joints 1 and 2`` or ``whole arm``."""
    return joints(numbers) if numbers else "whole arm"


def describe(verdict: str, summary: str, causes: Iterable[JsonRecord]) -> str:
    """Return verdict and causes, entries of ``diagnosis.json``, as readable lines."""
    lines = [f"{verdict}: {summary}", ""]
    for cause in causes:
        confused = ", ".join(cause["confused_with"])
        also = f"  (or {confused})" if confused else ""
        of = ",".join(map(str, cause["joints"])) or "arm"
        lines.append(f"{cause['gain_percent']:6.1f} %  {cause['name']:<28} joints {of}{also}")
    return "\n".join(lines)
