"""Arms of `example-robot-data`, and command lines on them as a user would type them.

What is written by one command (`model.xml`, `trajectory.csv`) is read by the next.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np

from stiction_envs.cli import main as stiction
from stiction_envs.hidden.excited_logs import direction, perturbed
from stiction_envs.hidden.worlds import inverse_torque
from stiction_envs.robots import Arm, load_arm

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
    "ur3_gripper": Robot("ur_description/urdf/ur3_gripper.urdf"),
    "kinova": Robot("kinova_description/robots/kinova.urdf"),
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


def run(argv: Sequence[object]) -> Came:
    """Run a command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = stiction([str(a) for a in argv])
    said = [x for x in err.getvalue().splitlines() if x.startswith("error: ")]
    return Came(code, said[-1].removeprefix("error: ") if said else "")


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
    tau = (
        inverse_torque(perturbed(arm, 0.05, 1).model(), q, dq, ddq)
        + dry * direction(dq)
        + 0.3 * dry * dq
    )
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

    def argv(self, command: str) -> list[object]:
        """Return the command line."""
        robot, once = self.robot, ["--iterations", 1, "--no-scatter"]
        log = [self.at("log.csv"), "--robot", *robot]
        return {
            "export": ["export", *robot],
            "conformance": ["conformance", self.at("export", "model.xml")],
            "sje": ["sje", *robot, *once],
            "gte": ["gte", *robot, "--trajectory", "triangle", "--stiffness", 200, 20, 0, *once],
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
