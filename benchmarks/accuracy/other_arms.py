"""Other people's arms: every command on arms of `example-robot-data`.

    python -m benchmarks.accuracy.other_arms [--arms ur5 z1 …] [--commands sje gte …]

One command line after the other, in one process, as a user would type them: what is written by one
(`model.xml`, `trajectory.csv`) is read by the next. Rows of arms that are not run stay on the page.
`tests/other_arms` runs the same with short settings.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np

from benchmarks.harness import Benchmark, Row, machine
from benchmarks.reference_loop import USUAL_S, seconds
from stiction_envs.cli import main as stiction
from stiction_envs.hidden.excited_logs import direction, perturbed, torque
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.templates import render
from stiction_envs.robots import Arm, load_arm

STUDY = Benchmark(__file__, __doc__)
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


def kept(path: Path) -> dict[str, Row]:
    """Return the rows of earlier runs by arm: the reference loop [s], and what came of commands."""
    return json.loads(path.read_text("utf-8")) if path.exists() else {}


def keep(path: Path, rows: Mapping[str, Row]) -> None:
    """Write the rows, one line each, in the order of `ARMS`."""
    lines = [
        f"{json.dumps(x)}: {json.dumps(rows[x], ensure_ascii=False)}" for x in ARMS if x in rows
    ]
    write_text_atomic(path, "{\n" + ",\n".join(lines) + "\n}\n")


def page(rows: Mapping[str, Row]) -> str:
    """Return the page: an arm in a row, seconds of what was done, a number for what failed."""
    notes: list[str] = []
    lines = []
    for name in (x for x in ARMS if x in rows):
        chain = ARMS[name].chain
        shown = name if chain is None else f"{name} `--chain {' '.join(chain)}`"
        cells = [shown, f"{rows[name]['loop']:.1f}"]
        for command in COMMANDS:
            came = rows[name]["commands"].get(command)
            if came is not None and came["code"]:
                notes.append(f"{name}, {command} (exit code {came['code']}): {came['said']}")
                cells.append(f"failed ({len(notes)})")
            else:
                cells.append("" if came is None else f"{came['seconds']:.1f}")
        lines.append(cells)
    ran = [came for row in rows.values() for came in row["commands"].values() if came is not None]
    return render(
        STUDY.folder / "other_arms.md.j2",
        command=STUDY.command,
        done=sum(came["code"] == 0 for came in ran),
        ran=len(ran),
        arms=len(rows),
        table=table_text(["arm", "reference loop", *COMMANDS], lines),
        notes=notes,
        wheel=f"{WHEEL} {metadata.version(WHEEL)}",
        machine=machine(),
        usual=USUAL_S,
    )


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--arms", nargs="+", choices=tuple(ARMS), default=list(ARMS))
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    options = parser.parse_args()
    path, loop = STUDY.folder / "other_arms.json", seconds()
    rows = kept(path)
    for name in options.arms:
        case = Case(name, options.work)
        came: dict[str, Row | None] = {}
        for command in options.commands:
            reads = case.reads(command)
            one = case.run(command) if reads is None or reads.exists() else None
            came[command] = None if one is None else dataclasses.asdict(one)
            print(f"{name}, {command}: {one or 'nothing to read'}", flush=True)
        rows[name] = {"loop": loop, "commands": came}
        keep(path, rows)
    STUDY.write_page(options, page(rows))


if __name__ == "__main__":
    main()
