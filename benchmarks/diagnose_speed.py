"""How long `stiction diagnose` takes, from files to report, and how much memory.

    python benchmarks/diagnose_speed.py [--only NAME ...]

Each case is a process of its own, imports and pictures included. The machine's speed varies by
half, so each time stands over that of a loop of plain Python measured just before and after it.
Writes diagnose_speed.md; real logs are read from ../shared/measured and skipped without it.
"""

from __future__ import annotations

import argparse
import csv
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from real_logs import MEASURED, PANDA, POSES, SWEEPS  # noqa: E402
from reference_loop import seconds as reference_loop  # noqa: E402

from stiction_envs.gap.stages import WEIGHTS  # noqa: E402
from stiction_envs.reporting.atomic import write_text_atomic  # noqa: E402
from stiction_envs.reporting.markdown import table_text  # noqa: E402
from stiction_envs.testing.hidden_logs import make_case  # noqa: E402

TIMED = """
import sys, time
from stiction_envs.cli import progress
spent, last = {}, [time.perf_counter(), ""]
def whole(self, stage, share):
    now = time.perf_counter()
    spent[last[1]] = spent.get(last[1], 0.0) + now - last[0]
    last[:] = now, stage
progress.Progress.whole = whole
from stiction_envs.cli import main
code = main(sys.argv[1:])
whole(None, "", None)
for stage, seconds in spent.items():
    print(f"STAGE {stage}: {seconds}", file=sys.stderr)
sys.exit(code)
"""
MEMORY = 1024
"""Limit [MiB]."""


@dataclass(frozen=True)
class Case:
    """One command."""

    what: str
    target: float
    """[s] on two cores."""
    arguments: tuple[str, ...]


@dataclass(frozen=True)
class Measured:
    """What it took."""

    wall: float
    """[s]."""
    cpu: float
    """[s]."""
    loop: float
    """Reference loop [s]."""
    peak: float
    """Largest memory [MiB]."""
    stages: dict[str, float]
    """[s]."""


def simulated(folder: Path) -> Path:
    """Write a log of 60 s at 1 kHz of a simulated Panda with three causes."""
    (log,) = make_case(
        811, ("payload", "coulomb_friction", "viscous_friction"), seconds=60.0, known=False
    ).logs
    path = folder / "minute.csv"
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        n = log.n
        out.writerow(["t", *(f"{x}{j}" for x in ("q", "tau") for j in range(1, n + 1))])
        for t, q, tau in zip(log.t, log.q, log.tau, strict=True):
            out.writerow([f"{t:.4f}", *(f"{x:.7g}" for x in (*q, *tau))])
    return path


def cases(folder: Path) -> dict[str, Case]:
    """Return the commands by name."""
    out = {
        "minute": Case(
            "60 s of a simulated Panda, 7 joints, 1 kHz",
            15.0,
            (str(simulated(folder)), "--robot", "panda"),
        )
    }
    if (MEASURED / PANDA).is_file():
        sweeps = [str(MEASURED / x) for x in SWEEPS.values()]
        out["panda"] = Case(
            "the Panda's exciting trajectory",
            20.0,
            (str(MEASURED / PANDA), "--robot", "panda", "--torque", "link"),
        )
        out["iiwa14"] = Case(
            "all logs of the iiwa 14: six sweeps and 996 poses",
            60.0,
            (*sweeps, "--poses", str(MEASURED / POSES), "--robot", "iiwa14", "--torque", "link"),
        )
    else:
        print(f"skipped: the measured logs are not in {MEASURED}")
    return out


def measured(case: Case, folder: Path) -> Measured:
    """Run a case as a process of its own."""
    loop = reference_loop()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-c", TIMED, "diagnose", *case.arguments, "--out", str(folder), "--force"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    said = process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    wall = time.perf_counter() - start
    if status:
        raise SystemExit(said)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    stages = dict(x[6:].split(": ") for x in said.splitlines() if x.startswith("STAGE "))
    return Measured(
        wall=wall,
        cpu=cpu,
        loop=(loop + reference_loop()) / 2,
        peak=used.ru_maxrss / 1024,
        stages={k or "starting": float(x) for k, x in stages.items()},
    )


def page(found: dict[str, tuple[Case, Measured]]) -> str:
    """Return the page."""
    rows = [
        [
            case.what,
            f"{m.wall:.1f} s",
            f"{case.target:g} s",
            f"{m.cpu:.1f} s",
            f"{m.wall / m.loop:.1f}",
            f"{m.cpu / m.loop:.1f}",
            f"{m.peak:.0f} MiB",
        ]
        for case, m in found.values()
    ]
    header = ["", "wall", "target", "CPU", "wall / loop", "CPU / loop", f"peak (of {MEMORY})"]
    names = list(dict.fromkeys(["starting", *WEIGHTS]))
    parts = [
        [name, *(f"{100 * m.stages.get(name, 0.0) / m.wall:.0f} %" for _, m in found.values())]
        for name in names
        if any(name in m.stages for _, m in found.values())
    ]
    return "\n".join(
        [
            "# Time and memory of `stiction diagnose`",
            "",
            f"Written by `python benchmarks/diagnose_speed.py` with {os.cpu_count()} processors, "
            "from files to the report, imports and pictures included. Seconds are of this machine "
            "at that moment; compare the ratios to a loop of plain Python (`reference_loop.py`, "
            f"{sum(m.loop for _, m in found.values()) / len(found):.1f} s here, 1.4 s where it is "
            "quiet).",
            "",
            table_text(header, rows),
            "",
            "Shares of the wall time by stage, from which progress takes its weights:",
            "",
            table_text(["", *(case.what for case, _ in found.values())], parts),
            "",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", help="cases; no page is written")
    parser.add_argument("--out", type=Path, default=HERE)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, found = Path(name), {}
        for key, case in cases(folder).items():
            if args.only is None or key in args.only:
                found[key] = case, measured(case, folder / key)
                print(key, found[key][1])
    if args.only is None and len(found) == 3:
        write_text_atomic(args.out / "diagnose_speed.md", page(found))
        print(f"written to {args.out / 'diagnose_speed.md'}")


if __name__ == "__main__":
    main()
