"""Three real robots: what today's models leave, what the tool leaves, and what it names.

    python benchmarks/real_logs.py [--work DIR] [--only NAME ...]

Reads ../shared/measured (skipped clearly when it is not there); nothing of it is copied. Each case
is a file in ``--work`` that knows the code it was made by: a run that was stopped goes on where it
stopped, and a change of the code makes the cases anew. Writes real_logs.md and PNGs beside this.
"""

from __future__ import annotations

import argparse
import json
import pickle
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from _made_by import LOGS, PACKAGES, made_by  # noqa: E402
from _real_logs_fits import masses, tx40_arm, usual, without_body  # noqa: E402
from _real_logs_page import page  # noqa: E402
from _real_logs_pictures import draw  # noqa: E402

from stiction_envs.gap.causes import CAUSES  # noqa: E402
from stiction_envs.gap.diagnosis import (  # noqa: E402
    Diagnosis,
    diagnose,
    model_of,
)
from stiction_envs.gap.signals.prepare import prepare  # noqa: E402
from stiction_envs.gap.signals.torque_lag import correct_torques  # noqa: E402
from stiction_envs.measured.logs.reader import JointLog, read_logs, read_poses  # noqa: E402
from stiction_envs.reporting.atomic import write_text_atomic  # noqa: E402
from stiction_envs.robots import load_arm  # noqa: E402

MEASURED = HERE.parents[1] / "shared" / "measured"
PANDA = "panda_exciting_trajectory/panda_exciting_trajectory.csv.gz"
SWEEPS = {j: f"iiwa14_joint_friction/joint{j}.csv.gz" for j in (1, 2, 3, 5, 6, 7)}
POSES = "iiwa14_joint_friction/static_poses.csv.gz"
TX40 = "staubli_tx40/tx40.csv.gz"
BODILESS = {
    "payload",
    "link_parameters",
    "base_tilt",
    "torque_scale",
    "load_dependent_friction",
} | {
    "joint_elasticity",
    "backlash",
    "actuator_delay",
}
"""Causes that need the masses of a robot."""
DRAWN = 3000
"""Samples kept of each joint for the pictures."""
MADE_BY = (
    *LOGS,
    "benchmarks/*real_logs*.py",
    *(f"!benchmarks/_real_logs_{name}.py" for name in ("page", "pictures")),
)
"""Code that decides what is said of a log."""
Row = dict[str, Any]


def panda() -> Row:
    return told(diagnose([MEASURED / PANDA], "panda", link_side=True), range(1, 8))


def iiwa_logs() -> tuple[list[JointLog], JointLog]:
    """The sweeps and the poses, corrected together: some of them alone do not tell the sign."""
    arm = load_arm("iiwa14")
    paths = [MEASURED / x for x in SWEEPS.values()]
    logs = read_logs(paths, arm.n, limits=arm.limits)
    logs.append(read_poses(MEASURED / POSES, arm.n, limits=arm.limits))
    corrected, _ = correct_torques(logs, arm, lambda x: prepare(x, most_samples=40_000))
    return corrected[:-1], corrected[-1]


def iiwa_sweep(joint: int) -> Row:
    """A sweep beside what the poses say of gravity: one joint's motion cannot say it."""
    logs, poses = iiwa_logs()
    gravity = model_of(diagnose([poses], "iiwa14", link_side=True))
    mine = logs[list(SWEEPS).index(joint)]
    d = diagnose([mine], "iiwa14", nominal=gravity, link_side=True)
    return told(d, (2, 4) if joint == 2 else (joint,))


def iiwa_poses() -> Row:
    _, poses = iiwa_logs()
    d = diagnose([poses], "iiwa14", link_side=True)
    row = told(d, range(1, 8))
    row["rms"] |= {k: v.tolist() for k, v in masses(d).items()}
    return row


def iiwa_together() -> Row:
    logs, poses = iiwa_logs()
    return told(diagnose([*logs, poses], "iiwa14", link_side=True), range(1, 8))


def tx40() -> Row:
    (log,) = read_logs([MEASURED / TX40], 6)
    arm = tx40_arm()
    made, fits = without_body(log, arm)
    causes = [c for c in CAUSES if c.name not in BODILESS]
    row = told(diagnose([made], arm, causes=causes), range(1, 7))
    row["rms"] = {"extended": row["rms"]["extended"]} | {k: v.tolist() for k, v in fits.items()}
    return row


CASES: dict[str, Callable[[], Row]] = {
    "panda": panda,
    **{f"iiwa14 joint{j}": lambda j=j: iiwa_sweep(j) for j in SWEEPS},
    "iiwa14 poses": iiwa_poses,
    "iiwa14 together": iiwa_together,
    "tx40": tx40,
}


def told(d: Diagnosis, shown: Any) -> Row:
    """What a diagnosis says, and samples of the joints that are shown."""
    data = d.data
    shown = [j - 1 for j in shown]
    rms = {k: v.tolist() for k, v in usual(d).items()} | {"extended": d.extended_rms.tolist()}
    at = np.unique(np.linspace(0, len(data.t) - 1, DRAWN).astype(int))
    clock = np.cumsum(np.r_[0.0, np.clip(np.diff(data.t), 0.0, 1.0)])
    samples = {
        j: {
            "t": clock[at],
            "q": data.q[at, j],
            "dq": data.dq[at, j],
            "rigid": data.rigid[at, j],
            "before": d.base.residual[at, j],
            "after": (data.residual[:, j] - d.torque(j))[at],
        }
        for j in shown
    }
    return {
        "robot": d.robot,
        "verdict": d.verdict,
        "shown": [j + 1 for j in shown],
        "rms": rms,
        "noise": data.noise.tolist(),
        "cutoff_hz": data.cutoff,
        "blocks": data.blocks,
        "rows": len(data.t),
        "causes": d.to_json()["causes"],
        "corrections": [[Path(x.source).name, c.text] for x in d.logs for c in x.corrections],
        "warnings": [[Path(x.source).name, w] for x in d.logs for w in x.warnings],
        "notes": list(d.notes),
        "samples": samples,
    }


def study(names: list[str], work: Path) -> dict[str, Row]:
    """Run what is not yet on disk."""
    code, rows = made_by(MADE_BY, PACKAGES), {}
    for name in tqdm(names, desc="real logs"):
        path = work / f"{name.replace(' ', '_')}.pickle"
        row = pickle.loads(path.read_bytes()) if path.exists() else {}
        if row.get("code") != code:
            start = time.perf_counter()
            row = CASES[name]() | {"code": code, "seconds": 0.0}
            row["seconds"] = time.perf_counter() - start
            path.write_bytes(pickle.dumps(row))
        rows[name] = row
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=list(CASES), help="cases; no page is written")
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "real_logs")
    parser.add_argument("--out", type=Path, default=HERE)
    args = parser.parse_args()
    if not (MEASURED / PANDA).is_file():
        print(f"skipped: the measured logs are not in {MEASURED}")
        return
    args.work.mkdir(parents=True, exist_ok=True)
    rows = study(args.only or list(CASES), args.work)
    if args.only:
        for name, row in rows.items():
            shown = {k: row[k] for k in ("verdict", "rms", "noise", "seconds")}
            shown["causes"] = [(c["name"], c["joints"]) for c in row["causes"]]
            print(name, json.dumps(shown, indent=1))
        return
    pictures = draw(rows, args.out)
    write_text_atomic(args.out / "real_logs.md", page(rows, pictures))
    print(f"written to {args.out / 'real_logs.md'}")


if __name__ == "__main__":
    main()
