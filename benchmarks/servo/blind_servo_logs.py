"""Find hidden causes in servo logs: commanded and measured positions, no torque.

    python -m benchmarks.servo.blind_servo_logs --cases 24

Arms of `example_robot_data` and ours, each with its links 5 % off, angles in steps of 1.5 mrad,
late stamps and a clock that jitters, hide none to three causes on drawn joints
(`hidden.servo_logs`). `diagnose` knows the servos' stiffness and damping as they should be. Which
causes does it name, and on the right joints?
"""

import sysconfig
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import LOGS, Benchmark, Row
from stiction_envs.gap.servo.servo_diagnosis import diagnose_servo
from stiction_envs.hidden.servo_logs import CAUSES, hide
from stiction_envs.reporting.markdown import table_text
from stiction_envs.robots import load_arm

PLACES = ("stiction_envs/hidden", "stiction_envs/plant", "benchmarks/servo/blind_servo_logs.py")
STUDY = Benchmark(__file__, __doc__, made_by=(*LOGS, *PLACES))
FIRST = 6000
"""Seeds of the study begin here; those below are for development."""
ROBOTS = {
    "so101": "so_arm_description/urdf/so101.urdf",
    "so100": "so_arm_description/urdf/so100.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "z1": "z1_description/urdf/z1.urdf",
    "panda": "",
}
"""Files of the package's robots; "" is ours."""
STUDIED = [x for x in CAUSES if x not in ("presliding_hysteresis", "gravity_compensation_missing")]
"""Causes that are hidden."""
REFINES = {"stribeck_friction", "load_dependent_friction"}
"""Causes that come with dry friction, which is then right to be named."""


def drawn(seed: int) -> tuple[str, tuple[str, ...]]:
    """Return robot and causes of a log: none in every fourth, one to three different ones else."""
    robot = tuple(ROBOTS)[seed % len(ROBOTS)]
    if seed % 4 == 0:
        return robot, ()
    rng = np.random.default_rng([seed, 21])
    return robot, tuple(rng.choice(STUDIED, size=int(rng.integers(1, 4)), replace=False))


def robot_file(name: str) -> str:
    """Return the model file of a robot, or its name."""
    if not ROBOTS[name]:
        return name
    site = sysconfig.get_path("purelib")
    return str(Path(site) / "cmeel.prefix/share/example-robot-data/robots" / ROBOTS[name])


def search(seed: int) -> Row:
    """Hide the causes, diagnose the log."""
    robot, causes = drawn(seed)
    arm = load_arm(robot_file(robot))
    case = hide(arm, causes, seed=seed)
    found = diagnose_servo([case.log], arm, case.servo, threads=1)
    # 0 is the joint of a cause of the whole arm
    joints = {c.name: (0,) if 0 in c.parameters else c.joints for c in found.causes}
    return {
        "robot": robot,
        "hidden": [list(x) for x in case.hidden],
        "named": [[name, j] for name, those in joints.items() for j in those],
        "nominal_rad": found.nominal_rms.tolist(),
        "extended_rad": found.extended_rms.tolist(),
    }


def score(row: Row) -> tuple[int, int, int]:
    """Return how many hidden causes were named, how many on their joint, and what is false.

    False is what was not hidden on that joint, but for the dry friction that another refines.
    """
    hidden = {(str(c), int(j)) for c, j in row["hidden"]}
    named = {(str(c), int(j)) for c, j in row["named"]}
    families = {c for c, _ in named}
    belongs = hidden | {("coulomb_friction", j) for c, j in hidden if c in REFINES}
    return sum(c in families for c, _ in hidden), len(hidden & named), len(named - belongs)


def page(found: Mapping[str, Row]) -> dict[str, Any]:
    """Return what the page's template asks for."""
    rows = list(found.values())
    scores = np.array([score(r) for r in rows]).reshape(-1, 3).sum(axis=0)
    empty = [r for r in rows if not r["hidden"]]
    header = ["seed", "arm", "hidden", "named", "error before [mrad]", "after [mrad]"]
    lines = []
    for key, r in found.items():
        errors = (f"{1e3 * max(r[k]):.1f}" for k in ("nominal_rad", "extended_rad"))
        lines.append([key, r["robot"], _said(r["hidden"]), _said(r["named"]), *errors])
    return {
        "cases": len(rows),
        "hidden": sum(len(r["hidden"]) for r in rows),
        "named": sum(len(r["named"]) for r in rows),
        **dict(zip(("families", "exact", "wrong"), scores.tolist(), strict=True)),
        "empty": len(empty),
        "silent": sum(not r["named"] for r in empty),
        "table": table_text(header, lines),
        "seconds": float(np.median([r["seconds"] for r in rows])) if rows else np.nan,
        "first": FIRST,
    }


def _said(pairs: Sequence[Sequence[Any]]) -> str:
    return ", ".join(f"{c} {j}" for c, j in pairs) or "nothing"


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    seeds = range(FIRST, FIRST + options.cases)
    found = STUDY.rows(options).fill(
        {str(seed): seed for seed in seeds},
        search,
        processes=options.processes,
        minutes=options.minutes,
    )
    STUDY.write_page(options, planned=len(seeds), **page(found))


if __name__ == "__main__":
    main()
