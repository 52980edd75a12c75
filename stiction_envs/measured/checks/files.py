"""`check`: defects in files of measurements, torque tables and joint logs."""

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, astuple, dataclass
from decimal import Decimal
from pathlib import Path
from typing import Unpack

from stiction_envs.errors import StictionError, unknown
from stiction_envs.measured.csv_text import Line, header_of, read_lines, write_lines
from stiction_envs.measured.kinds import TABLE, file_kind
from stiction_envs.measured.logs.columns import DRIVES, POSITION
from stiction_envs.measured.logs.joint_names import Reading, naming_of
from stiction_envs.measured.logs.log_files import count_joints, is_log, no_log
from stiction_envs.measured.logs.reader import IGNORED, drive_of, read_logs, read_servo_logs
from stiction_envs.measured.logs.robot_log import JointLog, RobotLog
from stiction_envs.measured.tables import (
    BASE_COLUMNS,
    DIRECTIONS,
    LOADS,
    SJE_COLUMNS,
    parse_sje,
    read_amplitudes,
)
from stiction_envs.reporting.provenance import Provenance, provenance
from stiction_envs.reporting.result import Result
from stiction_envs.robots import load_arm
from stiction_envs.robots.arm_toml import Limits

REMARK = "remark"
"""Kind of what is true but not wrong."""
NOT_WRONG = ("gap", "run", "epoch", "source", "wrap")
"""Kinds of correction that only say how a log was recorded: segments, recordings, dates as time,
what its columns or messages are, angles within one turn."""
SAME_STD = 5.0
"""Two runs of one setting contradict if they differ by more combined standard deviations
[-]; assumed."""
SAME_SHARE = 0.25
"""Share of the torque, where no deviation is known [-]. Source: five times the 4.7
points by which the thesis's own runs repeat."""
ANY_JOINTS = 99  # joints of an amplitude table's robot where it is not known
Cells = tuple[str, str, str]
"""Row, kind and message of a defect."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong in a file, or worth a remark."""

    file: str
    where: str
    """Row or cell; empty for the file as a whole."""
    kind: str
    """In a table: ``sign``, ``percentage`` or ``repeat``. In a log: ``corrected`` when it is read,
    ``warning`` if it cannot be. ``unreadable``: nothing can be done with the file. ``remark``: not
    wrong."""
    message: str


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Findings(Result):
    """Defects of some files."""

    files: tuple[str, ...]
    findings: tuple[Finding, ...]
    """In the order of the files."""
    provenance: Provenance
    logs: tuple[JointLog, ...] = ()
    """The joint logs among them, as read and corrected."""

    @property
    def defects(self) -> tuple[Finding, ...]:
        """Findings without the remarks."""
        return tuple(x for x in self.findings if x.kind != REMARK)

    def to_json(self) -> dict[str, object]:
        """Return files and findings."""
        return {"files": list(self.files), "findings": [asdict(x) for x in self.findings]}

    def write(self, folder: Path) -> None:
        """Write ``findings.csv``."""
        rows = [(x.file, x.where, x.kind, x.message) for x in self.findings]
        write_lines(folder / "findings.csv", ("file", "where", "kind", "message"), rows)

    def __repr__(self) -> str:
        remarks = len(self.findings) - len(self.defects)
        return (
            f"<Findings in {len(self.files)} files: {len(self.defects)} defects, {remarks} remarks>"
        )

    def __str__(self) -> str:
        lines = [": ".join(filter(None, astuple(x))) for x in self.findings]
        return "\n".join(lines) or "nothing wrong"


def check(
    *files: str | os.PathLike[str],
    robot: str | Path | None = None,
    chain: Sequence[str] | None = None,
    drive: str | None = None,
    **reading: Unpack[Reading],
) -> Findings:
    """List defects of torque tables, joint logs and servo logs; the columns show the kind of file.

    Tables: reductions that do not follow from their torques, repetitions that contradict each
    other, impossible signs; values that the kind of table does not allow.
    Logs: units, clock, repeated and missing rows, stuck or saturated channels, speeds that lag.
    Of servo logs also: commands beyond the joints' limits, that never move, or were copied.

    Args:
        files: paths.
        robot: whose logs these are; without it fewer wrong units are seen.
        chain: links at the base and the tip of the arm in a file of a bigger robot.
        drive: what drives the joints of the logs, torque or position; None for what each one has,
            torque where it has both.
        reading: ``joints``, ``topic``, ``units``, ``calibration``, ``columns``; see `Naming`.

    Raises:
        StictionError: no file, one that is not there, or that is neither table nor log.
    """
    if not files:
        raise StictionError("no file given: expected one or more torque tables or joint logs")
    if drive is not None and drive not in DRIVES:
        raise unknown("drive", drive, DRIVES)
    paths = [Path(x) for x in files]
    for path in paths:
        if not is_log(path):
            raise no_log(path, "a torque table or a joint log")
    arm = None if robot is None else load_arm(robot, chain=chain)
    n, limits = (0, None) if arm is None else (arm.n, arm.limits)
    naming = naming_of(arm, reading)
    findings: list[Finding] = []
    logs: list[JointLog] = []
    for path in paths:
        kind, found = file_kind(path), list[Cells]()
        try:
            if kind == TABLE:
                for defect in _table_defects(path, limits):
                    found.append(defect)
            else:
                count = n or count_joints(path, naming)
                position = (drive or drive_of(path, naming)) == POSITION
                read = read_servo_logs if position else read_logs
                log: RobotLog = read([path], count, limits=limits, naming=naming)[0]
                logs += [log] if isinstance(log, JointLog) else []
                for c in log.corrections:
                    found.append(("", REMARK if c.kind in NOT_WRONG else "corrected", c.text))
                for text in log.warnings:
                    remark = REMARK if text.startswith(IGNORED) else "warning"
                    found.append(("", remark, text))
        except StictionError as error:
            # the message begins with the file, or one in its folder, whose path stays whole
            text = str(error).removeprefix(f"{path}: ").removeprefix(f"{path}, ")
            found.append(("", "unreadable", text))
        findings += [Finding(str(path), *x) for x in found]
    arguments = {
        "files": [str(p) for p in paths],
        "robot": robot,
        "chain": chain,
        "drive": drive,
        **naming.record,
    }
    inputs = {f"file{k}": p for k, p in enumerate(paths, 1)}
    inputs |= naming.files
    return Findings(
        files=tuple(map(str, paths)),
        findings=tuple(findings),
        logs=tuple(logs),
        provenance=provenance("check", arguments, seed=0, inputs=inputs),
    )


def _table_defects(path: str | os.PathLike[str], limits: Limits | None = None) -> Iterator[Cells]:
    """Yield the defects of an SJE table, a table of base torques or an amplitude table.

    ``limits`` of the robot bound amplitudes; None where the robot is not known.

    Raises:
        StictionError: the file cannot be read as such a table.
    """
    header = header_of(path)
    if "tau_base_Nm" in header:
        for line in read_lines(path, BASE_COLUMNS):
            joint, load = line.whole("joint", 1), line.name("load", LOADS)
            direction, tau = line.name("direction", DIRECTIONS), line.number("tau_base_Nm")
            yield from _check_sign(f"{line.text('robot')} joint {joint}, {load}", direction, tau)
    elif "tau_nm" in header or "robot" in header:
        yield from _check_sje(read_lines(path, SJE_COLUMNS))
    elif limits is None:
        read_amplitudes(path, n_joints=ANY_JOINTS)
    else:
        read_amplitudes(path, n_joints=len(limits.torque), torque_limit=limits.torque)


def _check_sign(where: str, direction: str, tau: float) -> Iterator[Cells]:
    sign, expected = (1, "> 0") if direction == "+" else (-1, "< 0")
    if tau * sign <= 0:
        message = f"{tau:g}, expected {expected}: torque against the direction of its ramp"
        yield f"{where} {direction}", "sign", message


def _check_sje(lines: list[Line]) -> Iterator[Cells]:
    """Yield wrong signs, reductions that are not 1 − |tau|/|base|, and contradicting repetitions.

    NaN and rows without a base row of the same robot, joint, pose and direction pass.
    """
    rows = parse_sje(lines)
    tau = [Decimal(line.fields["tau_nm"]) for line in lines]
    keys = [(row.robot, row.joint, row.load, row.direction) for row in rows]
    for row in rows:
        place = f"{row.robot} joint {row.joint}, {row.load}"
        yield from _check_sign(place, row.direction, row.tau_nm)
    bases: dict[tuple[object, ...], list[Decimal]] = {}
    for row, key, x in zip(rows, keys, tau, strict=True):
        if row.is_base and x:
            bases.setdefault(key, []).append(x)
    first: dict[tuple[object, ...], int] = {}
    for k, (row, key) in enumerate(zip(rows, keys, strict=True)):
        where = f"{row.robot} joint {row.joint}, {row.load} {row.direction}, "
        where += f"{row.frequency_hz:g} Hz, {row.amplitude_nm:g} N·m"
        if key in bases and not math.isnan(row.reduction):
            printed = Decimal(lines[k].fields["reduction"])
            # of several base rows the one that suits the printed number best
            base = min(bases[key], key=lambda b: abs(1 - abs(tau[k] / b) - printed))
            best = 1 - abs(tau[k] / base)
            slack = _rounding(tau[k]) / abs(base) + abs(tau[k]) * _rounding(base) / base**2
            # The last term: reductions computed in double precision.
            if abs(printed - best) > _rounding(printed) + slack + Decimal("1e-12"):
                message = f"{printed}, expected {best:.4f}: 1 - |tau|/|base| of the base row"
                yield where, "percentage", message
        before = first.setdefault((*key, row.frequency_hz, row.amplitude_nm), k)
        std = SAME_STD * math.hypot(rows[before].std_nm, row.std_nm)
        share = SAME_SHARE * max(abs(rows[before].tau_nm), abs(row.tau_nm))
        most = Decimal(share if math.isnan(std) else std)
        if abs(tau[before] - tau[k]) > most + _rounding(tau[before]) + _rounding(tau[k]):
            message = f"{tau[k]} N·m, expected near {tau[before]}: the same setting is there twice"
            yield where, "repeat", f"{message}, at most {most:.3g} N·m apart"


def _rounding(value: Decimal) -> Decimal:
    """Return half a unit in the last printed place."""
    return Decimal((0, (5,), int(value.as_tuple().exponent) - 1))
