"""How long a first contact takes: imports, commands, an environment; in fresh processes.

    python -m benchmarks.speed.first_contact [--rounds 5]

Before every round the reference loop of `reference_loop.py` says how fast the machine is just then.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time

import numpy as np

from benchmarks.harness import ROOT, Benchmark, machine, met
from benchmarks.reference_loop import USUAL_S, seconds
from stiction_envs.reporting.markdown import table_text

STUDY = Benchmark(__file__, __doc__)
LIMIT_S = {"environment": 1.0, "package": 0.3}
"""Of a warm contact [s]; assumed."""
ENVIRONMENTS = ("PandaSJE-v0", "IiwaSJE-v0", "PandaGTE-v0", "IiwaGTE-v0")
MAKE = """
import gymnasium, stiction_envs, time
wall, processor = time.perf_counter(), time.process_time()
gymnasium.make("{name}").reset(seed=0)
print(time.perf_counter() - wall, time.process_time() - processor)
"""
CLI = "import sys; from stiction_envs.cli import main; sys.exit(main({words}))"
PACKAGE = {
    "`import stiction_envs`, process and all": "import stiction_envs",
    "`stiction --help`, process and all": CLI.format(words=["--help"]),
    "`stiction --version`, process and all": CLI.format(words=["--version"]),
}


def run(code: str, **environment: str) -> tuple[list[float], str]:
    """Return wall and processor time of a fresh process [s], and what it printed."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    words = [sys.executable, "-c", code]
    mine = {**os.environ, **environment}
    done = subprocess.run(words, cwd=ROOT, env=mine, check=True, capture_output=True, text=True)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return [wall, processor], done.stdout


def make(name: str, **environment: str) -> list[float]:
    """Return wall and processor time of `gym.make` and the first `reset` in a fresh process [s]."""
    return [float(x) for x in run(MAKE.format(name=name), **environment)[1].split()]


def contact(name: str) -> list[float]:
    """Return times of a warm contact, and wall times compiled anew and simulated anew [s]."""
    with tempfile.TemporaryDirectory() as empty:
        compiled = make(name, NUMBA_CACHE_DIR=empty)[0]
    return [*make(name), compiled, make(name, STICTION_CACHE="off")[0]]


def row(what: str, times: np.ndarray, loops: np.ndarray) -> list[str]:
    """Return the table's row of times (rounds, 2 or 4); the limit is for the usual speed."""
    limit = LIMIT_S["environment" if times.shape[1] > 2 else "package"]
    share = float(np.median(times[:, 0] / loops))
    wall, processor, *anew = np.median(times, axis=0)
    usual = share * USUAL_S
    cells = [f"{wall:.2f}", f"{processor:.2f}", f"{share:.3f}", f"{usual:.2f}"]
    cells += [f"{limit} {met(usual, limit, most=True)}"]
    return [what, *cells, *([f"{x:.1f}" for x in anew] or ["", ""])]


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    times: dict[str, list[list[float]]] = {}
    loops = []
    for name in ENVIRONMENTS:
        make(name)  # compiles
    for _ in range(options.rounds):
        loops.append(seconds())
        for what, code in PACKAGE.items():
            times.setdefault(what, []).append(run(code)[0])
        for name in ENVIRONMENTS:
            times.setdefault(f"`{name}`, `gym.make` and `reset`", []).append(contact(name))
    header = ["", "warm [s]", "of the processor [s]", "over the loop", "at usual speed [s]"]
    header += ["limit [s]", "compiled anew [s]", "simulated anew [s]"]
    rows = [row(what, np.array(x), np.array(loops)) for what, x in times.items()]
    slowest = max(float(cells[4]) for cells in rows[len(PACKAGE) :])
    STUDY.write_page(
        options,
        f"""# First contact

A second contact with an environment takes {slowest:.1f} s at most, and no command of the package that only prints takes longer than {max(float(cells[4]) for cells in rows[: len(PACKAGE)]):.1f} s.

{table_text(header, rows)}
*Warm* is a second contact: code is compiled, and base torques, undithered runs and poses are looked up. *Compiled anew* has no compiled code yet: the very first contact on a machine. *Simulated anew* looks nothing up, neither what is shipped nor what is cached.

## How it was measured

`{STUDY.command}`; {machine(float(np.median(loops)))}. Medians of {len(loops)} fresh processes. Limits are compared with the time at the usual speed: the time over that of the reference loop, times {USUAL_S} s.

## What it does not show

The first contact of a machine whose disk has not read the files yet.
""",  # noqa: E501
    )


if __name__ == "__main__":
    main()
