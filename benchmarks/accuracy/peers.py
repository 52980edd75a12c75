"""The same real logs through this tool, `mujoco.sysid` and FIGAROH, each as its documentation says.

    python -m benchmarks.accuracy.peers [--only NAME ...]

Each identifies from a part of the logs. Compared is what its model leaves of the torque on a part
that was held out between, and on a check log: later on, or other logs. All get the same signals.
Reads ../shared/measured, and needs ``pip install .[peers]``; what is missing is skipped.
"""

import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.accuracy import peers_figaroh, peers_sysid
from benchmarks.harness import LOGS, MEASURED, Benchmark, Row, machine
from stiction_envs.gap.diagnosis import diagnose_logs, model_of
from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import MOST_ROWS, Signals, prepare
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.gap.signals.torque_lag import correct_torques
from stiction_envs.measured.logs.reader import JointLog, read_logs, read_poses
from stiction_envs.reporting.markdown import joints, table_text
from stiction_envs.robots import Arm, load_arm

MADE_BY = (*LOGS, "benchmarks/accuracy/peers*.py")
STUDY = Benchmark(__file__, __doc__, made_by=MADE_BY)
PANDA = "panda_exciting_trajectory/panda_exciting_trajectory.csv.gz"
SWEEPS = [f"iiwa14_joint_friction/joint{j}.csv.gz" for j in (1, 2, 3, 5, 6, 7)]
POSES = "iiwa14_joint_friction/static_poses.csv.gz"
ROWS, OVERSAMPLED = 6000, 6.0
"""Samples that the peers are given at least, and their rate over the filter's cutoff: they need no
more, and take as long as there are; assumed."""
Array = np.ndarray


@dataclass(frozen=True)
class Parts:
    """Logs of one robot: to identify from, held out between those, and to check with."""

    arm: Arm
    fit: list[JointLog]
    held_out: list[JointLog]
    check: list[JointLog]
    what: tuple[str, str, str]
    """The three in words."""

    def signals(self, logs: list[JointLog], rows: int = MOST_ROWS) -> Signals:
        """Return them through the filter that fits the logs to identify from."""
        cutoff = prepare(self.fit).cutoff
        still = all(x.static for x in logs)
        return prepare(logs, cutoff_hz=None if still else cutoff, most_samples=rows)


def cut(log: JointLog, rows: slice) -> JointLog:
    """Return some neighbouring rows of a log as a log."""
    inner = tuple(b - rows.start for b in log.breaks if rows.start < b < rows.stop)
    return replace(
        log,
        t=log.t[rows],
        q=log.q[rows],
        dq=None if log.dq is None else log.dq[rows],
        tau=log.tau[rows],
        extra={k: x[rows] for k, x in log.extra.items()},
        breaks=inner,
    )


def panda() -> Parts:
    """One log of 20 s; identified from two stretches of its first 70 %."""
    arm = load_arm("panda")
    (log,) = read_logs([MEASURED / PANDA], arm.n, limits=arm.limits)
    a, b, c, end = (
        np.searchsorted(log.t, log.t[0] + x * np.ptp(log.t)) for x in (0.3, 0.45, 0.7, 1)
    )
    return Parts(
        arm,
        [cut(log, slice(0, a)), cut(log, slice(b, c))],
        [cut(log, slice(a, b))],
        [cut(log, slice(c, end))],
        ("0 to 30 and 45 to 70 % of the log", "30 to 45 %", "70 to 100 %"),
    )


def iiwa14() -> Parts:
    """Sweeps of one joint at a time; every third speed is held out, poses are the check."""
    arm = load_arm("iiwa14")
    sweeps = read_logs([MEASURED / x for x in SWEEPS], arm.n, limits=arm.limits)
    poses = read_poses(MEASURED / POSES, arm.n, limits=arm.limits)
    # together: some of them alone do not tell the torques' sign
    (*logs, poses), _ = correct_torques([*sweeps, poses], arm, prepare)
    fit = [cut(log, s) for log in logs for k, s in enumerate(log.segments) if k % 3 != 1]
    held = [cut(log, s) for log in logs for k, s in enumerate(log.segments) if k % 3 == 1]
    what = ("sweeps of joints 1, 2, 3, 5, 6 and 7, two of three speeds", "the other speeds")
    return Parts(arm, fit, held, [poses], (*what, "996 poses at rest"))


CASES: dict[str, Callable[[], Parts]] = {"panda": panda, "iiwa14": iiwa14}


def rms(parts: Parts, left: Callable[[Signals], Array]) -> dict[str, list[float]]:
    """Return (n,) the root mean square of what a model leaves of each part [N·m]."""
    signals = {x: parts.signals(getattr(parts, x)) for x in ("fit", "held_out", "check")}
    return {x: np.sqrt(np.mean(np.square(left(s)), axis=0)).tolist() for x, s in signals.items()}


def published(parts: Parts) -> dict[str, Any]:
    """Return what the published model leaves, as it is."""
    model = parts.arm.pinocchio()
    return {"rms": rms(parts, lambda s: inverse_dynamics(model, s.q, s.dq, s.ddq) - s.tau)}


def ours(parts: Parts) -> dict[str, Any]:
    """Return what `stiction diagnose` finds, and what its model leaves."""
    found = diagnose_logs(parts.fit, parts.arm, torque="link")
    model = model_of(found)
    left = rms(parts, lambda s: model.extend(assemble(parts.arm, s, torque="link")).residual)
    causes = ", ".join(f"{c.name} ({joints(c.joints)})" for c in found.causes)
    bound = sum(e.on_bound for c in found.causes for p in c.parameters.values() for e in p.values())
    confused = sum(bool(c.confused_with) for c in found.causes)
    return {
        "rms": left,
        "causes": f"{len(found.causes)} by name: {causes}",
        "trust": f"verdict: {found.verdict}; intervals of all parameters, {bound} on a bound; "
        f"{confused} causes may be confused with others, with the motion that tells them apart",
    }


def peer(kind: Any) -> Callable[[Parts], dict[str, Any]]:
    """Return what runs a peer."""

    def run(parts: Parts) -> dict[str, Any]:
        whole = parts.signals(parts.fit)
        rows = max(ROWS, int(OVERSAMPLED * whole.cutoff * (len(whole.t) * whole.dt)))
        given = parts.signals(parts.fit, rows)
        names = ("q", "dq", "ddq", "tau")
        stretches = [
            SimpleNamespace(**{name: getattr(given, name)[run] for name in names})
            for run in given.runs
        ]
        model = kind(parts.arm, stretches, given.dt)
        left = rms(parts, lambda s: model.torque(s.q, s.dq, s.ddq) - s.tau)
        return {"rms": left, **model.says()}

    return run


TOOLS: dict[str, tuple[str, Callable[[Parts], dict[str, Any]]]] = {
    "published masses": ("", published),
    "stiction diagnose": ("", ours),
    "mujoco.sysid": ("absl", peer(peers_sysid.Sysid)),
    "FIGAROH": ("figaroh", peer(peers_figaroh.Figaroh)),
}
"""By name: the package that must be there, and what runs it."""


def measured(job: tuple[str, str]) -> Row:
    """Return what a tool leaves and says of a case."""
    name, tool = job
    parts = CASES[name]()
    start = time.perf_counter()
    row = TOOLS[tool][1](parts)
    return {**row, "seconds": time.perf_counter() - start, "what": parts.what}


def section(tools: dict[str, Row]) -> dict[str, Any]:
    """Return what the page's template asks for, of one robot's rows by tool."""
    held = {}
    for key in ("held_out", "check"):
        left = {tool: np.array(row["rms"][key]) for tool, row in tools.items()}
        best = np.min(list(left.values()), axis=0)
        table = []
        for tool, error in left.items():
            pairs = zip(error, best, strict=True)
            shown = [f"**{x:.3f}**" if x <= y else f"{x:.3f}" for x, y in pairs]
            table.append([tool, *shown, f"{error.mean():.3f}"])
        header = ["Held out" if key == "held_out" else "Check"]
        header += [f"joint {j}" for j in range(1, 1 + len(best))]
        held[key] = table_text([*header, "mean"], table)
    says = [
        [tool, row["causes"], row["trust"], f"{row['seconds']:.0f} s"]
        for tool, row in tools.items()
        if "causes" in row
    ]
    header = ["", "what it says of causes", "of trust", "time"]
    means = {tool: float(np.mean(row["rms"]["held_out"])) for tool, row in tools.items()}
    what = next(iter(tools.values()))["what"]
    return {**held, "what": what, "says": table_text(header, says), "means": means}


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--only", nargs="+", choices=list(CASES), help="cases; no page is written")
    options = parser.parse_args()
    if not (MEASURED / PANDA).is_file():
        print(f"skipped: the measured logs are not in {MEASURED}")
        return
    there = [x for x, (name, _) in TOOLS.items() if not name or importlib.util.find_spec(name)]
    jobs = {f"{name}, {x}": (name, x) for name in options.only or CASES for x in there}
    rows = STUDY.rows(options).fill(jobs, measured, minutes=options.minutes)
    if len(rows) < len(CASES) * len(TOOLS):
        print(f"no page is written: {len(rows)} of {len(CASES) * len(TOOLS)} rows; tools: {there}")
        return
    STUDY.write_page(
        options,
        machine=machine(),
        figaroh=version("figaroh"),
        sysid=peers_sysid,
        cases={name: section({x: rows[f"{name}, {x}"] for x in TOOLS}) for name in CASES},
    )


if __name__ == "__main__":
    main()
