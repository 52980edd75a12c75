"""The result of a rehearsal: causes that a recording can show, and result files."""

from dataclasses import asdict, dataclass, fields
from pathlib import Path

from stiction_envs.hidden.rehearsal.jobs import CONFUSED, FOUND, CauseJob, RehearsalRun, judge
from stiction_envs.measured.csv_text import write_lines
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
    smallest_found: float | None
    """Smallest size that was named without a rival and without a false cause."""
    smallest_named: float | None
    """Smallest size that was named, with or without a rival."""
    tried: tuple[float, ...]
    """Sizes that were hidden, smallest effect first."""
    false_alarms: str
    """Causes that were named falsely, and at which sizes."""
    instead: str
    """Why it was not found: the cause named instead, or its rival."""
    what_to_record: str
    """The motion that would show it, where this one does not."""

    @property
    def cell(self) -> str:
        """The smallest size: see `LEGEND`."""
        if self.smallest_found is not None:
            return short(self.smallest_found, 3)
        return "-" if self.smallest_named is None else f"({short(self.smallest_named, 3)})"


def row_of(job: CauseJob, row: int, runs: list[RehearsalRun]) -> Row:
    """Return the result row of a job's runs for a joint (from 1), or for the arm."""
    mine = [run for run in runs if str(row) in run["sizes"]]
    judged = [(run["sizes"][str(row)], *judge(job, row, run)) for run in mine]

    def smallest(*verdicts: str) -> float | None:
        return next((size for size, verdict, *_ in judged if verdict in verdicts), None)

    instead = ""
    if not judged:
        instead = f"not visible in this motion: {job.why_not or 'it changes nothing'}"
    elif smallest(FOUND) is None:
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

    @property
    def found(self) -> int:
        """Number of rows of which one size was found."""
        return sum(r.smallest_found is not None for r in self.rows)

    def to_json(self) -> dict[str, object]:
        """Return the rows, and what was named with nothing hidden."""
        return {
            "robot": self.robot,
            "rehearsal": [asdict(row) for row in self.rows],
            "named_without": list(self.named_without),
            "summary": self.summary,
        }

    def write(self, folder: Path) -> None:
        """Write ``rehearsal.csv``, and the runs behind it."""
        table = []
        for row in self.rows:
            cells = asdict(row) | {"tried": " ".join(f"{x:.4g}" for x in row.tried)}
            for key in ("smallest_found", "smallest_named"):
                cells[key] = "" if cells[key] is None else f"{cells[key]:.4g}"
            table.append(list(cells.values()))
        write_lines(folder / CSV, [f.name for f in fields(Row)], table)
        rows = KeptRows(folder / RUNS)
        for key, runs in self.runs.items():
            if key not in rows.every:
                rows.add(key, runs)

    @property
    def summary(self) -> str:
        """Sentences on the causes that the recording shows."""
        also = sum(r.smallest_named is not None for r in self.rows) - self.found
        text = f"Of {plural(len(self.rows), 'cause')}, counted on each joint, this recording shows "
        text += f"{self.found} at one of the hidden sizes, without a false cause"
        text += f", and {also} more that it cannot tell from other causes." if also else "."
        named = listed(self.named_without)
        names = f"{named}: a false alarm" if named else "no cause"
        return f"{text} With nothing hidden it names {names}."

    def __repr__(self) -> str:
        return f"<Rehearsal of {self.robot}: {self.found} of {len(self.rows)} shown>"

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
