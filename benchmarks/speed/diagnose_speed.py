"""How long `stiction diagnose` takes, from files to report, and how much memory.

    python -m benchmarks.speed.diagnose_speed [--only NAME ...]

Each case is a process of its own, imports and pictures included. The machine's speed varies by
half, so each time is also given over that of a loop of plain Python just before and after it.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy.peers import PANDA, POSES, SWEEPS
from benchmarks.harness import MEASURED, Benchmark, Row, machine
from benchmarks.reference_loop import seconds as reference_loop
from stiction_envs.hidden.hidden_logs import make_case
from stiction_envs.reporting.markdown import listed, table_text

STUDY = Benchmark(__file__, __doc__)
CODE = "import sys; from stiction_envs.cli import main; sys.exit(main(sys.argv[1:]))"
MEMORY = 1024
"""Limit [MiB]; aims of the project, as are the targets below."""


def simulated(folder: Path) -> Path:
    """Write a log of 60 s at 1 kHz of a simulated Panda with three causes."""
    causes = ("payload", "coulomb_friction", "viscous_friction")
    (log,) = make_case(811, causes, seconds=60.0, known=False).logs
    header = ",".join(["t", *(f"{x}{j}" for x in ("q", "tau") for j in range(1, log.n + 1))])
    rows = np.column_stack([log.t, log.q, log.tau])
    formats = ["%.4f"] + ["%.7g"] * (2 * log.n)
    path = folder / "minute.csv"
    np.savetxt(path, rows, fmt=formats, delimiter=",", header=header, comments="")
    return path


def cases(folder: Path) -> dict[str, tuple[str, float, list[object]]]:
    """Return by name: what it is, the target [s] on two cores, arguments."""
    minute = [simulated(folder), "--robot", "panda"]
    link = ["--torque", "link"]
    panda = [MEASURED / PANDA, "--robot", "panda", *link]
    sweeps = [MEASURED / x for x in SWEEPS]
    iiwa = [*sweeps, "--poses", MEASURED / POSES, "--robot", "iiwa14", *link]
    return {
        "minute": ("60 s of a simulated Panda, 7 joints, 1 kHz", 10.0, minute),
        "panda": ("the Panda's exciting trajectory", 12.0, panda),
        "iiwa14": ("all logs of the iiwa 14: six sweeps and 996 poses", 35.0, iiwa),
    }


def measured(arguments: list[object], folder: Path) -> Row:
    """Run a case as a process of its own; return times [s] and its largest memory [MiB]."""
    loop = reference_loop()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    words = ["diagnose", *map(str, arguments), "--out", str(folder), "--force"]
    process = subprocess.Popen(
        [sys.executable, "-c", CODE, *words],
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
    return {
        "wall": wall,
        "cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "loop": (loop + reference_loop()) / 2,
        "peak": used.ru_maxrss / 1024,
    }


def page(found: dict[str, tuple[str, float, Row]]) -> dict[str, Any]:
    """Return what the page's template asks for."""
    runs = [m for *_, m in found.values()]
    rows = [
        [what, f"{m['wall']:.1f} s", f"{target:g} s", f"{m['cpu']:.1f} s"]
        + [f"{m[key] / m['loop']:.1f}" for key in ("wall", "cpu")]
        + [f"{m['peak']:.0f} MiB"]
        for what, target, m in found.values()
    ]
    header = ["", "wall", "target", "CPU", "wall / loop", "CPU / loop", f"peak (of {MEMORY})"]
    return {
        "minute": found["minute"][2],
        "times": table_text(header, rows),
        "limit": MEMORY,
        "too_large": listed(what for what, _, m in found.values() if m["peak"] > MEMORY),
        "machine": machine(float(np.mean([m["loop"] for m in runs]))),
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--only", nargs="+", help="cases; no page is written")
    options = parser.parse_args()
    there = (MEASURED / PANDA).is_file()
    with tempfile.TemporaryDirectory() as name:
        found = {}
        for key, (what, target, arguments) in cases(Path(name)).items():
            if (options.only is None or key in options.only) and (there or key == "minute"):
                found[key] = what, target, measured(arguments, Path(name) / key)
                print(key, found[key])
    if len(found) == 3:
        STUDY.write_page(options, **page(found))
    else:
        print(f"no page is written: {len(found)} of 3 cases (measured logs: {MEASURED})")


if __name__ == "__main__":
    main()
