"""Options of `diagnose`: which fit a kind of data, and what identifies a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypedDict

from stiction_envs.errors import StictionError, unknown
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.model_file import Nominal
from stiction_envs.measured.kinds import TABLE, file_kind
from stiction_envs.measured.logs.joint_names import Reading
from stiction_envs.measured.logs.robot_log import RobotLog
from stiction_envs.measured.logs.sources import Log, LogSources, log_sources
from stiction_envs.reporting.provenance import Provenance, provenance
from stiction_envs.robots import Arm
from stiction_envs.robots.registry import robot_files

TABLES, SERVO_LOGS, JOINT_LOGS = "torque tables", "servo logs", "joint logs"
"""Kinds of data."""
OF_SERVOS: tuple[Literal["servo_stiffness", "same_servo", "servo_damping"], ...] = (
    *("servo_stiffness", "same_servo", "servo_damping"),
)
"""Options of servo logs."""


class Origin(TypedDict):
    """Fields of `DiagnosisResult` that say what it was made from."""

    nominal_name: str
    sources: LogSources
    provenance: Provenance
    threads: int


class LogOptions(Reading, total=False):
    """Options of a diagnosis that a rehearsal takes too."""

    torque: str | None
    """Side of the gear on which a log's torque was measured, "motor" or "link"; None takes what the
    log says (those of libfranka, franka_ros, iiwa_ros: link), else motor."""
    nominal: str | Path | FrictionParameters | Nominal | None
    """The simulation to judge: "rigid", "file" (with friction, springs and gravity compensation of
    the robot's own file), "shipped" (with our friction), a TOML (friction, or an earlier
    ``model.toml``), or parameters; None for `diagnose.default_nominal`."""
    drive: str | None
    """Drive of the joints, "torque" or "position"; None takes the drive that a log shows, and
    torque where it shows both."""
    servo_stiffness: Sequence[float] | None
    """Stiffness of position servos [N·m/rad], one or one per joint; None where unknown: the
    simulation that is judged then follows its commands exactly."""
    servo_damping: Sequence[float] | None
    """Damping of position servos [N·m·s/rad]; None where unknown: it is fitted and not judged."""
    same_servo: bool
    """Whether all joints have the same servo, so that those without gravity get the stiffness of
    the others."""
    payload: Sequence[float] | None
    """Known mass [kg] and its centre of mass x, y, z [m] in the flange frame; None for that of an
    earlier diagnosis, or none. What that diagnosis found is added to it."""
    tilt: Sequence[float] | None
    """Known roll and pitch of the base [rad]; None as for ``payload``."""
    chain: Sequence[str] | None
    """Links at the base and the tip of the arm in a file of a bigger robot."""
    cutoff_hz: float | None
    """Bandwidth of a log's zero-phase filter [Hz]; None chooses it from the data."""
    seed: int
    """Seed of the bootstrap."""


DEFAULTS: LogOptions = {
    "joints": (),
    "topic": None,
    "units": None,
    "calibration": None,
    "columns": (),
    "torque": None,
    "nominal": None,
    "drive": None,
    "servo_stiffness": None,
    "servo_damping": None,
    "same_servo": False,
    "payload": None,
    "tilt": None,
    "chain": None,
    "cutoff_hz": None,
    "seed": 0,
}


def checked(options: LogOptions) -> LogOptions:
    """Return all options, with defaults for those that are not given.

    Raises:
        StictionError: an option that does not exist.
    """
    for name in options:
        if name not in DEFAULTS:
            raise unknown("option", name, DEFAULTS)
    return {**DEFAULTS, **options}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Arguments of `diagnose`."""

    given: list[Log]
    """Argument ``data`` of `diagnose`, as a list."""
    check: list[Log]
    poses: Sequence[str | Path]
    robot: str | Path | Arm
    nominal: str | Path | FrictionParameters | Nominal
    """Nominal model of `more`, or the default."""
    more: LogOptions
    """All other options."""
    threads: int
    progress: Callable[[str, float], None] | None

    def refuse_unfit(self, kind: str) -> None:
        """Raise a StictionError for an option that the kind of data does not take."""
        of_torque = {"poses": bool(self.poses), "cutoff": self.more["cutoff_hz"] is not None}
        if kind == SERVO_LOGS:
            used = of_torque | {"torque": self.more["torque"] is not None}
            _refuse(used, "joint logs (tau1..n)")
        else:
            used = {k.replace("_", " "): bool(self.more[k]) for k in OF_SERVOS}
            _refuse(used, "servo logs (q_cmd1..n)")
        if kind == TABLES:
            used = {"torque": self.more["torque"] == "link"} | of_torque
            used |= {"check": bool(self.check), "joints": bool(self.more["joints"])}
            used |= {"topic": self.more["topic"] is not None}
            _refuse(used, "joint logs", f"{self.given[0]} is a torque table: ")
        for table in (x for x in self.check if isinstance(x, str | Path) and file_kind(x) == TABLE):
            raise StictionError(f"check: {table} is a torque table: expected joint logs")

    def identify(self, arm: Arm, side: str) -> Origin:
        """Return the fields of `DiagnosisResult` that say what it was made from.

        Args:
            arm: the robot, loaded.
            side: of the gear on which torques were measured, "motor" or "link".
        """
        sources = log_sources([*self.given, *self.poses]) | log_sources(self.check, "check")
        arguments = self._arguments(arm, side) | sources.in_memory
        inputs = sources.files | self._files()
        nominal = self.nominal
        return {
            "nominal_name": Path(nominal).name if isinstance(nominal, str | Path) else "given",
            "sources": sources,
            "provenance": provenance("diagnose", arguments, seed=self.more["seed"], inputs=inputs),
            "threads": self.threads,
        }

    def _arguments(self, arm: Arm, side: str) -> dict[str, object]:
        """Return what changes the result."""
        more: dict[str, object] = {**self.more}
        del more["seed"]  # is recorded by itself
        cutoff = more.pop("cutoff_hz")
        file = self.more["calibration"]
        return more | {
            "logs": [_name(x) for x in self.given],
            "check": [_name(x) for x in self.check],
            "poses": self.poses,
            "robot": arm.name if isinstance(self.robot, Arm) else self.robot,
            "torque": side,
            "calibration": None if file is None else str(file),
            "cutoff": cutoff,
            "nominal": self.nominal if isinstance(self.nominal, str | Path) else "parameters",
        }

    def _files(self) -> dict[str, Path]:
        """Return the files besides logs that change the result."""
        files = {} if isinstance(self.robot, Arm) else robot_files(self.robot)
        if (calibration := self.more["calibration"]) is not None:
            files["calibration"] = Path(calibration)
        if isinstance(self.nominal, str | Path) and Path(self.nominal).is_file():
            files["nominal"] = Path(self.nominal)
        return files


def _refuse(used: dict[str, bool], expected: str, why: str = "") -> None:
    for option in (k for k, is_used in used.items() if is_used):
        raise StictionError(f"{option}: {why}expected {expected}")


def _name(log: Log) -> str:
    return log.source if isinstance(log, RobotLog) else str(log)
