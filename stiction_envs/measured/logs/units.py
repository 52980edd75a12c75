"""Angles in other units than radians: degrees, percent of a calibrated range, encoder steps.

A log does not say its unit, so a person does (`Naming.units`), or the encoder's step shows it: the
angles of a servo with 4096 steps a turn are whole multiples of 360/4096 degrees, or of 100 % over
the steps of its range. lerobot writes -100 to 100 over the range of a joint, 0 to 100 over that of
a gripper, and degrees as 360/4095 of a step; zero is the middle of the range, of a gripper its end.
Source: lerobot, motors/motors_bus.py (`_normalize`) and its calibration files.
"""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError, opening

RADIANS, DEGREES, PERCENT, TICKS = UNITS = ("rad", "deg", "percent", "ticks")
"""Units of angles."""
TURN = 4096
"""Encoder steps of a turn. Source: Feetech STS3215 and Dynamixel X series, their control tables."""
DEGREE_STEPS = (360 / (TURN - 1), 360 / TURN)
"""Step of an encoder in degrees, as lerobot writes it and as it is."""
ALIKE = 2e-3  # steps that differ by less are the same [-]; assumed
LEAST_LEVELS = 20  # fewer different values do not show a step; assumed
OFF_STEP = 0.1  # values are whole steps if they are this near to them [steps]; assumed
RANGE = (100, TURN)
"""Steps of a joint's range [-]; assumed: less than 9 degrees is no joint."""
MOST_BYTES = 2**20  # most bytes of a calibration file that are read; assumed
MOST_MOTORS = 1000  # in a calibration file; assumed

_GRIPPER = re.compile(r"gripper|jaw", re.IGNORECASE)


Steps = Annotated[int, msgspec.Meta(gt=-(10**6), lt=10**6)]


@dataclass(frozen=True)
class MotorRange:
    """Calibrated range of a motor, in encoder steps, as lerobot names its parts."""

    id: Steps
    """Number of the motor on its bus."""
    range_min: Steps
    range_max: Steps

    def __post_init__(self) -> None:
        if self.range_min >= self.range_max:
            raise ValueError("range_max is not above range_min")


def read_calibration(path: str | os.PathLike[str]) -> dict[str, MotorRange]:
    """Read a calibration file of lerobot: the ranges of motors by their names."""
    wanted = "lerobot's JSON: a motor's name, then id, range_min and range_max"
    with opening(path, wanted), open(path, "rb") as file:
        data = file.read(MOST_BYTES + 1)
    kind = Annotated[dict[str, MotorRange], msgspec.Meta(min_length=1, max_length=MOST_MOTORS)]
    try:
        found: dict[str, MotorRange] = msgspec.json.decode(data, type=kind)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise StictionError(f"{os.fspath(path)}: {error}: expected {wanted}") from None
    return found


def is_gripper(name: str) -> bool:
    """Return whether a motor's name says that it closes a gripper."""
    return _GRIPPER.search(name) is not None


def encoder_step(x: Array) -> float | None:
    """Return the step that all values (T,) are whole multiples of but for an offset, or None."""
    levels = np.unique(x[np.isfinite(x)])
    if len(levels) < LEAST_LEVELS:
        return None
    between = np.diff(levels)
    # a step that single precision rounds apart counts once
    between = between[between > 1e-3 * np.median(between)]
    step = float(np.median(between[between < 1.5 * between.min()]))
    for _ in range(2):
        count = np.round((levels - levels[0]) / step)
        step = float(np.polyfit(count, levels, 1)[0])
    count = np.round((levels - levels[0]) / step)
    off = levels - np.polyval(np.polyfit(count, levels, 1), count)
    return step if np.abs(off).max() < OFF_STEP * step else None


def recognised(q: Array, names: Sequence[str]) -> tuple[str | None, str]:
    """Return the unit that encoders' steps in angles (T, n) show, or None; and why."""
    body = [j for j, name in enumerate(names) if not is_gripper(name)]
    steps = [s for j in body if (s := encoder_step(q[:, j])) is not None]
    largest = max((float(np.nanmax(np.abs(q[:, j]))) for j in body), default=0.0)
    if 2 * len(steps) >= len(body) > 0:
        for unit, known in ((DEGREES, DEGREE_STEPS), (RADIANS, (2 * np.pi / TURN,))):
            if all(any(abs(s / k - 1) < ALIKE for k in known) for s in steps):
                return unit, f"they come in steps of {known[0]:.4g}, of {TURN} in a turn"
        ranges = [200 / s for s in steps]
        if largest <= 100.5 and all(RANGE[0] <= r <= RANGE[1] for r in ranges):
            return PERCENT, "they come in other steps for each joint, and end at 100"
    if 100.5 < largest <= 360:
        return DEGREES, f"they reach {largest:.4g}"
    return None, ""


def to_radians(
    where: str,
    data: Mapping[str, Array],
    units: Sequence[str],
    names: Sequence[str],
    calibration: str | os.PathLike[str] | None,
) -> list[str]:
    """Convert ``q``, ``q_cmd`` and ``dq`` (T, n) of a log to rad, in place; return a remark a unit.

    Args:
        where: the log, the beginning of every message.
        data: channels of the log.
        units: of `UNITS`, one for each joint.
        names: of the joints or motors; () where they have none, then joint j is motor j.
        calibration: lerobot's file with the ranges of the motors; None where they are not known.

    Raises:
        StictionError: percent of a range that neither calibration nor steps show, or a calibration
            that cannot be read.
    """
    ranges = None if calibration is None else read_calibration(calibration)
    said: dict[str, list[str]] = {}
    for j, unit in enumerate(units):
        name = names[j] if names else f"{j + 1}"
        if unit == RADIANS:
            continue
        scale, zero, text = _scale(where, unit, data["q"][:, j], name, j, ranges)
        said.setdefault(text, []).append(name)
        for channel in ("q", "q_cmd"):
            if channel in data:
                data[channel][:, j] = (data[channel][:, j] - zero) * scale
        if "dq" in data:
            data["dq"][:, j] *= scale
    return [f"{', '.join(joints)}: {text}" for text, joints in said.items()]


def _scale(
    where: str, unit: str, q: Array, name: str, j: int, calibration: Mapping[str, MotorRange] | None
) -> tuple[float, float, str]:
    """Return radians of one unit, where zero is in that unit, and a sentence about both."""
    step = 2 * np.pi / TURN
    if unit == DEGREES:
        return np.pi / 180, 0.0, "degrees"
    motor = None
    if calibration is not None:
        numbered = (m for m in calibration.values() if m.id == j + 1 and name == f"{j + 1}")
        motor = calibration.get(name) or next(numbered, None)
        if motor is None:
            raise StictionError(
                f"{where}: the calibration has no motor {name!r}: expected one of "
                f"{', '.join(str(k)[:40] for k in list(calibration)[:12])}"
            )
    if unit == TICKS:
        if motor is None:
            return step, TURN / 2, f"encoder steps, {TURN} a turn, zero at {TURN // 2} (assumed)"
        low, high = motor.range_min, motor.range_max
        zero = low if is_gripper(name) else (low + high) / 2
        end = "lower end" if is_gripper(name) else "middle"
        return step, zero, f"encoder steps, {TURN} a turn, zero at the {end} of the range"
    full = 200.0  # of a joint -100 to 100, of a gripper 0 to 100, or 0 to 1
    if is_gripper(name):
        full = 1.0 if np.nanmax(np.abs(q)) <= 1.0 else 100.0
    if motor is not None:
        count, how = motor.range_max - motor.range_min, "from the calibration"
    else:
        found = encoder_step(q)
        count, how = round(full / found) if found else 0, "from the smallest step"
        if not RANGE[0] <= count <= RANGE[1]:
            raise StictionError(
                f"{where}: {name} is in percent of its calibrated range, whose size the log does "
                "not show: expected a calibration file (lerobot's JSON)"
            )
    return step * count / full, 0.0, f"{full:g} are a range of {count} encoder steps, {how}"
