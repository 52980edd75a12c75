"""Options of `diagnose`: which fit a kind of data, and what identifies a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from stiction_envs.errors import StictionError
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.settings import GapSettings
from stiction_envs.measured.kinds import TABLE, file_kind
from stiction_envs.measured.logs.robot_log import RobotLog
from stiction_envs.measured.logs.sources import Log, LogSources, log_sources
from stiction_envs.method_settings import Changes, fingerprint
from stiction_envs.reporting.provenance import Provenance, provenance
from stiction_envs.robots import Arm
from stiction_envs.robots.registry import robot_files

TABLES, SERVO_LOGS, JOINT_LOGS = "torque tables", "servo logs", "joint logs"
"""Kinds of data."""


class Origin(TypedDict):
    """Fields of `DiagnosisResult` that say what it was made from."""

    nominal_name: str
    sources: LogSources
    provenance: Provenance
    threads: int


class LogOptions(TypedDict, total=False):
    """Arguments of `diagnose` that a rehearsal takes too."""

    torque: str | None
    joints: Sequence[str]
    topic: str | None
    units: str | None
    calibration: str | Path | None
    columns: Sequence[str]
    nominal: str | Path | FrictionParameters | Nominal | None
    drive: str | None
    servo_stiffness: Sequence[float] | None
    servo_damping: Sequence[float] | None
    same_servo: bool
    payload: Sequence[float] | None
    tilt: Sequence[float] | None
    chain: Sequence[str] | None
    cutoff_hz: float | None
    seed: int
    settings: GapSettings | Changes | None


@dataclass(frozen=True, kw_only=True)
class Options:
    """Arguments of `diagnose`, which describes them."""

    given: list[Log]
    """Its ``data``, as a list."""
    check: list[Log]
    robot: str | Path | Arm
    torque: str | None
    joints: Sequence[str]
    topic: str | None
    units: str | None
    calibration: str | Path | None
    columns: Sequence[str]
    nominal: str | Path | FrictionParameters | Nominal
    poses: Sequence[str | Path]
    drive: str | None
    servo_stiffness: Sequence[float] | None
    servo_damping: Sequence[float] | None
    same_servo: bool
    payload: Sequence[float] | None
    tilt: Sequence[float] | None
    chain: Sequence[str] | None
    cutoff_hz: float | None
    seed: int
    threads: int
    progress: Callable[[str, float], None] | None
    settings: GapSettings | Changes | None

    def refuse_unfit(self, kind: str) -> None:
        """Raise a StictionError for an option that the kind of data does not take."""
        if kind == SERVO_LOGS:
            _refuse(self._of_torque() | {"torque": self.torque is not None}, "joint logs (tau1..n)")
        else:
            _refuse(self._of_servos(), "servo logs (q_cmd1..n)")
        if kind == TABLES:
            used = {"torque": self.torque == "link"} | self._of_torque()
            used |= {"check": bool(self.check), "joints": bool(self.joints)}
            used |= {"topic": self.topic is not None}
            _refuse(used, "joint logs", f"{self.given[0]} is a torque table: ")
        for table in (x for x in self.check if isinstance(x, str | Path) and file_kind(x) == TABLE):
            raise StictionError(f"check: {table} is a torque table: expected joint logs")

    def _of_torque(self) -> dict[str, bool]:
        """Return by name which options of logs with torque are used, but for its side."""
        return {
            "poses": bool(self.poses),
            "cutoff": self.cutoff_hz is not None,
        }

    def _of_servos(self) -> dict[str, bool]:
        """Return by name which options of servo logs are used."""
        return {
            "servo stiffness": self.servo_stiffness is not None,
            "same servo": self.same_servo,
            "servo damping": self.servo_damping is not None,
        }

    def identify(self, arm: Arm, side: str, settings: GapSettings) -> Origin:
        """Return the fields of `DiagnosisResult` that say what it was made from.

        Args:
            arm: the robot, loaded.
            side: of the gear on which torques were measured, "motor" or "link".
            settings: all constants of the method.
        """
        sources = log_sources([*self.given, *self.poses]) | log_sources(self.check, "check")
        arguments = self._arguments(arm, side, settings) | sources.in_memory
        inputs = sources.files | self._files()
        nominal = self.nominal
        return {
            "nominal_name": Path(nominal).name if isinstance(nominal, str | Path) else "given",
            "sources": sources,
            "provenance": provenance("diagnose", arguments, seed=self.seed, inputs=inputs),
            "threads": self.threads,
        }

    def _arguments(self, arm: Arm, side: str, settings: GapSettings) -> dict[str, object]:
        """Return what changes the result."""
        return {
            "logs": [_name(x) for x in self.given],
            "check": [_name(x) for x in self.check],
            "robot": arm.name if isinstance(self.robot, Arm) else self.robot,
            "chain": self.chain,
            "torque": side,
            "drive": self.drive,
            "joints": self.joints,
            "topic": self.topic,
            "units": self.units,
            "calibration": None if self.calibration is None else str(self.calibration),
            "columns": self.columns,
            "cutoff": self.cutoff_hz,
            "poses": self.poses,
            "nominal": self.nominal if isinstance(self.nominal, str | Path) else "parameters",
            "servo_stiffness": self.servo_stiffness,
            "servo_damping": self.servo_damping,
            "same_servo": self.same_servo,
            "payload": self.payload,
            "tilt": self.tilt,
            "settings": None if self.settings is None else fingerprint(settings),
        }

    def _files(self) -> dict[str, Path]:
        """Return the files besides logs that change the result."""
        files = {} if isinstance(self.robot, Arm) else robot_files(self.robot)
        if self.calibration is not None:
            files["calibration"] = Path(self.calibration)
        if isinstance(self.nominal, str | Path) and Path(self.nominal).is_file():
            files["nominal"] = Path(self.nominal)
        return files


def _refuse(used: dict[str, bool], expected: str, why: str = "") -> None:
    for option in (k for k, is_used in used.items() if is_used):
        raise StictionError(f"{option}: {why}expected {expected}")


def _name(log: Log) -> str:
    return log.source if isinstance(log, RobotLog) else str(log)
