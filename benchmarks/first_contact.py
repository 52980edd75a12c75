"""How long a first contact takes, in fresh processes; written beside this file.

    python benchmarks/first_contact.py [--rounds 5]

Every number is a median over fresh processes. *Warm* is a second contact: code is compiled, and
base torques, undithered runs and poses are looked up. *Compiled anew* has no compiled code yet: the
very first contact on a machine, where what is shipped is looked up. *Simulated anew* looks nothing
up (STICTION_CACHE=off). Before every round the reference loop of `reference_loop.py` says how fast
the machine is just then.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np
from reference_loop import USUAL_S, seconds

HERE = Path(__file__).parent
LIMIT_S = {"environment": 1.0, "package": 0.3}
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


def run(code: str, **environment: str) -> tuple[float, float, str]:
    """Return wall and processor time of a fresh process [s], and what it printed."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=HERE.parent,
        env={**os.environ, **environment},
        check=True,
        capture_output=True,
        text=True,
    )
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, processor, done.stdout


def make(name: str, **environment: str) -> list[float]:
    """Return wall and processor time of `gym.make` and the first `reset` in a fresh process [s]."""
    return [float(x) for x in run(MAKE.format(name=name), **environment)[2].split()]


def measure(rounds: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return times [s] by what was done and the reference loop's (rounds,).

    Times are (rounds, 2 or 4): wall and processor time of a warm contact, then wall time of one
    compiled anew and of one simulated anew.
    """
    times: dict[str, list[list[float]]] = {}
    loops = []
    for name in ENVIRONMENTS:
        make(name)  # compiles
    for k in range(rounds):
        loops.append(seconds())
        for what, code in PACKAGE.items():
            times.setdefault(what, []).append([*run(code)[:2]])
        for name in ENVIRONMENTS:
            with tempfile.TemporaryDirectory() as empty:
                row = [
                    *make(name),
                    make(name, NUMBA_CACHE_DIR=empty)[0],
                    make(name, STICTION_CACHE="off")[0],
                ]
            times.setdefault(f"`{name}`, `gym.make` and `reset`", []).append(row)
        print(f"round {k + 1} of {rounds}: reference loop {loops[-1]:.1f} s", flush=True)
    return {what: np.array(rows) for what, rows in times.items()}, np.array(loops)


def row(what: str, times: np.ndarray, loops: np.ndarray) -> str:
    """Return the table's row; the limit is for the machine's usual speed."""
    limit = LIMIT_S["environment" if times.shape[1] > 2 else "package"]
    share = float(np.median(times[:, 0] / loops))
    wall, processor, *anew = np.median(times, axis=0)
    usual = share * USUAL_S
    cells = [f"{wall:.2f}", f"{processor:.2f}", f"{share:.3f}", f"{usual:.2f}"]
    cells += [f"{limit} {'met' if usual <= limit else 'missed'}"]
    cells += [f"{x:.1f}" for x in anew] or ["", ""]
    return f"| {what} | " + " | ".join(cells) + " |"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    times, loops = measure(parser.parse_args().rounds)
    lines = [
        "# First contact",
        "",
        f"Written by `python benchmarks/first_contact.py`. Python {platform.python_version()}, "
        f"MuJoCo {mujoco.__version__}, {os.cpu_count()} processors; medians of {len(loops)} fresh "
        f"processes. The reference loop (`benchmarks/reference_loop.py`) took "
        f"{np.median(loops):.1f} s, {USUAL_S} s on the quiet machine; limits are compared with the "
        "time at that usual speed.",
        "",
        "| | warm [s] | of the processor [s] | over the loop | at usual speed [s] | limit [s] "
        "| compiled anew [s] | simulated anew [s] |",
        "|---|---|---|---|---|---|---|---|",
        *(row(what, x, loops) for what, x in times.items()),
        "",
        "Warm: a second contact. Compiled anew: no compiled code on the machine yet. Simulated "
        "anew: no base torque, undithered run or pose is looked up, neither shipped nor cached.",
    ]
    text = "\n".join(lines) + "\n"
    (HERE / "first_contact.md").write_text(text, encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
