"""Torque tables as files: SJE results, dither amplitudes, base torques.

Torques in N·m, frequencies in Hz, joints from 1. ``tau`` is signed as in the thesis: positive for
direction ``+``. ``load`` and ``no_load`` are the two arm poses of the static joint experiment.
"""

import math
import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, astuple, dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array
from stiction_envs.dither.dither import check_frequency
from stiction_envs.dither.waveforms import DEFAULT_WAVEFORM, named
from stiction_envs.errors import StictionError, unknown
from stiction_envs.measured import ros_parameters as ros
from stiction_envs.measured.csv_text import Line, header_of, parse_lines, read_lines, table_text
from stiction_envs.reporting.atomic import write_text_atomic

Path = str | os.PathLike[str]

LOADS = ("load", "no_load")
"""Poses, in the order of the second axis of :attr:`BaseTable.tau`."""

DIRECTIONS = ("+", "-")
"""Signs of the ramp, in the order of the third axis of :attr:`BaseTable.tau`."""


@dataclass(frozen=True)
class SJERow:
    """One static joint experiment: mean breakaway torque of some repetitions."""

    robot: str
    joint: int
    """From 1."""
    load: str
    """``load`` or ``no_load``."""
    direction: str
    """``+`` or ``-``."""
    frequency_hz: float
    """Dither frequency, Hz; 0 in base rows."""
    amplitude_nm: float
    """Dither amplitude, N·m; 0 in base rows."""
    tau_nm: float
    """Mean torque at which the joint had moved, signed, N·m."""
    std_nm: float
    """Standard deviation over the repetitions, N·m; NaN where it is not known."""
    iterations: int
    """Number of repetitions, at least 1."""
    reduction: float
    """1 − |τ|/|τ_base|; NaN where there is no base torque."""

    @property
    def is_base(self) -> bool:
        """True if the row was measured without dither."""
        return self.frequency_hz == 0 and self.amplitude_nm == 0


@dataclass(frozen=True)
class AmplitudeRow:
    """Dither of one joint."""

    joint: int
    """From 1."""
    frequency_hz: float
    """Hz, > 0 unless the amplitude is 0."""
    amplitude_nm: float
    """N·m, ≥ 0."""
    waveform: str = DEFAULT_WAVEFORM
    """One of :data:`stiction_envs.dither.waveforms.WAVEFORMS`."""
    offset_nm: float = 0.0
    """Constant torque, N·m."""
    gate_rad_s: float = 0.0
    """v_gate of `Dither`, rad/s; 0 is not gated."""

    @property
    def gate_velocity(self) -> float:
        """v_gate as `dither.Dither` takes it [rad/s]: inf where it is not gated."""
        return self.gate_rad_s or math.inf


SJE_COLUMNS = tuple(f.name for f in fields(SJERow))
BASE_COLUMNS = (*SJE_COLUMNS[:4], "tau_base_Nm")
"""Columns of thesis table 4.3: robot, joint, pose and direction, and their base torque."""
_ALL = tuple(f.name for f in fields(AmplitudeRow))
AMPLITUDE_COLUMNS, AMPLITUDE_OPTIONAL = _ALL[:3], _ALL[3:]


def write_sje(path: Path, rows: Iterable[SJERow]) -> None:
    """Write an SJE table; every float reads back bit for bit.

    Raises:
        StictionError: rows that could not be read, or none; nothing was written.
    """
    rows = list(rows)
    text = table_text(SJE_COLUMNS, [astuple(row) for row in rows])
    parse_sje(parse_lines(path, text, SJE_COLUMNS))
    write_text_atomic(path, text)


def read_sje(path: Path) -> list[SJERow]:
    """Read an SJE table, in the order of the file."""
    return parse_sje(read_lines(path, SJE_COLUMNS))


def parse_sje(lines: Iterable[Line]) -> list[SJERow]:
    """Return the rows of an SJE table's lines."""
    rows = []
    for line in lines:
        frequency, amplitude = _drive(line)
        row = SJERow(
            robot=line.text("robot"),
            joint=line.whole("joint", 1),
            load=line.name("load", LOADS),
            direction=line.name("direction", DIRECTIONS),
            frequency_hz=frequency,
            amplitude_nm=amplitude,
            tau_nm=line.number("tau_nm"),
            std_nm=line.number("std_nm", low=0.0, nan=True),
            iterations=line.whole("iterations", 1),
            reduction=line.number("reduction", nan=True),
        )
        rows.append(row)
    return rows


def write_amplitudes(path: Path, rows: Iterable[AmplitudeRow]) -> None:
    """Write an amplitude table; the optional columns only when a row needs them.

    Raises:
        StictionError: rows that could not be read, or none; nothing was written.
    """
    rows = list(rows)
    gated = any(row.gate_rad_s != 0 for row in rows)
    shaped = any(row.waveform != DEFAULT_WAVEFORM or row.offset_nm != 0 for row in rows)
    # waveform and offset were there first: a gate needs both before it
    optional = 3 if gated else 2 if shaped else 0
    header = AMPLITUDE_COLUMNS + AMPLITUDE_OPTIONAL[:optional]
    text = table_text(header, [astuple(row)[: len(header)] for row in rows])
    list(_parse_amplitudes(parse_lines(path, text, header)))
    write_text_atomic(path, text)


def write_final(
    folder: Path,
    rows: Iterable[AmplitudeRow],
    joint_names: Sequence[str],
    more: Sequence[ros.ParameterGroup] = (),
) -> None:
    """Write ``final.csv``, and the same with ``more`` as ``final.yaml`` for a controller of ROS 2.

    Without rows there is no ``final.csv``. ``joint_names`` are those of all the arm's joints.
    """
    rows, groups = list(rows), list(more)
    if rows or not groups:
        write_amplitudes(os.path.join(folder, "final.csv"), rows)
        groups.insert(
            0, ros.ParameterGroup(ros.GROUP, [asdict(row) for row in rows], note=ros.DITHER_NOTE)
        )
    ros.write_parameters(os.path.join(folder, "final.yaml"), groups, joint_names)


def read_amplitudes(
    path: Path,
    *,
    n_joints: int,
    torque_limit: ArrayLike | None = None,
    controller_rate_hz: float | None = None,
) -> list[AmplitudeRow]:
    """Read an amplitude table, in the order of the file.

    Args:
        path: the file, CSV or a ``.yaml`` of `ros_parameters`.
        n_joints: number of joints of the arm.
        torque_limit: N·m, one number or one per joint; A + abs(offset) must not exceed it.
        controller_rate_hz: rate at which the arm's controller holds its command; a frequency from
            half of it on warns about its alias, one above it is an error.
    """
    limit = np.broadcast_to(np.inf if torque_limit is None else torque_limit, (n_joints,))
    rows: list[AmplitudeRow] = []
    read = ros.read_parameters if ros.is_parameters(path) else read_lines
    for line, row in _parse_amplitudes(read(path, AMPLITUDE_COLUMNS, AMPLITUDE_OPTIONAL), n_joints):
        most = float(limit[row.joint - 1])
        if row.amplitude_nm + abs(row.offset_nm) > most:
            total = "amplitude_nm" + (" + |offset_nm|" if row.offset_nm else "")
            raise line.error(
                f"{total} is {row.amplitude_nm + abs(row.offset_nm):g}: expected at most the "
                f"torque limit of joint {row.joint}, {most:g} N·m"
            )
        if controller_rate_hz is not None and row.amplitude_nm > 0:
            with line.named():
                warning = check_frequency(row.frequency_hz, controller_rate_hz)
            if warning is not None:
                warnings.warn(f"{line.where}: {warning}", stacklevel=2)
        rows.append(row)
    return rows


def _parse_amplitudes(
    lines: Iterable[Line], n_joints: int | None = None
) -> Iterator[tuple[Line, AmplitudeRow]]:
    seen: set[int] = set()
    for line in lines:
        joint = line.whole("joint", 1, n_joints)
        if joint in seen:
            raise line.error(f"joint {joint} occurs twice: expected one row per joint")
        seen.add(joint)
        frequency, amplitude = _drive(line)
        waveform = line.fields.get("waveform", DEFAULT_WAVEFORM)
        with line.named():
            named(waveform)
        offset = line.number("offset_nm", 0.0)
        gate = line.number("gate_rad_s", low=0.0) if line.fields.get("gate_rad_s") else 0.0
        yield line, AmplitudeRow(joint, frequency, amplitude, waveform, offset, gate)


def _drive(line: Line) -> tuple[float, float]:
    """Return frequency [Hz] and amplitude [N·m] of a line."""
    frequency, amplitude = line.number("frequency_hz"), line.number("amplitude_nm", low=0.0)
    if frequency < 0 or (frequency == 0 and amplitude > 0):
        raise line.error(f"frequency_hz is {frequency}: expected > 0, or 0 with amplitude_nm 0")
    return frequency, amplitude


@dataclass(frozen=True, eq=False)
class BaseTable:
    """Base torques of one arm: breakaway without dither for each joint, pose and direction."""

    robot: str
    tau: Array
    """(n, 2, 2) N·m, signed: [joint, load | no_load, + | −]."""

    def __post_init__(self) -> None:
        tau = np.array(self.tau, dtype=float)
        if tau.ndim != 3 or tau.shape[1:] != (2, 2):
            raise StictionError(f"base table has shape {tau.shape}: expected (n, 2, 2)")
        for (j, k, d), value in np.ndenumerate(tau):
            _check_sign(float(value), d, f"base table: joint {j + 1}, {LOADS[k]}")
        tau.flags.writeable = False
        object.__setattr__(self, "tau", tau)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return self.tau.shape[0]

    @property
    def friction(self) -> Array:
        """Half-width of the band, (τ₊ − τ₋)/2, (n, 2) N·m [joint, load | no_load]: friction."""
        return (self.tau[..., 0] - self.tau[..., 1]) / 2

    @property
    def offset(self) -> Array:
        """Middle of the band, (τ₊ + τ₋)/2, (n, 2) N·m [joint, load | no_load].

        Bias of gravity model or sensor, not friction; dither narrows the band around it.
        """
        return (self.tau[..., 0] + self.tau[..., 1]) / 2


def read_base(path: Path, robot: str | None = None, n_joints: int = 7) -> BaseTable:
    """Read base torques of one robot from an SJE table, or a table in the form of thesis table 4.3.

    Rows of an SJE table with dither do not count. ``robot`` may be left out where the file holds
    one robot only; the thesis's ``iiwa`` is our ``iiwa7``.
    """
    thesis = "tau_base_Nm" in header_of(path)
    lines = read_lines(path, BASE_COLUMNS if thesis else SJE_COLUMNS)
    if not thesis:
        lines = [x for x in lines if x.number("frequency_hz") == x.number("amplitude_nm") == 0]
    robots = list(dict.fromkeys(our_name(x.text("robot")) for x in lines))
    if robot is None:
        if len(robots) != 1:
            shown = ", ".join(robots) or "none"
            raise StictionError(f"{path}: robots with base torques are {shown}: expected one")
        robot = robots[0]
    robot = our_name(robot)
    if robot not in robots:
        raise StictionError(f"{path}: {unknown('robot', robot, robots)}")
    tau = np.full((n_joints, 2, 2), np.nan)
    for line in lines:
        if our_name(line.fields["robot"]) != robot:
            continue
        joint = line.whole("joint", 1, n_joints)
        load, direction = line.name("load", LOADS), line.name("direction", DIRECTIONS)
        at = joint - 1, LOADS.index(load), DIRECTIONS.index(direction)
        if not math.isnan(tau[at]):
            raise line.error(f"joint {joint}, {load} {direction} occurs twice: expected once")
        tau[at] = line.number("tau_base_Nm" if thesis else "tau_nm")
        _check_sign(tau[at], at[2], f"{line.where}: joint {joint}, {load}")
    missing = np.argwhere(np.isnan(tau))
    if missing.size:
        j, k, d = missing[0]
        raise StictionError(
            f"{path}: {tau.size - len(missing)} of {tau.size} base torques of {robot}: "
            f"joint {j + 1}, {LOADS[k]} {DIRECTIONS[d]} missing: expected all, once"
        )
    return BaseTable(robot, tau)


def our_name(robot: str) -> str:
    """Return our name of a robot: the thesis's ``iiwa`` is the iiwa 7 R800; others keep theirs."""
    return "iiwa7" if robot == "iiwa" else robot


def _check_sign(tau: float, direction: int, where: str) -> None:
    sign, expected = ((1, "> 0"), (-1, "< 0"))[direction]
    if not 0 < sign * tau < math.inf:
        name = DIRECTIONS[direction]
        raise StictionError(f"{where} {name}: base torque is {tau} N·m: expected {expected}")
