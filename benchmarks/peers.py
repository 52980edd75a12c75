"""The same real logs through this tool, `mujoco.sysid` and FIGAROH, each as its documentation says.

    python benchmarks/peers.py [--work DIR] [--only NAME ...]

Each identifies from a part of the logs; what its model leaves of the torque is told on a part that
was held out between, and on a check log: later on, or other logs. All get the same signals.
Reads ../shared/measured, and needs ``pip install .[peers]``; what is missing is skipped and said.
Each case is a file in ``--work`` that knows the code it was made by. Writes peers.md beside this.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import inspect
import json
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import _peers_figaroh  # noqa: E402
import _peers_sysid  # noqa: E402
from real_logs import MEASURED, PANDA, iiwa_logs  # noqa: E402
from reference_loop import seconds as reference_loop  # noqa: E402

from stiction_envs.gap.diagnosis import diagnose, model_of  # noqa: E402
from stiction_envs.gap.signals.dataset import assemble  # noqa: E402
from stiction_envs.gap.signals.prepare import Signals, prepare  # noqa: E402
from stiction_envs.measured.logs.reader import JointLog, read_logs  # noqa: E402
from stiction_envs.reporting.atomic import write_text_atomic  # noqa: E402
from stiction_envs.reporting.markdown import joints, table_text  # noqa: E402
from stiction_envs.robots import Arm, load_arm  # noqa: E402

ROWS, OVERSAMPLED = 6000, 6.0
"""Samples that the peers are given at least, and their rate over the filter's cutoff: they need no
more, and take as long as there are."""
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

    def signals(self, logs: list[JointLog], rows: int | None = None) -> Signals:
        """Return them through the filter that fits the logs to identify from."""
        cutoff = prepare(self.fit).cutoff_hz
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
    logs, poses = iiwa_logs()
    fit = [cut(log, s) for log in logs for k, s in enumerate(log.segments) if k % 3 != 1]
    held = [cut(log, s) for log in logs for k, s in enumerate(log.segments) if k % 3 == 1]
    what = ("sweeps of joints 1, 2, 3, 5, 6 and 7, two of three speeds", "the other speeds")
    return Parts(load_arm("iiwa14"), fit, held, [poses], (*what, "996 poses at rest"))


CASES: dict[str, Callable[[], Parts]] = {"panda": panda, "iiwa14": iiwa14}


def rms(parts: Parts, model: Any) -> dict[str, list[float]]:
    """Return (n,) what a model leaves of the torques of each part [N·m]."""
    out = {}
    for name in ("fit", "held_out", "check"):
        left = [
            model.torque(s.q, s.dq, s.ddq) - s.tau
            for s in parts.signals(getattr(parts, name)).segments
        ]
        out[name] = np.sqrt(np.mean(np.square(np.concatenate(left)), axis=0)).tolist()
    return out


class Rigid:
    """The published model as it is."""

    name = "published masses"

    def __init__(self, arm: Arm) -> None:
        """Take its masses for true."""
        self.arm = arm

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return (T, n) torque of the rigid body [N·m]."""
        from stiction_envs.gap.signals.rigid_body import inverse_dynamics

        return inverse_dynamics(self.arm.pinocchio(), q, dq, ddq)


def ours(parts: Parts) -> dict[str, Any]:
    """Return what `stiction diagnose` finds, and what its model leaves."""
    found = diagnose(parts.fit, parts.arm, link_side=True)
    model = model_of(found)
    left = {}
    for name in ("fit", "held_out", "check"):
        data = assemble(parts.arm, parts.signals(getattr(parts, name)), link_side=True)
        left[name] = np.sqrt(np.mean(np.square(model.extend(data).residual), axis=0)).tolist()
    causes = ", ".join(f"{c.name} ({joints(c.joints)})" for c in found.causes)
    bound = sum(e.on_bound for c in found.causes for p in c.parameters.values() for e in p.values())
    confused = sum(bool(c.confused_with) for c in found.causes)
    return {
        "rms": left,
        "causes": f"{len(found.causes)} by name: {causes}",
        "trust": f"verdict: {found.verdict}; intervals of all parameters, {bound} on a bound; "
        f"{confused} causes told to be confused with others, with the motion that tells them apart",
    }


def peer(kind: Any) -> Callable[[Parts], dict[str, Any]]:
    """Return what runs a peer."""

    def run(parts: Parts) -> dict[str, Any]:
        whole = parts.signals(parts.fit)
        seconds = sum(len(s.t) for s in whole.segments) * whole.dt
        rows = max(ROWS, int(OVERSAMPLED * whole.cutoff_hz * seconds))
        given = parts.signals(parts.fit, rows)
        model = kind(parts.arm, list(given.segments), given.dt)
        return {"rms": rms(parts, model), **model.says()}

    return run


TOOLS: dict[str, tuple[str, Callable[[Parts], dict[str, Any]]]] = {
    "published masses": ("", lambda parts: {"rms": rms(parts, Rigid(parts.arm))}),
    "stiction diagnose": ("", ours),
    "mujoco.sysid": ("absl", peer(_peers_sysid.Sysid)),
    "FIGAROH": ("figaroh", peer(_peers_figaroh.Figaroh)),
}
"""By name: the package that must be there, and what runs it."""


def lines_typed() -> dict[str, int]:
    """Return the lines of code that a user types: those of the fit here, with configurations."""

    def count(*things: Any) -> int:
        text = "".join(inspect.getsource(x) for x in things)
        return sum(bool(x.strip()) and not x.strip().startswith("#") for x in text.splitlines())

    return {
        "stiction diagnose": 1,
        "mujoco.sysid": count(
            _peers_sysid.Sysid.__init__, _peers_sysid._setter, _peers_sysid._windows
        ),
        "FIGAROH": count(_peers_figaroh.Figaroh.__init__, _peers_figaroh._config),
    }


def study(names: list[str], work: Path) -> dict[str, dict[str, dict[str, Any]]]:
    """Run what is not yet on disk."""
    code = hashlib.sha256()
    for path in [
        *sorted(HERE.glob("*peers*.py")),
        *sorted(HERE.parent.glob("stiction_envs/gap/**/*")),
    ]:
        if path.suffix in (".py", ".toml"):
            code.update(path.read_bytes())
    rows: dict[str, dict[str, dict[str, Any]]] = {}
    for name in names:
        parts = None
        for tool, (package, run) in TOOLS.items():
            if package and importlib.util.find_spec(package) is None:
                print(f"skipped: {tool} is not installed: pip install .[peers]")
                continue
            path = work / f"{name}_{tool.replace(' ', '_')}.json"
            row = json.loads(path.read_text()) if path.exists() else {}
            if row.get("code") != code.hexdigest():
                parts = parts or CASES[name]()
                unit = reference_loop()
                start = time.perf_counter()
                row = run(parts)
                row |= {"seconds": time.perf_counter() - start, "unit": unit, "what": parts.what}
                row["code"] = code.hexdigest()
                path.write_text(json.dumps(row))
            rows.setdefault(name, {})[tool] = row
            print(name, tool, f"{row['seconds']:.1f} s", np.round(row["rms"]["held_out"], 3))
    return rows


def page(rows: dict[str, dict[str, dict[str, Any]]]) -> str:
    """Return the page."""
    lines = lines_typed()
    out = [
        "# The same real logs through this tool, mujoco.sysid and FIGAROH",
        "",
        f"Written by `python benchmarks/peers.py`: MuJoCo {version('mujoco')}, FIGAROH "
        f"{version('figaroh')}, Python {platform.python_version()}. Root mean square of the torque "
        "that each model leaves [N·m], by inverse dynamics along the measured motion; every tool "
        "has the same filtered signals. `mujoco.sysid` is given mass and centre of every link, "
        "damping, friction loss and armature of every joint, and rollouts of "
        f"{_peers_sysid.WINDOW:g} s from measured states ({_peers_sysid.MOST} of them, "
        f"{_peers_sysid.ITERATIONS} iterations at most). FIGAROH fits its base parameters with "
        "friction, rotor inertia and offsets by weighted least squares. Neither looks for causes: "
        "they fit what the user lists. FIGAROH needs no published masses.",
    ]
    for name, tools in rows.items():
        fit, held, check = next(iter(tools.values()))["what"]
        out += ["", f"## {name}", "", f"Identified from {fit}; held out: {held}; check: {check}."]
        n = len(next(iter(tools.values()))["rms"]["fit"])
        for key, title in (("held_out", "Held out"), ("check", "Check")):
            table = []
            best = np.min([t["rms"][key] for t in tools.values()], axis=0)
            for tool, row in tools.items():
                shown = [
                    f"**{x:.3f}**" if x <= y else f"{x:.3f}"
                    for x, y in zip(row["rms"][key], best, strict=True)
                ]
                table.append([tool, *shown, f"{np.mean(row['rms'][key]):.3f}"])
            header = [title, *(f"joint {j}" for j in range(1, n + 1)), "mean"]
            out += ["", table_text(header, table)]
        table = [
            [
                tool,
                row.get("causes", "none"),
                row.get("trust", "nothing"),
                f"{row['seconds']:.0f} s ({row['seconds'] / row['unit']:.0f})",
                str(lines.get(tool, 0)),
            ]
            for tool, row in tools.items()
            if "causes" in row
        ]
        header = ["", "what it says of causes", "of trust", "time (over a reference loop)", "lines"]
        out += ["", table_text(header, table)]
    return "\n".join(out) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=list(CASES), help="cases; no page is written")
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "peers")
    parser.add_argument("--out", type=Path, default=HERE)
    args = parser.parse_args()
    if not (MEASURED / PANDA).is_file():
        print(f"skipped: the measured logs are not in {MEASURED}")
        return
    args.work.mkdir(parents=True, exist_ok=True)
    rows = study(args.only or list(CASES), args.work)
    if args.only or any(len(x) < len(TOOLS) for x in rows.values()):
        print("not every case was run: no page is written")
        return
    write_text_atomic(args.out / "peers.md", page(rows))
    print(f"written to {args.out / 'peers.md'}")


if __name__ == "__main__":
    main()
