"""Two real robots: what today's models leave, what the tool leaves, and what it names.

    python -m benchmarks.accuracy.real_logs [--only NAME ...]

Reads ../shared/measured, of which nothing is copied; without it nothing is done.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.accuracy.real_logs_page import SWEEP_JOINTS, draw, page
from benchmarks.harness import LOGS, MEASURED, Benchmark, Row
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs, model_of
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.measured.logs.reader import JointLog, read_logs, read_poses
from stiction_envs.robots import load_arm

PANDA = "panda_exciting_trajectory/panda_exciting_trajectory.csv.gz"
SWEEPS = {j: f"iiwa14_joint_friction/joint{j}.csv.gz" for j in SWEEP_JOINTS}
POSES = "iiwa14_joint_friction/static_poses.csv.gz"
DRAWN = 3000
"""Samples kept of each joint for the pictures."""
MADE_BY = (*LOGS, "benchmarks/accuracy/real_logs*.py", "!benchmarks/accuracy/real_logs_page.py")
"""Code that decides what is said of a log."""
STUDY = Benchmark(__file__, __doc__, made_by=MADE_BY)


def panda() -> Row:
    arm = load_arm("panda")
    logs = read_logs([MEASURED / PANDA], arm.n, limits=arm.limits)
    return row_of(diagnose_logs(logs, arm, torque="link"), range(1, 8))


def iiwa_logs() -> tuple[list[JointLog], JointLog]:
    """The sweeps and the poses."""
    arm = load_arm("iiwa14")
    paths = [MEASURED / x for x in SWEEPS.values()]
    sweeps = read_logs(paths, arm.n, limits=arm.limits)
    return sweeps, read_poses(MEASURED / POSES, arm.n, limits=arm.limits)


def iiwa_sweep(joint: int) -> Row:
    """A sweep beside what the poses say of gravity and of the torques' sign."""
    logs, poses = iiwa_logs()
    gravity = model_of(diagnose_logs([poses], "iiwa14", torque="link"))
    mine = logs[list(SWEEPS).index(joint)]
    d = diagnose_logs([mine], "iiwa14", nominal=gravity, torque="link")
    return row_of(d, (2, 4) if joint == 2 else (joint,))


def iiwa_poses() -> Row:
    _, poses = iiwa_logs()
    d = diagnose_logs([poses], "iiwa14", torque="link")
    return row_of(d, range(1, 8))


def iiwa_together() -> Row:
    logs, poses = iiwa_logs()
    return row_of(diagnose_logs([*logs, poses], "iiwa14", torque="link"), range(1, 8))


CASES: dict[str, Callable[[], Row]] = {
    "panda": panda,
    **{f"iiwa14 joint{j}": partial(iiwa_sweep, j) for j in SWEEPS},
    "iiwa14 poses": iiwa_poses,
    "iiwa14 together": iiwa_together,
}


def row_of(d: Diagnosis, shown: Any) -> Row:
    """Return what a diagnosis says, and samples of the joints that are shown."""
    data = d.data
    shown = [j - 1 for j in shown]
    rms = {k: v.tolist() for k, v in usual(d).items()} | {"extended": d.extended_rms.tolist()}
    at = np.unique(np.linspace(0, len(data.q) - 1, DRAWN).astype(int))
    clock = np.cumsum(np.r_[0.0, np.clip(np.diff(data.recording.t), 0.0, 1.0)])
    samples = {
        str(j): {
            "t": clock[at].tolist(),
            "q": data.q[at, j].tolist(),
            "dq": data.dq[at, j].tolist(),
            "before": d.base.residual[at, j].tolist(),
            "after": (data.residual[:, j] - d.torque(j))[at].tolist(),
        }
        for j in shown
    }
    return {
        "robot": d.robot,
        "verdict": d.verdict,
        "shown": [j + 1 for j in shown],
        "rms": rms,
        "noise": data.noise.tolist(),
        "cutoff_hz": data.recording.cutoff,
        "blocks": int(data.block.max()) + 1,
        "rows": len(data.q),
        "causes": d.to_json()["causes"],
        "samples": samples,
    }


# ---- fits beside the tool's, each block of time under the fit of all others --------------------


def held_out(data: Data, columns: list[np.ndarray]) -> np.ndarray:
    """Root mean square (n,) [N·m] that columns (T, k) of each joint leave of the residual."""
    out = np.zeros(data.n)
    for j, x in enumerate(columns):
        y, left, count = data.residual[:, j], 0.0, 0
        for b in range(data.block.max() + 1):
            test, fit = data.block == b, (data.block >= 0) & (data.block != b)
            c = np.linalg.lstsq(x[fit], y[fit], rcond=1e-8)[0] if x.shape[1] else np.zeros(0)
            left += float(np.sum((y[test] - x[test] @ c) ** 2))
            count += int(test.sum())
        out[j] = np.sqrt(left / count)
    return out


def usual(d: Diagnosis) -> dict[str, np.ndarray]:
    """Rigid body, plus Coulomb and viscous friction, plus an offset: (n,) each [N·m].

    Given published masses, whatever the baseline of the tool was.
    """
    data = d.base
    one = np.ones((len(data.q), 1))
    friction = [
        np.column_stack([data.smooth(data.directions[:, j]), data.dq[:, j]]) for j in range(data.n)
    ]
    moves = [np.ptp(data.q[:, j]) > 0.2 for j in range(data.n)]
    friction = [x if m else x[:, :0] for x, m in zip(friction, moves, strict=True)]
    return {
        "rigid": held_out(data, [one[:, :0]] * data.n),
        "coulomb_viscous": held_out(data, friction),
        "coulomb_viscous_offset": held_out(data, [np.hstack([x, one]) for x in friction]),
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--only", nargs="+", choices=list(CASES), help="cases; no page is written")
    options = parser.parse_args()
    if not (MEASURED / PANDA).is_file():
        print(f"skipped: the measured logs are not in {MEASURED}")
        return
    names = {name: name for name in options.only or CASES}
    rows = STUDY.rows(options).fill(names, lambda name: CASES[name](), minutes=options.minutes)
    if len(rows) == len(CASES):
        draw(rows, options.out)
        STUDY.write_page(options, **page(rows))
        return
    for name, row in rows.items():
        print(name, row["verdict"], [(c["name"], c["joints"]) for c in row["causes"]])


if __name__ == "__main__":
    main()
