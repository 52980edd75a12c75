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
from typing import Unpack

from threadpoolctl import threadpool_limits

from stiction_envs.errors import StictionError, unknown
from stiction_envs.friction.sticking import friction_of
from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.gap.model_file import Nominal, changed_arm, nominal_of
from stiction_envs.gap.options import JOINT_LOGS, SERVO_LOGS, TABLES, LogOptions, Options, checked
from stiction_envs.gap.report.log_result import LogDiagnosis
from stiction_envs.gap.report.result import DiagnosisResult
from stiction_envs.gap.report.servo_result import ServoResult
from stiction_envs.gap.report.table_result import TableResult
from stiction_envs.gap.servo.diagnosis import diagnose_servo
from stiction_envs.gap.servo_logs import (
    check_servo_logs,
    read_servo_files,
    servo_nominal,
    servo_of,
)
from stiction_envs.gap.tables.diagnosis import diagnose_tables
from stiction_envs.gap.tables.from_files import read_tables
from stiction_envs.gap.validation.check import check_model, refuse_unfit
from stiction_envs.measured.kinds import TABLE, file_kind
from stiction_envs.measured.logs.columns import POSITION, TORQUE
from stiction_envs.measured.logs.joint_names import Naming, naming_of
from stiction_envs.measured.logs.reader import JointLog, drive_of, read_logs, read_poses
from stiction_envs.measured.logs.robot_log import RobotLog
from stiction_envs.measured.logs.sources import Log, torque_side
from stiction_envs.robots import ARMS, Arm, load_arm

BEHIND = (
    "the friction that the robot's file states is left out: it acts in front of the gear, and "
    "these torques were measured behind it"
)


def diagnose(
    data: Log | Sequence[Log],
    robot: str | Path | Arm,
    *,
    poses: Sequence[str | Path] = (),
    check: Sequence[Log] = (),
    threads: int = 0,
    progress: Callable[[str, float], None] | None = None,
    **options: Unpack[LogOptions],
) -> DiagnosisResult:
    """Name what a simulation gets wrong about measurements of one robot.

    Joint logs (``t,q1..qn[,dq1..dqn],tau1..taun``, logs of libfranka, ROS bags), servo logs
    (``t,q_cmd1..q_cmdn,q1..qn``) and torque tables (the form of ``sje.csv``, base torques and
    dithered ones) are recognised by their content.

    Args:
        data: a file or several of one kind, or logs that were read.
        robot: name, model file or arm.
        poses: files of poses at rest without time, ``q1..qn,tau1..taun``; with logs or alone.
        check: logs that are not used for the diagnosis and test the finished model
            (`gap.validation.check`).
        threads: threads, 0 for all processors.
        progress: called with a stage and the part of it that is done.
        options: how the data were measured and read, and what they are compared with; see
            `gap.options.LogOptions` and `measured.logs.joint_names.Naming`.

    Returns:
        `LogDiagnosis`, `ServoResult` or `TableResult`: verdict, causes, ``save``.

    Raises:
        StictionError: an option that does not exist; files that cannot be read, do not fit the
            robot, or are of two kinds; logs to check with that show no joint that moved in the
            others, or were diagnosed too.
    """
    given, check = _listed(data), _listed(check)
    if not given and not poses:
        raise StictionError("no log given: expected one or more logs, or poses")
    more = checked(options)
    torque_side(more["torque"], ())  # report an invalid side first
    kind = _kind(given, more["drive"], naming_of(None, more))
    nominal = more["nominal"]
    asked = Options(
        given=given,
        check=check,
        poses=poses,
        robot=robot,
        nominal=default_nominal(given, robot, more["chain"]) if nominal is None else nominal,
        more=more,
        threads=threads,
        progress=progress,
    )
    asked.refuse_unfit(kind)
    arm, judged = _robot(asked, kind)
    if kind == TABLES:
        return _diagnose_tables(asked, arm, judged)
    naming = naming_of(arm, more)
    if kind == SERVO_LOGS:
        return _diagnose_servo_logs(asked, arm, judged, naming)
    return _diagnose_joint_logs(asked, arm, judged, naming)


def _robot(options: Options, kind: str) -> tuple[Arm, Nominal]:
    """Return the rigid arm, and what is added to it for the simulation that is judged.

    Servos are judged on the rigid arm, with the payload and tilt of an earlier diagnosis.
    """
    more = options.more
    payload, tilt, chain = more["payload"], more["tilt"], more["chain"]
    if isinstance(options.robot, Arm) and not (payload is tilt is chain is None):
        raise StictionError("payload, tilt, chain: expected in the arm, where an arm is given")
    nominal = options.nominal
    if kind == SERVO_LOGS:
        nominal = servo_nominal(nominal)
    return nominal_of(options.robot, nominal, payload=payload, tilt=tilt, chain=chain)


def _diagnose_tables(options: Options, arm: Arm, judged: Nominal) -> DiagnosisResult:
    identity = options.identify(arm, "motor")
    if judged.friction is None:
        raise StictionError(
            f"nominal {identity['nominal_name']}: joints of an arm without friction do not break "
            "away: expected shipped, file or a path to a .toml"
        )
    base, dithered = read_tables([x for x in options.given if isinstance(x, str | Path)], arm)
    friction, say = friction_of(arm, judged.friction), options.progress
    found = diagnose_tables(
        base,
        dithered,
        arm,
        friction,
        threads=options.threads,
        progress=None if say is None else lambda text: say(text, 0.0),
    )
    return TableResult(diagnosis=found, arm=arm, friction=friction, **identity)


def _diagnose_servo_logs(
    options: Options, arm: Arm, judged: Nominal, naming: Naming
) -> DiagnosisResult:
    known = servo_of(
        arm,
        servo_nominal(options.nominal),
        stiffness=options.more["servo_stiffness"],
        damping=options.more["servo_damping"],
        same=options.more["same_servo"],
    )
    # report problems of all logs before the long computation
    logs = read_servo_files(options.given, arm, naming)
    others = read_servo_files(options.check, arm, naming)
    check_servo_logs(others, logs)
    identity = options.identify(arm, "motor")
    found = diagnose_servo(
        logs,
        changed_arm(arm, judged.parts),
        known,
        check=others,
        threads=options.threads,
        progress=options.progress,
    )
    return ServoResult(diagnosis=found, arm=arm, before=judged, **identity)


def _diagnose_joint_logs(
    options: Options, arm: Arm, judged: Nominal, naming: Naming
) -> DiagnosisResult:
    # report problems of all logs before the long computation
    logs = _read(options.given, options.poses, arm, naming)
    others = _read(options.check, (), arm, naming)
    side = torque_side(options.more["torque"], [*logs, *others])
    identity = options.identify(arm, side)
    refuse_unfit(others, logs, arm)
    notes: tuple[str, ...] = ()
    if side == "link" and judged.file and judged.friction is not None:
        judged, notes = dataclasses.replace(judged, friction=None), (BEHIND,)
    # many small systems: a second thread of linear algebra makes them slower, and other bits
    with threadpool_limits(limits=1, user_api="blas"):
        found = diagnose_logs(
            logs,
            arm,
            nominal=judged,
            torque=side,
            cutoff_hz=options.more["cutoff_hz"],
            seed=options.more["seed"],
            progress=options.progress,
        )
    found = dataclasses.replace(found, notes=(*found.notes, *notes))
    if others and options.progress is not None:
        options.progress("check", 0.0)
    return LogDiagnosis(
        diagnosis=found,
        torque=side,
        check=check_model(found, others) if others else None,
        **identity,
    )


def default_nominal(
    data: Sequence[Log], robot: str | Path | Arm, chain: Sequence[str] | None = None
) -> str:
    """Return the default nominal model: the arm as most people simulate it.

    That is its own file where this states friction, springs or gravity compensation. Joints without
    dry friction have no breakaway torque, so tables are compared with our friction then.
    """
    tables = _of_tables(data)
    if isinstance(robot, Arm) or str(robot) not in ARMS:
        arm = robot if isinstance(robot, Arm) else load_arm(robot, chain=chain)
        s = arm.stated
        if s.dry if tables else s.friction or s.passive:
            return "file"
    return "shipped" if tables else "rigid"


def _listed(logs: Log | Sequence[Log]) -> list[Log]:
    return [logs] if isinstance(logs, str | Path | RobotLog) else list(logs)


def _kind(data: Sequence[Log], drive: str | None, naming: Naming) -> str:
    """Return the kind of data: `TABLES`, `SERVO_LOGS` or `JOINT_LOGS`.

    Raises:
        StictionError: data of two kinds, or of none.
    """
    if _of_tables(data):
        return TABLES
    return SERVO_LOGS if _drive(data, drive, naming) == POSITION else JOINT_LOGS


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
    given: Sequence[Log], poses: Sequence[str | Path], arm: Arm, naming: Naming
) -> list[JointLog]:
    """Return the logs in their order, then the poses."""
    n, limits = arm.n, arm.limits
    torques = [x for x in given if isinstance(x, str | Path | JointLog)]
    logs = read_logs(torques, n, limits=limits, naming=naming) if torques else []
    return logs + [read_poses(x, n, limits=limits, naming=naming) for x in poses]
