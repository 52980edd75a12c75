"""`diagnose`: what a simulation gets wrong about measured joint logs or torque tables.

d = diagnose("log.csv", "panda", torque="link")
print(d)                       # verdict and causes
diagnose("log.csv", "panda", torque="link", check=["other.csv"])  # does its model hold there?
d.save("runs/why")             # diagnosis.json, report.html, model.xml, model.toml, plots
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, Unpack, cast

from threadpoolctl import threadpool_limits

from stiction_envs.errors import StictionError, unknown
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.friction.sticking import friction_of
from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.gap.model_file import Nominal, changed_arm, nominal_of
from stiction_envs.gap.report.result import DiagnosisResult
from stiction_envs.gap.report.results import LogDiagnosis, ServoResult, TableResult
from stiction_envs.gap.servo.servo_diagnosis import diagnose_servo
from stiction_envs.gap.servo_logs import read_servo_files, servo_of
from stiction_envs.gap.tables.data import WholeArm, read_tables
from stiction_envs.gap.tables.table_diagnosis import diagnose_tables
from stiction_envs.gap.validation.check import check_model, refuse_diagnosed, refuse_unfit
from stiction_envs.measured.kinds import TABLE, file_kind
from stiction_envs.measured.logs.columns import POSITION, TORQUE
from stiction_envs.measured.logs.joint_names import Naming, Reading, naming_of
from stiction_envs.measured.logs.reader import JointLog, drive_of, read_logs, read_poses
from stiction_envs.measured.logs.robot_log import RobotLog
from stiction_envs.measured.logs.sources import Log, log_sources, torque_side
from stiction_envs.reporting.provenance import provenance
from stiction_envs.robots import ARMS, Arm, load_arm
from stiction_envs.robots.registry import robot_files

TABLES, SERVO_LOGS, JOINT_LOGS = "torque tables", "servo logs", "joint logs"
"""Kinds of data."""
WEIGHTS = {
    "reading": 6,
    "inverse dynamics": 1,
    "columns of all causes": 10,
    "choosing causes": 40,
    "held-out rows": 20,
    "evidence": 4,
    "check": 10,
    "extended model": 1,
    "report": 16,
}
"""Share of each stage of a diagnosis of logs, in order; assumed."""
BEHIND = (
    "the friction that the robot's file states is left out: it acts in front of the gear, and "
    "these torques were measured behind it"
)


class LogOptions(Reading, total=False):
    """Options of a diagnosis that a rehearsal takes too."""

    torque: str | None
    """Side of the gear on which a log's torque was measured, "motor" or "link"; None takes what the
    log says (those of libfranka, franka_ros, iiwa_ros: link), else motor."""
    nominal: str | Path | FrictionParameters | Nominal | None
    """The nominal simulation: "rigid", "file" (with friction, springs and gravity compensation of
    the robot's file), "shipped" (with the friction of this package), a TOML (friction, or an
    earlier ``model.toml``), or parameters; None for `default_nominal`."""
    drive: str | None
    """Drive of the joints, "torque" or "position"; None takes the drive that a log shows, and
    torque where it shows both."""
    servo_stiffness: Sequence[float] | None
    """Stiffness of position servos [N·m/rad], one or one per joint; None: unknown, and the
    nominal simulation follows its commands exactly."""
    servo_damping: Sequence[float] | None
    """Damping of position servos [N·m·s/rad]; None: unknown; it is fitted and never a cause."""
    same_servo: bool
    """Whether all joints have the same servo: joints without gravity get the stiffness of the
    others."""
    payload: Sequence[float] | None
    """Known mass [kg] and its centre of mass x, y, z [m] in the flange frame; None for the known
    mass of an earlier diagnosis, if any. A payload that the earlier diagnosis found is added."""
    tilt: Sequence[float] | None
    """Known roll and pitch of the base [rad]; None as for ``payload``."""
    chain: Sequence[str] | None
    """Links at the base and the tip of the arm in a file of a bigger robot."""
    cutoff_hz: float | None
    """Bandwidth of a log's zero-phase filter [Hz]; None chooses it from the data."""
    seed: int
    """Seed of the draws of the posterior."""


DEFAULTS = cast(
    "LogOptions",
    {**dict.fromkeys(LogOptions.__annotations__), "joints": (), "columns": ()}
    | {"same_servo": False, "seed": 0},
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
        poses: files of poses at rest without time, ``q1..qn,tau1..taun``; logs are optional.
        check: logs that are not used for the diagnosis and test the finished model
            (`gap.validation.check`).
        threads: threads, 0 for all processors.
        progress: called with a stage and its fraction done.
        options: how the data were measured and read, and what they are compared with; see
            `LogOptions` and `measured.logs.joint_names.Naming`.

    Returns:
        `LogDiagnosis`, `ServoResult` or `TableResult`: verdict, causes, ``save``.

    Raises:
        StictionError: an option that does not exist; files that cannot be read, do not fit the
            robot, or are of two kinds; ``check`` logs that were diagnosed too, or in which no
            joint moves that moves in ``data``.
    """
    logs, check = _listed(data), _listed(check)
    if not logs and not poses:
        raise StictionError("no log given: expected one or more logs, or poses")
    for name in options:
        if name not in DEFAULTS:
            raise unknown("option", name, DEFAULTS)
    more: LogOptions = {**DEFAULTS, **options}
    torque_side(more["torque"], ())  # report an invalid side first
    kind = kind_of(logs, more["drive"], naming_of(None, more))
    nominal = more["nominal"]
    if nominal is None:
        nominal = default_nominal(logs, robot, more["chain"])
    request = Request(logs, check, poses, robot, nominal, more, threads, progress)
    request.refuse_unfit(kind)
    by_kind = {TABLES: _diagnose_tables, SERVO_LOGS: _diagnose_servo_logs}
    return by_kind.get(kind, _diagnose_joint_logs)(request)


@dataclass(frozen=True)
class Request:
    """Arguments of `diagnose`, with defaults filled in."""

    logs: list[Log]
    """Argument ``data``, as a list."""
    check: list[Log]
    poses: Sequence[str | Path]
    robot: str | Path | Arm
    nominal: str | Path | FrictionParameters | Nominal
    options: LogOptions
    threads: int
    progress: Callable[[str, float], None] | None

    def refuse_unfit(self, kind: str) -> None:
        """Raise a StictionError for an option that the kind of data does not take."""
        o = self.options
        used: dict[str, object] = {"poses": self.poses, "cutoff": o["cutoff_hz"] is not None}
        of_servos = {
            "servo stiffness": o["servo_stiffness"],
            "same servo": o["same_servo"],
            "servo damping": o["servo_damping"],
        }
        if kind == SERVO_LOGS:
            _refuse(used | {"torque": o["torque"]}, "expected joint logs (tau1..n)")
        else:
            _refuse(of_servos, "expected servo logs (q_cmd1..n)")
        if kind == TABLES:
            used |= {"torque": o["torque"] == "link", "check": self.check}
            used |= {"joints": o["joints"], "topic": o["topic"] is not None}
            _refuse(used, f"{self.logs[0]} is a torque table: expected joint logs")
        for table in (x for x in self.check if isinstance(x, str | Path) and file_kind(x) == TABLE):
            raise StictionError(f"check: {table} is a torque table: expected joint logs")
        mounting = o["payload"], o["tilt"], o["chain"]
        if isinstance(self.robot, Arm) and any(x is not None for x in mounting):
            raise StictionError("payload, tilt, chain: the robot is an arm: set them in load_arm")

    def arm(self) -> tuple[Arm, Nominal]:
        """Return the rigid arm, and the nominal model."""
        o = self.options
        payload, tilt, chain = o["payload"], o["tilt"], o["chain"]
        return nominal_of(self.robot, self.nominal, payload=payload, tilt=tilt, chain=chain)

    def origin(self, arm: Arm, side: str) -> dict[str, Any]:
        """Return the fields of `DiagnosisResult` that say what a result was made from.

        Its torques are of a ``side`` of the gear.
        """
        nominal, calibration = self.nominal, self.options["calibration"]
        sources = log_sources([*self.logs, *self.poses], self.check)
        arguments: dict[str, object] = {
            **{k: x for k, x in self.options.items() if k not in ("seed", "cutoff_hz")},
            "logs": [_name(x) for x in self.logs],
            "check": [_name(x) for x in self.check],
            "poses": self.poses,
            "robot": arm.name if isinstance(self.robot, Arm) else self.robot,
            "torque": side,
            "calibration": None if calibration is None else str(calibration),
            "cutoff": self.options["cutoff_hz"],
            "nominal": nominal if isinstance(nominal, str | Path) else "parameters",
        }
        inputs = sources.files | ({} if isinstance(self.robot, Arm) else robot_files(self.robot))
        if calibration is not None:
            inputs["calibration"] = Path(calibration)
        if isinstance(nominal, str | Path) and Path(nominal).is_file():
            inputs["nominal"] = Path(nominal)
        seed = self.options["seed"]
        return {
            "nominal_name": Path(nominal).name if isinstance(nominal, str | Path) else "given",
            "sources": sources,
            "provenance": provenance(
                "diagnose", arguments | sources.in_memory, seed=seed, inputs=inputs
            ),
            "threads": self.threads,
        }


def _refuse(used: Mapping[str, object], text: str) -> None:
    for option in (k for k, is_used in used.items() if is_used):
        raise StictionError(f"{option}: {text}")


def _name(log: Log) -> str:
    return log.source if isinstance(log, RobotLog) else str(log)


def _diagnose_tables(request: Request) -> DiagnosisResult:
    arm, judged = request.arm()
    origin = request.origin(arm, "motor")
    if judged.friction is None:
        raise StictionError(
            f"nominal {origin['nominal_name']}: joints of an arm without friction do not break "
            "away: expected shipped, file or a path to a .toml"
        )
    rows = read_tables([x for x in request.logs if isinstance(x, str | Path)], arm)
    friction = friction_of(arm, judged.friction)
    whole = WholeArm(arm, friction, threads=request.threads)
    found = diagnose_tables(rows, whole, progress=request.progress)
    return TableResult(diagnosis=found, arm=arm, friction=friction, **origin)


def _diagnose_servo_logs(request: Request) -> DiagnosisResult:
    """Judge servos on the rigid arm, with the payload and tilt of an earlier diagnosis."""
    o, (arm, judged) = request.options, request.arm()
    stiffness, damping, same = o["servo_stiffness"], o["servo_damping"], o["same_servo"]
    known = servo_of(arm, request.nominal, stiffness=stiffness, damping=damping, same=same)
    # report problems of all logs before the long computation
    logs, check = (
        read_servo_files(x, arm, naming_of(arm, o)) for x in (request.logs, request.check)
    )
    refuse_diagnosed(check, logs)
    origin = request.origin(arm, "motor")
    found = diagnose_servo(
        logs,
        changed_arm(arm, judged.parts),
        known,
        check=check,
        threads=request.threads,
        progress=request.progress,
    )
    return ServoResult(diagnosis=found, arm=arm, before=judged, **origin)


def _diagnose_joint_logs(request: Request) -> DiagnosisResult:
    o, (arm, judged) = request.options, request.arm()
    # report problems of all logs before the long computation
    logs = _read(request.logs, request.poses, arm, naming_of(arm, o))
    check = _read(request.check, (), arm, naming_of(arm, o))
    side = torque_side(o["torque"], [*logs, *check])
    origin = request.origin(arm, side)
    refuse_unfit(check, logs, arm)
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
            cutoff_hz=o["cutoff_hz"],
            seed=o["seed"],
            progress=request.progress,
        )
    found = dataclasses.replace(found, notes=(*found.notes, *notes))
    if check and request.progress is not None:
        request.progress("check", 0.0)
    checked = check_model(found, check) if check else None
    return LogDiagnosis(diagnosis=found, check=checked, **origin)


def default_nominal(
    data: Sequence[Log], robot: str | Path | Arm, chain: Sequence[str] | None = None
) -> str:
    """Return the default nominal model: the arm as most people simulate it.

    The model is ``file`` if the robot's file states friction, springs or gravity compensation.
    Torque tables need dry friction, so they are compared with our friction if the file has none.
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


def kind_of(data: Sequence[Log], drive: str | None, naming: Naming) -> str:
    """Return the kind of data: `TABLES`, `SERVO_LOGS` or `JOINT_LOGS`.

    Raises:
        StictionError: data of two kinds, or of none; an unknown drive.
    """
    if _of_tables(data):
        return TABLES
    if drive not in (None, TORQUE, POSITION):
        raise unknown("drive", drive, (TORQUE, POSITION))
    found = {drive_of(x, naming): x for x in data} if drive is None else {drive: None}
    if len(found) > 1:
        raise StictionError(
            f"{found[POSITION]}: a servo log, {found[TORQUE]} has torques: expected one kind, or "
            "drive torque or position"
        )
    return SERVO_LOGS if POSITION in found else JOINT_LOGS


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


def _read(
    given: Sequence[Log], poses: Sequence[str | Path], arm: Arm, naming: Naming
) -> list[JointLog]:
    """Return the logs in their order, then the poses."""
    n, limits = arm.n, arm.limits
    torques = [x for x in given if isinstance(x, str | Path | JointLog)]
    logs = read_logs(torques, n, limits=limits, naming=naming) if torques else []
    return logs + [read_poses(x, n, limits=limits, naming=naming) for x in poses]


class Stages:
    """Converts a stage and its part done into the share of the whole, which never falls."""

    def __init__(self, say: Callable[[str, float | None], None], *, check: bool) -> None:
        """Start at zero.

        Args:
            say: called with a stage and the share of the whole that is done [0 to 1]; None for a
                stage of unknown share.
            check: whether there are logs to check with.
        """
        self._say, self._share = say, 0.0
        weights = {k: x for k, x in WEIGHTS.items() if check or k != "check"}
        ends = accumulate(weights.values(), initial=0)
        self._span = dict(
            zip(weights, pairwise(x / sum(weights.values()) for x in ends), strict=True)
        )

    def __call__(self, stage: str, part: float) -> None:
        """Report that a part [0 to 1] of a stage is done."""
        if stage not in self._span:
            self._say(stage, None)
            return
        start, end = self._span[stage]
        self._share = max(self._share, start + (end - start) * min(max(part, 0.0), 1.0))
        self._say(stage, min(self._share, 1.0))
