"""Every real log at hand through `diagnose`, beside dense least squares.

    python -m benchmarks.accuracy.every_log [--list FILE.toml] [--folder ../shared]

A model is made from some logs and tried on others, of another motion where there is one. Dense
least squares has the base parameters of all links, Coulomb and viscous friction, an offset and a
rotor inertia per joint, weighted by each joint's residual (M. Gautier, "Numerical calculation of
the base inertial parameters of robots", 1991). Both get the same filtered signals. Logs of
commanded and measured positions have our error alone.
"""

import tomllib
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.peers import cut
from benchmarks.harness import LOGS, MEASURED, Benchmark, Row
from stiction_envs import diagnose
from stiction_envs.errors import StictionError
from stiction_envs.gap.report.results import LogDiagnosis, ServoResult
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.reader import read_logs
from stiction_envs.measured.logs.sources import Log
from stiction_envs.reporting.markdown import table_text
from stiction_envs.robots import Arm, load_arm
from stiction_envs.robots.regressor import torque_regressor

Array = NDArray[np.float64]
STUDY = Benchmark(__file__, __doc__, made_by=(*LOGS, "benchmarks/accuracy/every_log.*"))
RANK = 1e-8
"""Singular values below which a direction is not excited, over the largest [-]."""
AIM = 1.1
"""Largest error of the named model over that of dense least squares [-]."""


def columns(data: Data) -> tuple[Array, Array]:
    """Return (T, n, 10 n) the links' regressor, and (n, T, 4) each joint's own columns."""
    shared = torque_regressor(data.recording.pinocchio, data.q, data.dq, data.ddq)
    one = np.ones(len(data.q))
    own = [
        np.stack([data.smooth(data.directions[:, j]), data.dq[:, j], one, data.ddq[:, j]], axis=1)
        for j in range(data.n)
    ]
    return shared, np.stack(own)


def dense(fit: Data, check: Data) -> Array:
    """Return (n,) what dense least squares on some logs leaves on others [N·m]."""
    shared, own = columns(fit)
    n, links = fit.n, shared.shape[2]
    rows = fit.block >= 0
    size, c = np.ones(n), np.zeros(links + 4 * n)
    for _ in range(3):  # weights are what the joints leave
        xx, xy = np.zeros((len(c), len(c))), np.zeros(len(c))
        for j in range(n):
            x = np.zeros((int(rows.sum()), len(c)))
            x[:, :links], x[:, links + 4 * j : links + 4 * j + 4] = shared[rows, j], own[j][rows]
            xx += x.T @ x / size[j] ** 2
            xy += x.T @ fit.tau[rows, j] / size[j] ** 2
        scale = np.sqrt(np.maximum(np.diag(xx), 1e-300))
        c = np.linalg.pinv(xx / np.outer(scale, scale), rcond=RANK, hermitian=True) @ (xy / scale)
        c /= scale
        size = np.maximum(left(fit, c, shared, own), 1e-9)
    return left(check, c, *columns(check))


def left(data: Data, c: Array, shared: Array, own: Array) -> Array:
    """Return (n,) what coefficients leave, root mean square [N·m]."""
    links = shared.shape[2]
    each = np.reshape(c[links:], (data.n, 4))
    torque = shared @ c[:links] + np.einsum("jtk,jk->tj", own, each)
    return np.asarray(np.sqrt(np.mean(np.square(data.tau - torque), axis=0)))


def parts(one: Row, folder: Path, arm: Arm) -> tuple[Sequence[Log], Sequence[Log]]:
    """Return the logs to diagnose and to check with, cut from one where there is no other."""
    paths = [folder / x for x in one["logs"]]
    if "cut" not in one:
        return paths, [folder / x for x in one.get("check", ())]
    naming = Naming(robot=arm.joint_names)
    logs = read_logs(paths, arm.n, limits=arm.limits, naming=naming)
    cuts = [int(float(one["cut"]) * len(log.t)) for log in logs]
    return (
        [cut(log, slice(0, k)) for log, k in zip(logs, cuts, strict=True)],
        [cut(log, slice(k, len(log.t))) for log, k in zip(logs, cuts, strict=True)],
    )


def robot_of(name: str, folder: Path) -> str | Path:
    """Return a name, a file of the folder, or with ``wheel:`` one of `example-robot-data`."""
    if name.startswith("wheel:"):
        place = "cmeel.prefix/share/example-robot-data/robots"
        found = metadata.distribution("example-robot-data")
        return Path(str(found.locate_file(f"{place}/{name[6:]}")))
    return folder / name if "/" in name else name


def measure(one: Row) -> Row:
    """Return what both models leave, and what `diagnose` says."""
    folder = Path(one["folder"])
    arm = load_arm(robot_of(one["robot"], folder), chain=one.get("chain"))
    try:
        logs, check = parts(one, folder, arm)
        poses = [folder / x for x in one.get("poses", ())]
        options = {k: one[k] for k in ("torque", "same_servo") if k in one}
        found = diagnose(logs, arm, poses=poses, check=check, **options)
    except StictionError as error:
        return {"refused": str(error)}
    assert isinstance(found, LogDiagnosis | ServoResult)
    held, logged = found.errors, found.diagnosis.logs
    nominal, ours = (held.nominal, held.extended) if held.check is None else held.check
    read = [found.check.verdict] if isinstance(found, LogDiagnosis) and found.check else []
    out = {
        "verdict": ", ".join([found.verdict, *read]),
        "names": [f"{c.name} ({', '.join(map(str, c.joints))})" for c in found.causes],
        "nominal": nominal.tolist(),
        "ours": ours.tolist(),
        "unit": held.unit,
        "read": sorted({c.text.split(":")[0] for log in logged for c in log.corrections if c.rows}),
    }
    if isinstance(found, LogDiagnosis):
        assert found.check is not None
        out["read"] += [x.split(":")[0] for x in found.diagnosis.data.recording.findings]
        out["dense"] = dense(found.diagnosis.base, found.check.data).tolist()
    return out


def page(listed: list[Row], rows: dict[str, Row]) -> dict[str, str]:
    """Return the values of the page."""
    out, read, behind, counted = [], [], [], 0
    for one in listed:
        row, name = rows[one["name"]], one["name"]
        if "refused" in row:
            out.append([name, one["licence"], f"refused: {row['refused']}", "", "", "", ""])
            continue
        read.append([name, "; ".join(row["read"]) or "as it is"])
        nominal, ours = (float(np.mean(row[k])) for k in ("nominal", "ours"))
        texts = [f"{ours:.3g}", "–"]
        if "dense" in row:
            theirs = float(np.mean(row["dense"]))
            counted += 1
            behind += [name] if ours > AIM * theirs else []
            texts = [f"{x:.3g}" for x in (ours, theirs)]
            best = int(theirs < ours)
            texts[best] = f"**{texts[best]}**"
        held = "its last third" if "cut" in one else "another motion"
        out.append(
            [
                name,
                one["licence"],
                row["verdict"],
                held if "check" in one or "cut" in one else "held-out blocks",
                f"{nominal:.3g} {row['unit']}",
                *texts,
                "; ".join(row["names"]) or "nothing",
            ]
        )
    head = ["log", "licence", "verdict, check", "checked on", "nominal", "ours", "dense", "named"]
    return {
        "table": table_text(head, out),
        "read": table_text(["log", "what was corrected, or found in its channels"], read),
        "near": f"{counted - len(behind)} of {counted}",
        "behind": f": not on {', '.join(behind)}" if behind else "",
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--list", type=Path, default=Path(__file__).with_suffix(".toml"))
    parser.add_argument("--folder", type=Path, default=MEASURED.parent, help="that paths start in")
    options = parser.parse_args()
    if not options.folder.is_dir():
        print(f"skipped: no folder {options.folder}")
        return
    listed = tomllib.loads(options.list.read_text("utf-8"))["log"]
    jobs = {one["name"]: {**one, "folder": str(options.folder)} for one in listed}
    rows = STUDY.rows(options).fill(jobs, measure, minutes=options.minutes)
    if len(rows) == len(jobs):
        STUDY.write_page(options, **page(listed, rows))


if __name__ == "__main__":
    main()
