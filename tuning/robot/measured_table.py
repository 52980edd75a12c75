"""Tables of torques that a user measured on a real robot: read, and checked for units.

Columns are as in an SJE table; ``std_nm``, ``iterations`` and ``reduction`` may be left out. A
torque of ``nan`` means that the joint stuck or the run failed; an empty one was not measured.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.protocol import Configuration
from stiction_envs.measured.csv_text import read_lines
from stiction_envs.measured.tables import DIRECTIONS, LOADS, SJE_COLUMNS, AmplitudeRow, our_name
from stiction_envs.reporting.kept_rows import KeptRows
from tuning.robot.posterior import CONFIGURATIONS, Readings
from tuning.robot.prediction import PREDICTIONS, Predicted
from tuning.search.bounds import Bounds
from tuning.settings import RobotSettings

REQUIRED, OPTIONAL = SJE_COLUMNS[:7], SJE_COLUMNS[7:]


class MeasuredRow(NamedTuple):
    """One measured torque."""

    configuration: Configuration
    setting: AmplitudeRow  # Dither of the joint; amplitude 0 without one
    tau_nm: float  # Signed torque [N·m]; NaN: the joint stuck, or the run failed
    where: str

    @property
    def is_base(self) -> bool:
        """True if the row was measured without dither."""
        return self.setting.amplitude_nm == 0


def read_measured(path: Path, robot: str, n_joints: int) -> list[MeasuredRow]:
    """Return the rows of a table that contain a measurement, in its order.

    Raises:
        StictionError: no such table, another robot's rows, unknown joints, or no measurement.
    """
    rows = []
    for line in read_lines(path, REQUIRED, OPTIONAL):
        if our_name(line.text("robot")) != our_name(robot):
            raise line.error(f"robot is {line.fields['robot']!r}: expected {robot}")
        joint = line.whole("joint", 1, n_joints)
        where = joint, line.name("load", LOADS), line.name("direction", DIRECTIONS)
        frequency, amplitude = (line.number(x, low=0.0) for x in ("frequency_hz", "amplitude_nm"))
        if amplitude > 0 and frequency == 0:
            raise line.error("frequency_hz is 0: expected > 0, or 0 with amplitude_nm 0")
        if line.fields["tau_nm"]:
            setting = AmplitudeRow(joint, frequency if amplitude else 0.0, amplitude)
            tau = line.number("tau_nm", nan=True)
            rows.append(MeasuredRow(Configuration(*where), setting, tau, line.where))
    if not rows:
        raise StictionError(f"{path}: every tau_nm is empty: expected a measured torque, or nan")
    return rows


def check_measured(
    rows: Sequence[MeasuredRow],
    bounds: Bounds,
    base_nm: Mapping[Configuration, float],
    settings: RobotSettings,
) -> None:
    """Raise where a row cannot be a measurement of this arm within its bounds, in SI units.

    ``base_nm`` has a rough |base torque| of every configuration [N·m]; measured ones in the table
    override it. The message names the line.
    """
    base = dict(base_nm)
    for row in (r for r in rows if r.is_base and math.isfinite(r.tau_nm)):
        rough = base_nm[row.configuration]
        _check_torque(row, rough, settings.base_factor, settings.base_factor)
        base[row.configuration] = abs(row.tau_nm)
    for row in (r for r in rows if not r.is_base):
        if (reason := bounds.beyond(row.setting)) is not None:
            raise StictionError(f"{row.where}: {reason}")
        if math.isfinite(row.tau_nm):
            _check_torque(row, base[row.configuration], math.inf, settings.most_ratio)


def _check_torque(row: MeasuredRow, base: float, below: float, above: float) -> None:
    """Raise unless a torque has its direction's sign and is within factors of the base torque."""
    what = f"{row.where}: tau_nm is {row.tau_nm:g}"
    if row.configuration.sign * row.tau_nm <= 0:
        expected = "> 0" if row.configuration.sign > 0 else "< 0"
        raise StictionError(
            f"{what} in direction {row.configuration.direction}: expected {expected}"
        )
    if not base / below <= abs(row.tau_nm) <= base * above:
        low = f"{base / below:.3g} to " if math.isfinite(below) else "up to "
        raise StictionError(
            f"{what}: expected {low}{base * above:.3g} N·m (the base torque is about {base:.3g})"
        )


def add_measured(study: KeptRows, rows: Sequence[MeasuredRow], file: str) -> int:
    """Add a measured table, whose hash is ``file``; return the number of its settings.

    A table that is entered again (after a power cut, say) adds nothing.
    """
    if file in study.every:
        return 0
    numbers = [(r.setting.frequency_hz, r.setting.amplitude_nm, r.tau_nm) for r in rows]
    cells = [[*astuple(r.configuration), *x] for r, x in zip(rows, numbers, strict=True)]
    study.add(file, cells)
    return len({r.setting for r in rows})


def readings(
    study: KeptRows, predicted: Predicted, same: float
) -> tuple[dict[int, Readings], list[Configuration]]:
    """Return the measurements of every joint's settings, and configurations without a base torque.

    A torque is divided by the base torques of the same table if it has any, else by those of all
    tables, else by the simulated one. ``same`` is that of `Predicted.find`.
    """
    rows: list[tuple[str, Configuration, float, float, float]] = [
        (file, Configuration(joint, load, direction), *numbers)
        for file, table in study.every.items()
        if file != PREDICTIONS
        for joint, load, direction, *numbers in table
    ]
    base: defaultdict[tuple[str, Configuration], list[float]] = defaultdict(list)
    for file, c, _, amplitude, tau in rows:
        if amplitude == 0 and math.isfinite(tau):
            for where in (file, ""):
                base[where, c].append(abs(tau))
    out: dict[int, list[tuple[int, int, float]]] = {j: [] for j in predicted.candidates}
    for file, c, frequency, amplitude, tau in rows:
        row = AmplitudeRow(c.joint, frequency, amplitude)
        at = predicted.find(row, same) if amplitude else None
        if at is not None:
            taus = base[file, c] or base["", c] or [predicted.base_nm[c]]
            ratio = abs(tau) / float(np.mean(taus))
            out[c.joint].append((at, CONFIGURATIONS.index((c.load, c.direction)), ratio))
    found = {j: Readings(len(c), out[j]) for j, c in predicted.candidates.items()}
    return found, [c for c in sorted(predicted.base_nm) if not base["", c]]
