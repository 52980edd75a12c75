"""The result of a rehearsal: causes that a recording can show, and result files."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from stiction_envs.hidden.rehearsal.jobs import CONFUSED, FOUND, CauseJob, RehearsalRun, judge
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.kept_rows import KeptRows
from stiction_envs.reporting.markdown import joints as joints_text
from stiction_envs.reporting.markdown import listed, plural, short
from stiction_envs.reporting.provenance import Provenance
from stiction_envs.reporting.result import Result

CSV = "rehearsal.csv"
RUNS = "rehearsal_runs.jsonl"


@dataclass(frozen=True, kw_only=True)
class Row:
    """Result of a recording for a cause on a joint."""

    cause: str
    joint: int
    """From 1; 0 for the whole arm."""
    parameter: str
    unit: str
    smallest_found: float
    """Smallest size that was named without a rival and without a false cause; else NaN."""
    smallest_named: float
    """Smallest size that was named, with or without a rival; else NaN."""
    tried: tuple[float, ...]
    """Sizes that were hidden, smallest effect first."""
    false_alarms: str
    """Causes that were named falsely, and at which sizes."""
    instead: str
    """Why it was not found: the cause named instead, or its rival."""
    what_to_record: str
    """The motion that would show it, where this one does not."""

    @property
    def found(self) -> bool:
        """True if any size was found."""
        return not math.isnan(self.smallest_found)

    @property
    def named(self) -> bool:
        """True if any size was named, with or without a rival that fits as well."""
        return not math.isnan(self.smallest_named)


def row_of(job: CauseJob, row: int, runs: list[RehearsalRun]) -> Row:
    """Return the result row of a job's runs for a joint (from 1), or for the arm."""
    mine = [run for run in runs if str(row) in run["sizes"]]
    judged = [(run["sizes"][str(row)], judge(job, row, run)) for run in mine]

    def smallest(*verdicts: str) -> float:
        return next((size for size, said in judged if said.verdict in verdicts), math.nan)

    instead = ""
    if not judged:
        instead = f"not visible in this motion: {job.why_not or 'it changes nothing'}"
    elif math.isnan(smallest(FOUND)):
        confused = [said.why for _, said in judged if said.verdict == CONFUSED]
        instead = confused[-1] if confused else judged[-1][1].why
    false = [f"{listed(said.false)} at {size:.3g}" for size, said in judged if said.false]
    return Row(
        cause=job.cause,
        joint=row,
        parameter=job.what.parameter,
        unit=job.what.unit,
        smallest_found=smallest(FOUND),
        smallest_named=smallest(FOUND, CONFUSED),
        tried=tuple(size for size, *_ in judged),
        false_alarms="; ".join(false),
        instead=instead,
        what_to_record=job.what.what_to_record if instead else "",
    )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Rehearsal(Result):
    """Causes that a recording can and cannot show."""

    robot: str
    rows: tuple[Row, ...]
    """One row per cause, in the order in which the causes are registered, and joint."""
    named_without: tuple[str, ...]
    """Causes that were named where nothing was hidden."""
    runs: dict[str, list[RehearsalRun]]
    """By key of their job."""
    provenance: Provenance

    def to_json(self) -> dict[str, object]:
        """Return the rows, and what was named with nothing hidden."""
        rows = [
            {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in asdict(r).items()}
            for r in self.rows
        ]
        return {
            "robot": self.robot,
            "rehearsal": rows,
            "named_without": list(self.named_without),
            "summary": self.summary,
        }

    def write(self, folder: Path) -> None:
        """Write ``rehearsal.csv``, and the runs behind it."""
        table = []
        for row in self.rows:
            cells = asdict(row) | {"tried": " ".join(f"{x:.4g}" for x in row.tried)}
            cells["smallest_found"] = f"{row.smallest_found:.4g}" if row.found else ""
            cells["smallest_named"] = f"{row.smallest_named:.4g}" if row.named else ""
            table.append(list(cells.values()))
        write_lines(folder / CSV, [f.name for f in fields(Row)], table)
        rows = KeptRows(folder / RUNS)
        for key, runs in self.runs.items():
            if key not in rows.every:
                rows.add(key, runs)

    @property
    def summary(self) -> str:
        """Sentences on the causes that the recording shows."""
        found = sum(r.found for r in self.rows)
        also = sum(r.named and not r.found for r in self.rows)
        text = f"Of {plural(len(self.rows), 'cause')}, counted on each joint, this recording shows "
        text += f"{found} at one of the hidden sizes, without a false cause"
        text += f", and {also} more that it cannot tell from other causes." if also else "."
        whole = [
            f"{r.cause} from {short(r.smallest_found, 2)}{_unit(r.unit)} on"
            for r in self.rows
            if r.found and not r.joint
        ]
        if whole:
            text += f" It shows {listed(whole)}."
        named = listed(self.named_without)
        names = f"{named}: a false alarm" if named else "no cause"
        return f"{text} With nothing hidden it names {names}."

    def __repr__(self) -> str:
        found = sum(r.found for r in self.rows)
        return f"<Rehearsal of {self.robot}: {found} of {len(self.rows)} shown>"

    def __str__(self) -> str:
        lines, rows = [self.summary, ""], self.rows
        for cause in dict.fromkeys(r.cause for r in rows):
            mine = [r for r in rows if r.cause == cause]
            unit = _unit(mine[0].unit)
            lines.append(f"{cause}, {mine[0].parameter}:")
            shown = [r for r in mine if r.found]
            if shown:
                lines.append(f"  shown from {_sizes(shown, 'smallest_found')}{unit} on")
            hidden = [r for r in mine if not r.found]
            for why in dict.fromkeys(r.instead for r in hidden):
                these = [r for r in hidden if r.instead == why]
                named = [r for r in these if r.named]
                if named:
                    sizes = _sizes(named, "smallest_named")
                    lines.append(f"  named from {sizes}{unit} on, but {why}")
                missed = [r for r in these if not r.named]
                if missed:
                    which = [r.joint for r in missed]
                    on = "" if which == [0] else f" on {joints_text(which)}"
                    ends = dict.fromkeys(short(r.tried[-1], 2) for r in missed if r.tried)
                    largest = f" at {listed(ends)}{unit}" if ends else ""
                    lines.append(f"  not shown{on}{largest}: {why}")
            if hidden:
                lines.append(f"  record next: {hidden[0].what_to_record}")
        return "\n".join(lines)


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _sizes(rows: list[Row], which: str) -> str:
    """Return the sizes of some rows, each with its joint."""
    return ", ".join(
        (f"joint {r.joint} " if r.joint else "") + short(getattr(r, which), 3) for r in rows
    )
