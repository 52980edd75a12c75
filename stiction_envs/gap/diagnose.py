"""`diagnose`: what a simulation gets wrong about measured joint logs or torque tables.

d = diagnose("log.csv", "panda", torque="link")
print(d)                       # verdict and causes
diagnose("log.csv", "panda", torque="link", check=["other.csv"])  # does its model hold there?
d.save("runs/why")             # diagnosis.json, report.html, model.xml, model.toml, plots
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from stiction_envs.errors import StictionError, unknown
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.gap.model_file import Nominal, nominal_of
from stiction_envs.gap.report.log_result import LogDiagnosis
from stiction_envs.gap.report.result import DiagnosisResult
from stiction_envs.gap.servo_logs import read_servo_files, servo_of, servo_result
from stiction_envs.gap.settings import GapSettings, gap_settings
from stiction_envs.gap.tables.from_files import diagnose_files
from stiction_envs.gap.validation.check import check_logs, check_model
from stiction_envs.measured.kinds import TABLE, file_kind
from stiction_envs.measured.logs.columns import POSITION, TORQUE
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.reader import JointLog, read_logs, read_poses
from stiction_envs.measured.logs.robot_log import RobotLog
from stiction_envs.measured.logs.servo_reader import drive_of
from stiction_envs.measured.logs.sources import Log, log_sources, torque_side
from stiction_envs.measured.settings import MotionThresholds
from stiction_envs.method_settings import Changes, fingerprint, override
from stiction_envs.reporting.provenance import provenance
from stiction_envs.robots import Arm
from stiction_envs.robots.registry import robot_files

METHODS = ("auto", "lsm")
"""The tool's result, or also the thesis's least squares (equation 3.1)."""


def diagnose(
    data: Log | Sequence[Log],
    robot: str | Path | Arm,
    *,
    torque: str | None = None,
    joints: Sequence[str] = (),
    topic: str | None = None,
    units: str | None = None,
    calibration: str | Path | None = None,
    nominal: str | Path | FrictionParameters | Nominal | None = None,
    poses: Sequence[str | Path] = (),
    check: Sequence[Log] = (),
    drive: str | None = None,
    servo_stiffness: Sequence[float] | None = None,
    servo_damping: Sequence[float] | None = None,
    same_servo: bool = False,
    payload: Sequence[float] | None = None,
    tilt: Sequence[float] | None = None,
    chain: Sequence[str] | None = None,
    cutoff_hz: float | None = None,
    method: str = "auto",
    seed: int = 0,
    threads: int = 0,
    progress: Callable[[str, float], None] | None = None,
    settings: GapSettings | Changes | None = None,
) -> DiagnosisResult:
    """Name what a simulation gets wrong about measurements of one robot.

    Joint logs (``t,q1..qn[,dq1..dqn],tau1..taun``, logs of libfranka, ROS bags), servo logs
    (``t,q_cmd1..q_cmdn,q1..qn``) and torque tables (the form of ``sje.csv``, base torques and
    dithered ones) are recognised by their content.

    Args:
        data: a file or several of one kind, or logs that were read.
        robot: name, model file or arm.
        torque: side of the gear on which a log's torque was measured, "motor" or "link"; None takes
            what the log says (those of libfranka, franka_ros, iiwa_ros: link), else motor.
        joints: names of joints 1 to n in ROS bags; () finds them (`measured.logs.joint_names`).
        topic: of ROS bags that have several with joint states.
        units: what angles are measured in: rad, deg, percent or ticks; None for rad, or what the
            log shows (`measured.logs.units`).
        calibration: lerobot's file with the ranges of the motors, for percent and ticks.
        nominal: the simulation to judge: "rigid" (default for logs), "shipped" (default for
            tables), a TOML (friction, or an earlier ``model.toml``), or parameters.
        poses: files of poses at rest without time, ``q1..qn,tau1..taun``; with logs or alone.
        check: logs that are not used for the diagnosis and test the finished model
            (`gap.validation.check`).
        drive: "torque" or "position", what drives the joints; None takes what a log has, and torque
            where it has both.
        servo_stiffness: of position servos [N·m/rad], one or one per joint; None where unknown:
            the simulation that is judged then follows its commands exactly.
        servo_damping: likewise [N·m·s/rad]; None where unknown: it is fitted and not judged.
        same_servo: all joints have the same servo, so that those without gravity get the stiffness
            of the others.
        payload: known mass [kg] and its centre of mass x, y, z [m] in the flange frame; None for
            that of an earlier diagnosis, or none. What that diagnosis found is added to it.
        tilt: known roll and pitch of the base [rad]; None as for ``payload``.
        chain: links at the base and the tip of the arm in a file of a bigger robot.
        cutoff_hz: bandwidth of a log's zero-phase filter; None chooses it from the data.
        method: "lsm" adds the thesis's least squares to a log's result.
        seed: of the bootstrap.
        threads: threads, 0 for all processors.
        progress: called with a stage and the part of it that is done.
        settings: constants of the method for logs that differ from ``settings.toml``: by name
            (``{"selection.chance": 0.02}``), a TOML file of them, or all.

    Returns:
        `LogDiagnosis`, `ServoResult` or `TableResult`: verdict, causes, ``save``.

    Raises:
        StictionError: files that cannot be read, do not fit the robot, or are of two kinds; logs to
            check with that show no joint that moved in the others, or were diagnosed too.
    """
    given = [data] if isinstance(data, str | Path | RobotLog) else list(data)
    check = [check] if isinstance(check, str | Path | RobotLog) else list(check)
    if not given and not poses:
        raise StictionError("no log given: expected one or more logs, or poses")
    torque_side(torque, ())  # report an invalid side first
    if method not in METHODS:
        raise unknown("method", method, METHODS)
    of_tables = _of_tables(given)
    naming = Naming(joints=tuple(joints), topic=topic, units=units, calibration=calibration)
    positions = not of_tables and _drive(given, drive, naming) == POSITION
    if positions:
        used = {"poses": bool(poses), "method": method != "auto", "cutoff": cutoff_hz is not None}
        used |= {"torque": torque is not None}
    else:
        used = {"servo stiffness": servo_stiffness is not None, "same servo": same_servo}
        used |= {"servo damping": servo_damping is not None}
    for option in (k for k, is_used in used.items() if is_used):
        what = "joint logs (tau1..n)" if positions else "servo logs (q_cmd1..n)"
        raise StictionError(f"{option}: expected {what}")
    nominal = default_nominal(given) if nominal is None else nominal
    if of_tables:
        used = {"torque": torque == "link", "poses": bool(poses), "method": method != "auto"}
        used |= {"cutoff": cutoff_hz is not None, "check": bool(check)}
        used |= {"joints": bool(joints), "topic": topic is not None}
        for option in (k for k, is_used in used.items() if is_used):
            raise StictionError(f"{option}: {given[0]} is a torque table: expected joint logs")
    for table in (x for x in check if isinstance(x, str | Path) and file_kind(x) == TABLE):
        raise StictionError(f"check: {table} is a torque table: expected joint logs")
    own = override(gap_settings(), settings)
    if isinstance(robot, Arm) and not (payload is tilt is chain is None):
        raise StictionError("payload, tilt, chain: expected in the arm, where an arm is given")
    arm, judged = nominal_of(
        robot, "rigid" if positions else nominal, payload=payload, tilt=tilt, chain=chain
    )
    if positions:
        if not isinstance(nominal, str | Path):
            raise StictionError("nominal: expected rigid or a model.toml for servo logs")
        known = servo_of(
            arm, nominal, stiffness=servo_stiffness, damping=servo_damping, same=same_servo
        )
    sources = log_sources([*given, *poses]) | log_sources(check, "check")
    naming = dataclasses.replace(naming, robot=arm.joint_names)
    # report problems of these logs before the long computation
    logs: list[JointLog] = []
    others: list[JointLog] = []
    side = "motor"
    if positions:
        commanded = read_servo_files(given, arm, naming, own.motion)
        unseen = read_servo_files(check, arm, naming, own.motion)
    elif not of_tables:
        logs = _read(given, poses, arm, naming, own.motion)
        others = _read(check, (), arm, naming, own.motion) if check else []
        side = torque_side(torque, [*logs, *others])
    arguments = {
        "logs": [str(x) if isinstance(x, str | Path) else x.source for x in given],
        "check": [str(x) if isinstance(x, str | Path) else x.source for x in check],
        "robot": arm.name if isinstance(robot, Arm) else robot,
        "torque": side,
        "joints": list(joints),
        "topic": topic,
        "cutoff": cutoff_hz,
        "poses": list(poses),
        "nominal": nominal if isinstance(nominal, str | Path) else "parameters",
        "payload": payload,
        "tilt": tilt,
        "method": method,
        **sources.in_memory,
    }
    given_too = {
        "drive": drive,
        "units": units,
        "calibration": None if calibration is None else str(calibration),
        "servo_stiffness": None if servo_stiffness is None else list(servo_stiffness),
        "servo_damping": None if servo_damping is None else list(servo_damping),
        "same_servo": same_servo or None,
    }
    arguments |= {k: v for k, v in given_too.items() if v is not None}
    if chain is not None:
        arguments["chain"] = list(chain)
    if settings is not None:
        arguments["settings"] = fingerprint(own)
    inputs = {**sources.files, **({} if isinstance(robot, Arm) else robot_files(robot))}
    if calibration is not None:
        inputs["calibration"] = Path(calibration)
    nominal_name = "given"
    if isinstance(nominal, str | Path):
        nominal_name = Path(nominal).name
        if Path(nominal).is_file():
            inputs["nominal"] = Path(nominal)
    shared: dict[str, Any] = {
        "nominal_name": nominal_name,
        "sources": sources,
        "provenance": provenance("diagnose", arguments, seed=seed, inputs=inputs),
        "threads": threads,
    }
    if of_tables:
        files = [x for x in given if isinstance(x, str | Path)]
        return diagnose_files(files, arm, judged, progress=progress, settings=own.tables, **shared)
    if positions:
        return servo_result(commanded, unseen, arm, known, progress=progress, **shared)
    to_check = check_logs(others, logs, arm, own, cutoff_hz=cutoff_hz) if others else None
    found = diagnose_logs(
        logs,
        arm,
        nominal=judged,
        torque=side,
        cutoff_hz=cutoff_hz,
        seed=seed,
        progress=progress,
        settings=own,
    )
    checked = None
    if to_check is not None:
        if progress is not None:
            progress("check", 0.0)
        checked = check_model(found, *to_check)
    return LogDiagnosis(
        diagnosis=found, torque=side, with_lines=method == "lsm", check=checked, **shared
    )


def default_nominal(data: Sequence[Log]) -> str:
    """Return the default nominal model: for logs the arm as most people simulate it.

    Joints without friction have no breakaway torque, so tables are compared with our friction.
    """
    return "shipped" if _of_tables(data) else "rigid"


def _of_tables(data: Sequence[Log]) -> bool:
    """Return whether the data are torque tables.

    Raises:
        StictionError: some are and some are not.
    """
    kinds = {file_kind(x): x for x in data if isinstance(x, str | Path)}
    if TABLE in kinds and (len(kinds) > 1 or any(isinstance(x, RobotLog) for x in data)):
        raise StictionError(
            f"{kinds[TABLE]} is a torque table, the others are joint logs: expected one kind"
        )
    return TABLE in kinds


def _drive(data: Sequence[Log], asked: str | None, naming: Naming) -> str:
    """Return what drives the joints of all logs, "torque" or "position".

    Raises:
        StictionError: an unknown drive, a log with neither torques nor commands, or logs of both.
    """
    if asked is not None:
        if asked not in (TORQUE, POSITION):
            raise unknown("drive", asked, (TORQUE, POSITION))
        return asked
    found = {drive_of(x, naming): x for x in data}
    if len(found) > 1:
        raise StictionError(
            f"{found[POSITION]}: a servo log, {found[TORQUE]} has torques: expected one kind, or "
            "drive torque or position"
        )
    return next(iter(found), TORQUE)


def _read(
    given: Sequence[Log],
    poses: Sequence[str | Path],
    arm: Arm,
    naming: Naming,
    motion: MotionThresholds,
) -> list[JointLog]:
    """Return the logs in their order, then the poses."""
    n = arm.n
    limits = arm.limits
    files = [x for x in given if isinstance(x, str | Path)]
    read = read_logs(files, n, limits=limits, naming=naming, motion=motion) if files else []
    from_files = iter(read)
    logs = [x if isinstance(x, JointLog) else next(from_files) for x in given]
    return logs + [read_poses(x, n, limits=limits, naming=naming) for x in poses]
