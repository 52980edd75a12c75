"""The result of a rehearsal: causes that a recording can show, and result files."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from stiction_envs.hidden.rehearsal.jobs import CONFUSED, FOUND, CauseJob, RehearsalRun, judge
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.json_text import plain
from stiction_envs.reporting.kept_rows import KeptRows
from stiction_envs.reporting.markdown import aligned, listed, plural, short
from stiction_envs.reporting.provenance import Provenance
from stiction_envs.reporting.result import Result

CSV = "rehearsal.csv"
RUNS = "rehearsal_runs.jsonl"
LEGEND = """
-: not found. In brackets: named, but other causes may explain the log as well.
rehearsal.csv says why, and what was named falsely."""


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

    @property
    def cell(self) -> str:
        """The smallest size: see `LEGEND`."""
        return (
            short(self.smallest_found, 3)
            if self.found
            else (f"({short(self.smallest_named, 3)})" if self.named else "-")
        )


def row_of(job: CauseJob, row: int, runs: list[RehearsalRun]) -> Row:
    """Return the result row of a job's runs for a joint (from 1), or for the arm."""
    mine = [run for run in runs if str(row) in run["sizes"]]
    judged = [(run["sizes"][str(row)], *judge(job, row, run)) for run in mine]

    def smallest(*verdicts: str) -> float:
        return next((size for size, verdict, *_ in judged if verdict in verdicts), math.nan)

    instead = ""
    if not judged:
        instead = f"not visible in this motion: {job.why_not or 'it changes nothing'}"
    elif math.isnan(smallest(FOUND)):
        confused = [why for _, verdict, _, why in judged if verdict == CONFUSED]
        instead = [*(x[3] for x in judged), *confused][-1]
    return Row(
        cause=job.what.name,
        joint=row,
        parameter=job.what.parameter,
        unit=job.what.unit,
        smallest_found=smallest(FOUND),
        smallest_named=smallest(FOUND, CONFUSED),
        tried=tuple(size for size, *_ in judged),
        false_alarms="; ".join(f"{listed(x)} at {size:.3g}" for size, _, x, _ in judged if x),
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
        out: dict[str, object] = plain(
            {
                "robot": self.robot,
                "rehearsal": [asdict(row) for row in self.rows],
                "named_without": self.named_without,
                "summary": self.summary,
            }
        )
        return out

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
        named = listed(self.named_without)
        names = f"{named}: a false alarm" if named else "no cause"
        return f"{text} With nothing hidden it names {names}."

    def __repr__(self) -> str:
        found = sum(r.found for r in self.rows)
        return f"<Rehearsal of {self.robot}: {found} of {len(self.rows)} shown>"

    def __str__(self) -> str:
        joints = sorted({r.joint for r in self.rows})
        table = []
        for cause in dict.fromkeys(r.cause for r in self.rows):
            mine = {r.joint: r for r in self.rows if r.cause == cause}
            first = next(iter(mine.values()))
            name = f"{cause}, {first.parameter}" + f" [{first.unit}]" * (first.unit != "1")
            table.append([name, *(mine[j].cell if j in mine else "" for j in joints)])
        header = ["smallest size found", *(f"joint {j}" if j else "arm" for j in joints)]
        next_ones = {r.cause: r.what_to_record for r in self.rows if r.what_to_record}
        record = [f"to see {cause}, record {motion}" for cause, motion in next_ones.items()]
        return "\n".join([self.summary, "", aligned(header, table), LEGEND, *record])
