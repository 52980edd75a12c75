"""Other people's arms: every command on arms of `example-robot-data`; page beside this file.

    python -m benchmarks.other_arms [--arms ur5 z1 …] [--commands sje gte …]

One command line after the other, in one process, as a user would type them: what is written by one
(`model.xml`, `trajectory.csv`) is read by the next. The logs that `identify` and `diagnose` read
are simulated: the motion that `excite` planned, on an arm with other links and with friction. Rows
of arms that are not run stay on the page.
`tests/other_arms` runs the same with short settings.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.reference_loop import USUAL_S, seconds
from stiction_envs.cli import main as stiction
from stiction_envs.reporting.markdown import table
from stiction_envs.robots import Arm, load_arm
from stiction_envs.testing.excited_logs import direction, perturbed, torque

HERE = Path(__file__).parent
WHEEL = "example-robot-data"
ROBOTS = "cmeel.prefix/share/example-robot-data/robots"


@dataclass(frozen=True)
class Robot:
    """A robot of the wheel."""

    file: str
    chain: tuple[str, str] | None = None
    """Links at the base and the tip of the arm that is taken out of it; None where it is one."""


ARMS = {
    "ur5": Robot("ur_description/urdf/ur5_robot.urdf"),
    "ur10": Robot("ur_description/urdf/ur10_robot.urdf"),
    "ur3": Robot("ur_description/urdf/ur3_robot.urdf"),
    "ur3_gripper": Robot("ur_description/urdf/ur3_gripper.urdf"),
    "kinova": Robot("kinova_description/robots/kinova.urdf"),
    "xarm7": Robot("xarm_description/urdf/xarm7.urdf"),
    "z1": Robot("z1_description/urdf/z1.urdf"),
    "panda": Robot("panda_description/urdf/panda.urdf"),
    "panda_collision": Robot("panda_description/urdf/panda_collision.urdf"),
    "talos_left_arm": Robot("talos_data/robots/talos_left_arm.urdf"),
    "double_pendulum": Robot("double_pendulum_description/urdf/double_pendulum.urdf"),
    "anymal-kinova": Robot(
        "anymal_b_simple_description/robots/anymal-kinova.urdf",
        ("j2s6s200_link_base", "j2s6s200_end_effector"),
    ),
    "b1-z1": Robot("b1_description/urdf/b1-z1.urdf", ("link00", "gripperStator")),
    "baxter": Robot("baxter_description/urdf/baxter.urdf", ("torso", "left_gripper")),
}
"""Serial arms, and arms of bigger robots."""


def folder() -> Path:
    """Return where the wheel's robots are.

    Raises:
        importlib.metadata.PackageNotFoundError: it is not installed.
    """
    return Path(str(metadata.distribution(WHEEL).locate_file(ROBOTS)))


@dataclass(frozen=True)
class Came:
    """What came of a command line."""

    code: int
    """Exit code."""
    said: str
    """Last line on standard error; of a command that was done the empty text."""
    seconds: float


def run(argv: Sequence[object]) -> Came:
    """Run a command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    began = time.perf_counter()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = stiction([str(a) for a in argv])
    said = [x for x in err.getvalue().splitlines() if x.startswith("error: ")]
    return Came(code, said[-1].removeprefix("error: ") if said else "", time.perf_counter() - began)


def log_of(arm: Arm, trajectory: Path, log: Path, rate: float = 100.0) -> None:
    """Write what an arm with other links and with friction would log on the way of a trajectory.

    Friction is a share of the torque limits, the links are those of `excited_logs.perturbed`.
    """
    way = np.loadtxt(trajectory, delimiter=",", skiprows=1)
    step = max(1, round(1 / rate / (way[1, 0] - way[0, 0])))
    ddq = np.gradient(way[:, 1 + arm.n :], way[:, 0], axis=0)[::step]
    t, q, dq = way[::step, 0], way[::step, 1 : 1 + arm.n], way[::step, 1 + arm.n :]
    rng = np.random.default_rng(0)
    dry = 0.02 * np.minimum(arm.limits.torque, 100.0)
    tau = torque(perturbed(arm, 0.05, 1), q, dq, ddq) + dry * direction(dq) + 0.3 * dry * dq
    tau += 0.02 * dry * rng.normal(size=q.shape)
    joints = range(1, arm.n + 1)
    head = ["t", *(f"{x}{j}" for x in ("q", "dq", "tau") for j in joints)]
    rows = np.column_stack([t, q + 1e-5 * rng.normal(size=q.shape), dq, tau])
    np.savetxt(log, rows, fmt="%.9g", delimiter=",", header=",".join(head), comments="")


@dataclass(frozen=True)
class Case:
    """A robot and where its runs are."""

    name: str
    work: Path

    @property
    def robot(self) -> list[object]:
        """Arguments that name the arm."""
        found = ARMS[self.name]
        chain = [] if found.chain is None else ["--chain", *found.chain]
        return [folder() / found.file, *chain]

    def at(self, *place: str) -> Path:
        """A file or folder of this robot's."""
        return self.work.joinpath(self.name, *place)

    def reads(self, command: str) -> Path | None:
        """Return what a command reads of those before it."""
        if command.endswith("model.xml"):
            return self.at(command.split()[-2].removesuffix("'s"), "model.xml")
        found = {
            "conformance": ("export", "model.xml"),
            "identify": ("log.csv",),
            "diagnose": ("log.csv",),
            "sje of the diagnosis": ("diagnose", "model.toml"),
        }.get(command)
        return None if found is None else self.at(*found)

    def argv(self, command: str) -> list[object]:
        """Return the command line."""
        robot, once = self.robot, ["--iterations", 1, "--no-scatter"]
        log = [self.at("log.csv"), "--robot", *robot]
        return {
            "export": ["export", *robot],
            "conformance": ["conformance", self.at("export", "model.xml")],
            "sje": ["sje", *robot, *once],
            "gte": ["gte", *robot, "--trajectory", "triangle", *STIFFNESS, *once],
            "tune": ["tune", *robot, "--frequencies", 15, 30, "--scales", 1.0, *once],
            "excite": ["excite", *robot, "--sweeps", "--rate", 200],
            "identify": ["identify", *log],
            "diagnose": ["diagnose", *log],
            "sje of the diagnosis": [
                *["sje", *robot, "--joint", 1, *once],
                *["--friction", self.at("diagnose", "model.toml")],
            ],
            **{
                f"export of {x}'s model.xml": ["export", self.at(x, "model.xml")]
                for x in ("export", "identify", "diagnose")
            },
        }[command]

    def run(self, command: str, *more: object) -> Came:
        """Run a command, with other options too."""
        out = self.at(command.replace(" ", "_").replace("'", ""))
        came = run([*self.argv(command), *more, "--out", out, "--force"])
        if command == "excite" and came.code == 0:
            arm = load_arm(folder() / ARMS[self.name].file, chain=ARMS[self.name].chain)
            log_of(arm, out / "trajectory.csv", self.at("log.csv"))
        return came


STIFFNESS = ("--stiffness", 200, 20, 0)
COMMANDS = (
    *("export", "conformance", "sje", "gte", "tune", "excite", "identify", "diagnose"),
    *("sje of the diagnosis", "export of export's model.xml"),
    *("export of identify's model.xml", "export of diagnose's model.xml"),
)
"""In the order in which one reads what another wrote."""


@dataclass(frozen=True)
class Row:
    """What the page says of an arm."""

    loop: str
    """Seconds of the reference loop before the run that it is of."""
    cells: Mapping[str, str]
    """By command: seconds, why it did not come out, or nothing where it had nothing to read."""


def row(came: Mapping[str, Came | None], loop: float) -> Row:
    """Return an arm's row; None is a command that had nothing to read."""
    cells = {}
    for command, one in came.items():
        if one is None:
            cells[command] = ""
        else:
            cells[command] = f"{one.seconds:.1f}" if one.code == 0 else f"{one.code}: {one.said}"
    return Row(f"{loop:.1f}", cells)


def kept(text: str) -> dict[str, Row]:
    """Return the rows of a page that was written before."""
    found = re.findall(NOTE, text, re.MULTILINE)
    notes = {f"no ({k})": f"{code}: {said}" for k, code, said in found}
    rows = [[x.strip() for x in line.split("|")[1:-1]] for line in text.splitlines() if "|" in line]
    if not rows:
        return {}
    head, _, *body = rows
    return {
        name.split()[0]: Row(
            loop, {c: notes.get(x, x) for c, x in zip(head[2:], cells, strict=True)}
        )
        for name, loop, *cells in body
    }


NOTE = r"^\((\d+)\) \S+, [^:]* \(exit code (\d+)\): (.*)$"


def page(rows: Mapping[str, Row]) -> str:
    """Return the page: an arm in a row, seconds of what came out, a number for what did not."""
    commands = [c for c in COMMANDS if any(c in row.cells for row in rows.values())]
    notes: list[str] = []
    lines = []
    for name in (x for x in ARMS if x in rows):
        chain = ARMS[name].chain
        cells = [name if chain is None else f"{name} `--chain {' '.join(chain)}`", rows[name].loop]
        for command in commands:
            cell = rows[name].cells.get(command, "")
            if ": " in cell:
                code, said = cell.split(": ", 1)
                notes.append(f"{name}, {command} (exit code {code}): {said}")
                cell = f"no ({len(notes)})"
            cells.append(cell)
        lines.append(cells)
    head = [
        "# Other people's arms",
        "",
        f"Written by `python -m benchmarks.other_arms`: robots of {WHEEL} "
        f"{metadata.version(WHEEL)}, MuJoCo {mujoco.__version__}, {os.cpu_count()} processors. A "
        "number is the seconds of a command that came out (exit code 0), one after the other in "
        "one process; an empty field, that an earlier command wrote no file for it. The machine "
        "did other work besides, more in some rows; the reference loop, before the run that a row "
        f"is of, takes {USUAL_S} s on the quiet machine.",
        "",
        *table(["arm", "reference loop", *commands], lines),
        *(f"({k}) {note}\n" for k, note in enumerate(notes, 1)),
    ]
    return "\n".join(head).rstrip() + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", nargs="+", choices=tuple(ARMS), default=list(ARMS))
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    parser.add_argument("--work", type=Path, help="keep what is written here (default: nowhere)")
    args = parser.parse_args()
    out, loop = HERE / "other_arms.md", seconds()
    rows = kept(out.read_text(encoding="utf-8")) if out.exists() else {}
    with tempfile.TemporaryDirectory() as temporary:
        for name in args.arms:
            case = Case(name, args.work or Path(temporary))
            came: dict[str, Came | None] = {}
            for command in args.commands:
                reads = case.reads(command)
                one = came[command] = case.run(command) if reads is None or reads.exists() else None
                said = "nothing to read" if one is None else f"{one.seconds:.1f} s {one.said}"
                print(f"{name}, {command}: {said}", flush=True)
            rows[name] = row(came, loop)
            out.write_text(page(rows), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
