"""Where an exported arm sticks: the conformance test inside every engine that is installed.

    python -m benchmarks.engines.engines [--minutes M]

An arm is exported as `stiction export` does for the engine, with both kinds of friction; each joint
is held at 90 % of its stiction and driven at 110 %. Engines whose extra is not installed keep the
rows of an earlier run.
"""

import dataclasses
from itertools import product
from typing import Any

import mujoco
import numpy as np

from benchmarks.harness import Benchmark, Row, machine
from stiction_envs.errors import StictionError
from stiction_envs.experiments.conformance import conformance
from stiction_envs.experiments.conformance_report import ConformanceSettings
from stiction_envs.experiments.engines import ENGINES
from stiction_envs.friction.export import HARDEST, NOSLIP, Kind, plain_mjcf
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.reporting.markdown import table_text

STUDY = Benchmark(
    __file__,
    __doc__,
    made_by=(
        "benchmarks/engines/engines.py",
        *(
            f"stiction_envs/experiments/{x}"
            for x in ("conformance.py", "conformance_report.py", "engines")
        ),
        *("stiction_envs/friction", "stiction_envs/robots"),
    ),
)
ARMS = ("panda", "iiwa7", "iiwa14")
KINDS: tuple[Kind, ...] = ("dcmotor", "frictionloss")
ONE = "one-joint"
"""A single joint with the ``frictionloss`` of an export, where arms take too long."""
ONE_HOLD = 6.0
"""Length of its hold [s]."""
TOO_LONG = ("mjx",)
"""Engines in which the ``frictionloss`` of a whole arm takes too long: a step of two Pandas takes
MJX 10.5 s of processor time."""


def short(hold: float, go: float) -> ConformanceSettings:
    """Return the test's settings with a shorter hold [s], its parts in proportion."""
    usual = ConformanceSettings()
    share = hold / usual.hold_time
    return dataclasses.replace(
        usual,
        hold_time=hold,
        watched_time=share * usual.watched_time,
        rise_time=share * usual.rise_time,
        go_time=go,
    )


def exported(arm: str, kind: Kind, engine: str) -> str:
    """Return the MJCF that export writes for an engine; with ``dcmotor`` also for one without."""
    motor = ENGINES[engine].motor or "ff"
    return plain_mjcf(sticking_model(arm), friction_name=arm, kind=kind, motor=motor)


def in_engine(job: tuple[str, str, Kind, ConformanceSettings]) -> Row:
    """Return the row of an arm, or of `ONE`, with a kind of friction in an engine."""
    engine, arm, kind, settings = job
    text = one_joint() if arm == ONE else exported(arm, kind, engine)
    report = conformance(text, engine=engine, settings=settings, rates=(), threads=1)
    joints = report.joints
    return {
        "version": (report.engine or f"mujoco {mujoco.__version__}").split()[-1],
        "refused": report.refused,
        "joints": len(joints),
        "holds": sum(j.holds for j in joints),
        "goes": sum(j.goes for j in joints),
        "creep": float(np.max([j.creep for j in joints])),
        "motion": float(np.max([j.still for j in joints])),
        "still": report.settings.still,
        "hold": report.settings.hold_time,
        "watched": report.settings.watched_time,
    }


def one_joint() -> str:
    """Return a single joint of 0.5 N·m with the solver settings that export writes."""
    hard = " ".join(f'{key}="{value.format(0.002)}"' for key, value in HARDEST.items())
    return f"""<mujoco><option timestep="0.001" noslip_iterations="{NOSLIP}"/><worldbody><body>
      <joint name="joint" type="hinge" frictionloss="0.5" armature="0.1" {hard}/>
      <geom size="0.05" mass="1" pos="0.1 0 0"/></body></worldbody></mujoco>"""


def cells(row: Row) -> list[str]:
    """Return holds, goes, creep and motion of a row."""
    if row["refused"]:
        return ["refused", "refused", "–", "–"]
    of = f" of {row['joints']}"
    return [
        f"{row['holds']}{of}",
        f"{row['goes']}{of}",
        f"{row['creep']:.1e}",
        f"{row['motion']:.1e} in {row['watched']:g} s",
    ]


def page(rows: dict[str, Row]) -> dict[str, Any]:
    """Return what the page's template asks for."""
    body = []
    for key, row in rows.items():
        engine, arm, kind = key.split()
        body.append([f"{engine} {row['version']}", arm, kind, *cells(row), f"{row['hold']:g} s"])
    refused = {
        f"{key.split()[0]} {row['version']}": row["refused"]
        for key, row in rows.items()
        if row["refused"]
    }
    lugre = [(k.split()[0], r) for k, r in rows.items() if k.endswith("dcmotor")]
    stick = [
        e for e in ENGINES if any(name == e and r["holds"] == r["joints"] for name, r in lugre)
    ]
    return {
        "stick": stick,
        "table": table_text(
            ["engine", "arm", "friction", "hold", "go", "creep [rad/s]", "moved [rad]", "held for"],
            body,
        ),
        "refused": refused,
        "keep": table_text(
            ["engine", "line that keeps the friction"],
            [[name, e.keep] for name, e in ENGINES.items()],
        ),
        "settings": ConformanceSettings(),
        "missing": [e for e in ENGINES if not any(k.startswith(f"{e} ") for k in rows)],
        "one": ONE,
        "one_hold": ONE_HOLD,
        "machine": machine(),
    }


def main() -> None:
    options = STUDY.parser().parse_args()
    settings, kept, jobs, singles = short(60.0, 20.0), STUDY.rows(options), {}, {}
    for engine in ENGINES:
        try:
            ENGINES[engine].check()
        except StictionError as error:
            print(f"left out: {error}")
            continue
        for arm, kind in product(ARMS, KINDS):
            if engine not in TOO_LONG or kind != "frictionloss":
                jobs[f"{engine} {arm} {kind}"] = (engine, arm, kind, settings)
        brief = short(ONE_HOLD, 3.0)
        singles[f"{engine} {ONE} frictionloss"] = (engine, ONE, KINDS[1], brief)
    kept.fill({**jobs, **singles}, in_engine, minutes=options.minutes)
    every = [f"{e} {a} {k}" for e in ENGINES for a in (*ARMS, ONE) for k in KINDS]
    STUDY.write_page(options, **page(kept.known(every)))


if __name__ == "__main__":
    main()
