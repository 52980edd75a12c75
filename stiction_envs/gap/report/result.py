"""A diagnosis of any kind of data, and the files that are written of it."""

import abc
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.extended_model import Extension
from stiction_envs.gap.judge.judgement import Judgement, NamedCause
from stiction_envs.gap.report import page
from stiction_envs.gap.report.figures import PLOTS, draw_errors, draw_joint
from stiction_envs.gap.report.page import Errors
from stiction_envs.gap.report.series import Series
from stiction_envs.measured.logs.sources import LogSources
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.json_text import plain, write_json
from stiction_envs.reporting.markdown import short, span, table_text
from stiction_envs.reporting.provenance import Provenance
from stiction_envs.reporting.result import Result
from stiction_envs.reporting.templates import write_md_and_html

TEMPLATE = Path(__file__).parent / "templates" / "diagnosis.md.j2"
HEADLINES = {
    "explained": "The named causes{links} explain what the simulation gets wrong, down to the "
    "noise.",
    "partly explained": "The named causes{links} explain part of what the simulation gets wrong.",
    "no discrepancy": "The simulation agrees with the {data}; no cause is significant.",
    "cannot tell": "These {data} disagree with the simulation, or show too little; they cannot "
    "tell what it gets wrong.",
}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DiagnosisResult(Result):
    """Diagnosis of measured data: everything that a simulation gets wrong about them."""

    data: ClassVar[str]
    """Kind of data: "logs", "servo logs" or "torque tables"."""
    diagnosis: Judgement
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

    @property
    @abc.abstractmethod
    def errors(self) -> Errors:
        """Error of each joint under both models."""

    @property
    @abc.abstractmethod
    def extension(self) -> Extension:
        """The model with its causes."""

    def tells_apart(self, cause: NamedCause, other: str) -> str:
        """Return the measurement that tells a cause from another, a clause."""
        known = (cause.told_apart_by or {}).get(other)
        return known or "; ".join(cause_named(x).what_to_record for x in (cause.name, other))

    @property
    def checked(self) -> str:
        """Result of logs that took no part, sentences; empty without such logs."""
        return ""

    @property
    def note(self) -> str:
        """A note at the top of the report, where friction is assumed."""
        return ""

    def series(self) -> Series | None:
        """Return measured and simulated series over time; None for torque tables."""
        return None

    def details(self) -> dict[str, object]:
        """Return more variables of the report's template."""
        return {}

    def drawn(self, cause: NamedCause, plots: Path) -> str:
        """Draw a cause into a folder; return the picture as Markdown, or nothing."""
        return ""

    @property
    def headline(self) -> str:
        """The verdict in sentences, without that of logs that took no part."""
        d, e = self.diagnosis, self.errors
        links = " and errors of links" if d.shares_percent.get("links", 0.0) >= 1.0 else ""
        text = HEADLINES[self.verdict].format(data=self.data, links=links)
        if self.causes:
            return f"{text} {page.shares(d, e)}"
        if self.verdict == "explained":
            return f"Errors of links and set-up explain what it gets wrong. {page.shares(d, e)}"
        if not (e.nominal > 0).any():
            return text
        far = e.nominal / e.noise
        return (
            f"{text} The {self.nominal_name} model is off by {span(e.nominal, 3, e.unit)}, noise "
            f"floors are {span(e.noise, 3, e.unit)}; joint {e.joints[far.argmax()]} is farthest, "
            f"{short(far.max(), 2)} times its floor."
        )

    @property
    def summary(self) -> str:
        """The verdict in sentences, and that of logs that took no part."""
        return f"{self.headline} {self.checked}".rstrip()

    def write(self, folder: Path, *, progress: Callable[[str, float], None] | None = None) -> None:
        """Write ``diagnosis.json``, model, report with pictures, and ``series.csv`` of logs."""
        say = progress or (lambda *_: None)
        say("extended model", 0.0)
        extension = self.extension
        say("report", 0.0)
        plots, series, e = folder / PLOTS, self.series(), self.errors
        hashes = self.sources.hashes(self.provenance)
        write_json(folder / "diagnosis.json", self.to_json())
        write_text_atomic(folder / "model.xml", extension.xml)
        title = f"{self.robot} as its {self.data} show it"
        meta = {"title": title, "units": "SI", "verdict": self.verdict}
        write_text_atomic(folder / "model.toml", extension.toml(meta=meta, provenance=hashes))
        plots.mkdir(exist_ok=True)
        if series is not None:
            write_text_atomic(folder / "series.csv", series.csv())
        names = self.sources.names
        made = [(k, f"`{names[k]}`, sha256 `{sha[:16]}…`") for k, sha in hashes.items()]
        made.append(("commit", str(self.provenance["git_commit"])))
        made += [(k, str(v)) for k, v in self.provenance["versions"].items() if v]
        write_md_and_html(
            folder,
            TEMPLATE,
            f"Diagnosis of {self.robot}: {self.verdict}",
            note=self.note,
            r=self,
            page=page,
            errors=e,
            picture=draw_errors(e, plots) if (e.nominal > 0).any() else "",
            pictures={c.name: self.drawn(c, plots) for c in self.causes},
            joints=[draw_joint(series, j, plots) for j in range(series.q.shape[1])]
            if series
            else [],
            lacking={"model.xml": extension.missing, "model.toml": extension.friction_missing},
            provenance=table_text(["", ""], made),
            **self.details(),
        )
        say("report", 1.0)

    def __repr__(self) -> str:
        names = ", ".join(c.name for c in self.causes) or "no cause"
        return f"<{type(self).__name__} of {self.robot}: {self.verdict}, {names}>"

    def __str__(self) -> str:
        lines = [f"{self.verdict}: {self.summary}", ""]
        for cause in self.causes:
            also = f"  (or {', '.join(cause.confused_with)})" if cause.confused_with else ""
            of = ",".join(map(str, cause.joints)) or "arm"
            lines.append(f"{cause.gain_percent:6.1f} %  {cause.name:<28} joints {of}{also}")
        return "\n".join(lines)
