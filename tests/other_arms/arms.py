"""Arms of `example-robot-data`, and command lines on them as a user would type them.

What is written by one command (`model.xml`, `trajectory.csv`) is read by the next.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np

from benchmarks.accuracy.imperfect_arms import perturbed, presliding
from stiction_envs.hidden.examples import log_csv
from stiction_envs.hidden.worlds import inverse_torque
from stiction_envs.robots import Arm, load_arm
from tests.command_line import Ran

WHEEL = "example-robot-data"
ROBOTS = "cmeel.prefix/share/example-robot-data/robots"


ARMS: dict[str, tuple[str, tuple[str, str] | None]] = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", None),
    "ur3_gripper": ("ur_description/urdf/ur3_gripper.urdf", None),
    "kinova": ("kinova_description/robots/kinova.urdf", None),
    "panda_collision": ("panda_description/urdf/panda_collision.urdf", None),
    "talos_left_arm": ("talos_data/robots/talos_left_arm.urdf", None),
    "double_pendulum": ("double_pendulum_description/urdf/double_pendulum.urdf", None),
    "anymal-kinova": (
        "anymal_b_simple_description/robots/anymal-kinova.urdf",
        ("j2s6s200_link_base", "j2s6s200_end_effector"),
    ),
    "b1-z1": ("b1_description/urdf/b1-z1.urdf", ("link00", "gripperStator")),
    "baxter": ("baxter_description/urdf/baxter.urdf", ("torso", "left_gripper")),
}
"""File, and the links at base and tip of the arm that is taken out of a bigger robot."""


def file_of(name: str) -> Path:
    """Return a robot's file.

    Raises:
        importlib.metadata.PackageNotFoundError: the wheel is not installed.
    """
    return Path(str(metadata.distribution(WHEEL).locate_file(ROBOTS))) / ARMS[name][0]


def log_of(arm: Arm, trajectory: Path, log: Path, rate: float = 100.0) -> None:
    """Write what an arm with other links and with friction would log on the way of a trajectory.

    Friction is a share of the torque limits that differs by joint, so that it is no gain of the
    file's own; the links are those of `imperfect_arms.perturbed`.
    """
    way = np.loadtxt(trajectory, delimiter=",", skiprows=1)
    step = max(1, round(1 / rate / (way[1, 0] - way[0, 0])))
    ddq = np.gradient(way[:, 1 + arm.n :], way[:, 0], axis=0)[::step]
    t, q, dq = way[::step, 0], way[::step, 1 : 1 + arm.n], way[::step, 1 + arm.n :]
    rng = np.random.default_rng(0)
    dry = 0.02 * np.minimum(arm.limits.torque, 100.0) * np.linspace(0.7, 1.3, arm.n)
    tau = (
        inverse_torque(perturbed(arm, 0.05, 1).model(), q, dq, ddq)
        + dry * presliding(q, 1e-9)
        + 0.3 * dry * dq
    )
    tau += 0.02 * dry * rng.normal(size=q.shape)
    seen = q + 1e-5 * rng.normal(size=q.shape)
    log.write_text(log_csv(t, digits=9, q=seen, dq=dq, tau=tau))


@dataclass(frozen=True)
class Case:
    """A robot, and its runs in the working folder."""

    name: str
    cli: Callable[..., Ran]

    @property
    def robot(self) -> list[object]:
        """Arguments that name the arm."""
        chain = ARMS[self.name][1]
        return [file_of(self.name), *(["--chain", *chain] if chain else [])]

    def run(self, command: str, *more: object) -> Ran:
        """Run a command into a folder of its name; after `excite`, write what the arm would log."""
        once = ["--iterations", 1, "--no-scatter"]
        log = ["log.csv", "--robot", *self.robot]
        words: dict[str, list[object]] = {
            "conformance": ["export/model.xml"],
            "sje": [*self.robot, *once],
            "gte": [*self.robot, "--trajectory", "triangle", "--stiffness", 200, 20, 0, *once],
            "tune": [*self.robot, "--frequencies", 15, 30, "--scales", 1.0, *once],
            "excite": [*self.robot, "--sweeps", "--rate", 200],
            "identify": log,
            "diagnose": log,
        }
        arguments = words.get(command, self.robot)
        ran = self.cli(command, *arguments, *more, "--out", command, "--force")
        if command == "excite" and ran.code == 0:
            arm = load_arm(file_of(self.name), chain=ARMS[self.name][1])
            log_of(arm, Path("excite/trajectory.csv"), Path("log.csv"))
        return ran

    def done(self, command: str, *more: object) -> None:
        """Run a command; it must come out."""
        ran = self.run(command, *more)
        assert ran.code == 0, f"{self.name}, {command}: {ran.err}"

    def exports(self, command: str) -> None:
        """Export the model that a command has written."""
        ran = self.cli("export", f"{command}/model.xml", "--out", f"export-{command}")
        assert ran.code == 0, f"{self.name}, model.xml of {command}: {ran.err}"
