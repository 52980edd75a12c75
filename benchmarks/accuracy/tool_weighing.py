"""Weigh a tool that nobody documented with the model that an earlier session found.

    python -m benchmarks.accuracy.tool_weighing --cases 50

Every link of a simulated Panda is 5 % and 5 mm off what its makers know. `diagnose` calibrates the
bare arm, from ``rigid``, and writes ``model.toml``. For the next session, on another motion, a tool
is mounted, and `diagnose` starts from ``model.toml``: is the tool's true mass within the 95 %
interval of the payload that is named? Half of the arms are calibrated on two exciting logs, and
their set-up is exact. The others have small offsets, gains, a delay and a tilt, and one log in
which one joint after the other turns about a stretched pose: what that cannot show, the interval
has to allow for. Joints of every other arm have friction and rotors, which the calibration must
find.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import LOGS, Benchmark, Row, met
from stiction_envs.errors import StictionError
from stiction_envs.gap.diagnosis import diagnose_logs, model_of
from stiction_envs.gap.model_file import dump
from stiction_envs.hidden.hidden_logs import make_case
from stiction_envs.reporting.markdown import number, table_text

MADE_BY = (*LOGS, "stiction_envs/hidden", "benchmarks/accuracy/tool_weighing.py")
"""Code that decides a case."""
STUDY = Benchmark(__file__, __doc__, made_by=MADE_BY)
FIRST = 90000
"""Seeds of the study begin here; those below 1000 are for development."""
SCATTER = 0.05
"""How far every link is off what the makers know [-] (`imperfect_arms.scattered`)."""
MASS = (0.3, 3.0)
"""Of tools, even in the logarithm [kg]."""
DISTANCE = 0.1
"""Of a tool's centre of mass from the flange, at most [m]."""
EXCITING: dict[str, Any] = {"motion": "fourier", "seconds": 26.0, "second": 16.0}
"""Logs of half of the bare arms [s]: an exciting motion and another; assumed."""
ONE_BY_ONE: dict[str, Any] = {"motion": "one_by_one", "seconds": 42.0, "imperfect": True}
"""Log of the others [s]; assumed."""
MOTIONS = ("fourier", "poses", "fast")
"""With the tool: those that excite a payload."""
HEAVY = 1.0
"""Mass from which on the interval's width is judged [kg]."""
INSIDE, HALF_WIDTH = 0.9, 0.15
"""Aims: share of intervals that contain the truth, and half-width over mass, at most [-]."""


@dataclass(frozen=True)
class Job:
    """One arm and one tool: the seed says everything."""

    seed: int

    @property
    def key(self) -> str:
        """Of its row."""
        return str(self.seed)

    @property
    def exciting(self) -> bool:
        """Whether the calibration is `EXCITING`."""
        return self.seed // 2 % 2 == 0

    def tool(self) -> tuple[float, np.ndarray]:
        """Return mass [kg] and centre of mass in the flange's frame (3,) [m]."""
        rng = np.random.default_rng([self.seed, 78])
        low, high = np.log(MASS)
        towards = rng.normal(size=3)
        centre = DISTANCE * rng.uniform() * towards / np.linalg.norm(towards)
        return float(np.exp(rng.uniform(low, high))), centre


def weigh(job: Job) -> Row:
    """Calibrate a bare arm, mount a tool, weigh it.

    Of an arm whose controller shook it beyond its torque limits there is no log.
    """
    mass, centre = job.tool()
    friction = bool(job.seed % 2)
    row: Row = {"seed": job.seed, "mass_kg": mass, "com_m": centre.tolist()}
    row |= {"friction": friction, "exciting": job.exciting}
    motion = MOTIONS[job.seed % len(MOTIONS)]
    try:
        how = EXCITING if job.exciting else ONE_BY_ONE
        first = make_case(job.seed, known=friction, scatter=SCATTER, **how)
        carrying = dataclasses.replace(first.bare, payload=(mass, centre))
        # another seed: another motion and other noise, of the same arm
        later = make_case(job.seed + 1_000_000, motion=motion, bare=carrying)
    except StictionError as error:
        return row | {"broken": str(error)}
    bare = diagnose_logs([*first.logs, *first.second], first.robot)
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "model.toml"
        model.write_text(dump(model_of(bare)), encoding="utf-8")
        found = diagnose_logs(later.logs, first.robot, nominal=model)
    row |= {
        "motion": motion,
        "calibration": {
            "verdict": bare.verdict,
            "named": [c.name for c in bare.causes],
            "held_out_nm": bare.extended_rms.tolist(),
            "noise_nm": bare.noise.tolist(),
        },
        "verdict": found.verdict,
        "named": [c.name for c in found.causes],
        "held_out_nm": found.extended_rms.tolist(),
        "noise_nm": found.noise.tolist(),
    }
    payload = next((c for c in found.causes if c.name == "payload"), None)
    if payload is None:
        return row
    weighed, com = (payload.parameters[0][key] for key in ("mass_kg", "com_m"))
    ci, com_ci = np.array(weighed.ci95), np.array(com.ci95)
    return row | {
        "weighed_kg": weighed.value,
        "ci95_kg": ci.tolist(),
        "inside": bool(ci[0] <= mass <= ci[1]),
        "half_width": float(ci[1] - ci[0]) / 2 / mass,
        "com_inside": bool(np.all((com_ci[:, 0] <= centre) & (centre <= com_ci[:, 1]))),
    }


def inside(row: Row) -> bool:
    """Return whether a payload is named and the tool's mass is within its interval."""
    return bool(row.get("inside", False))


def line(row: Row) -> str:
    """Return a case in a line."""
    out = f"{row['seed']}, {row['mass_kg']:.2f} kg"
    if "broken" in row:
        return f"{out}: no log"
    how = "exciting logs" if row["exciting"] else "one joint at a time"
    friction = "with" if row["friction"] else "without"
    out += f" ({row['motion']}, {friction} friction, calibrated: {how}): "
    if "weighed_kg" in row:
        low, high = row["ci95_kg"]
        out += f"weighed {row['weighed_kg']:.2f} kg ({low:.2f} to {high:.2f}); "
    named, before = (", ".join(x["named"]) or "nothing" for x in (row, row["calibration"]))
    return f"{out}named {named}; on the bare arm {before}"


def table(rows: Sequence[Row]) -> str:
    """Return how well tools were weighed, in all and by what may matter."""
    groups = {
        f"below {HEAVY:g} kg": [r for r in rows if r["mass_kg"] < HEAVY],
        f"from {HEAVY:g} kg up": [r for r in rows if r["mass_kg"] >= HEAVY],
        "without friction": [r for r in rows if not r["friction"]],
        "with friction that the calibration finds": [r for r in rows if r["friction"]],
        "calibrated on exciting logs": [r for r in rows if r["exciting"]],
        "calibrated one joint at a time": [r for r in rows if not r["exciting"]],
        "all": list(rows),
    }
    lines = []
    for name, mine in groups.items():
        found = [r for r in mine if "weighed_kg" in r]
        off = [abs(r["weighed_kg"] / r["mass_kg"] - 1) for r in found]
        width = [r["half_width"] for r in found]
        counts = (mine, found, *([r for r in found if r[x]] for x in ("inside", "com_inside")))
        lines.append([name, *(str(len(x)) for x in counts)])
        lines[-1] += [number(100 * float(x)) for x in (*_spread(off), *_spread(width))]
    header = ["tools", "cases", "payload named", "mass in interval", "centre in interval"]
    header += ["error, median [%]", "largest", "half-width, median [%]", "largest"]
    return table_text(header, lines)


def _spread(values: Sequence[float]) -> tuple[float, float]:
    """Return median and largest; NaN of none."""
    return (float(np.median(values)), max(values)) if values else (np.nan, np.nan)


def page(found: Mapping[str, Row]) -> dict[str, Any]:
    """Return what the page's template asks for."""
    rows = [r for r in found.values() if "broken" not in r]
    heavy = [r["half_width"] for r in rows if r["mass_kg"] >= HEAVY and "half_width" in r]
    share = sum(map(inside, rows)) / max(len(rows), 1)
    return {
        "cases": len(rows),
        "broken": len(found) - len(rows),
        "hits": sum(map(inside, rows)),
        "aim": f"aim ≥ {100 * INSIDE:.0f} %: {met(share, INSIDE)}",
        "narrow": sum(x <= HALF_WIDTH for x in heavy),
        "heavy": len(heavy),
        "width": 100 * HALF_WIDTH,
        "heavy_kg": HEAVY,
        "table": table(rows),
        "missed": [line(r) for r in rows if not inside(r)],
        "scatter": 100 * SCATTER,
        "mass": f"{MASS[0]:g} to {MASS[1]:g} kg",
        "centre": 100 * DISTANCE,
        "seconds": float(np.median([r["seconds"] for r in rows])) if rows else np.nan,
        "first": FIRST,
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--cases", type=int, default=50)
    parser.add_argument("--first", type=int, default=FIRST, help="seed; another writes no page")
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    jobs = [Job(options.first + k) for k in range(options.cases)]
    found = STUDY.rows(options).fill(
        {job.key: job for job in jobs},
        weigh,
        processes=options.processes,
        minutes=options.minutes,
    )
    if options.first != FIRST:
        print("\n".join(map(line, found.values())))
        return
    STUDY.write_page(options, planned=len(jobs), **page(found))


if __name__ == "__main__":
    main()
