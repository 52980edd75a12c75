"""Bounds of a search: amplitudes and frequencies of every joint, and what is forbidden.

A setting's amplitude is drawn as a share of the largest one *at its frequency*, so that no setting
passes the limits of torque and torque rate. A frequency that is drawn in a forbidden band
(resonances) moves to the band's nearest end.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from optuna.distributions import BaseDistribution, FloatDistribution

from stiction_envs.arrays import Array
from stiction_envs.dither.tables import shipped_table
from stiction_envs.errors import StictionError, checked_array, unknown
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.measured.tables import AmplitudeRow, read_amplitudes
from stiction_envs.measured.thesis_tables import thesis_robots
from stiction_envs.robots.arm_toml import read_toml
from tuning.protocol.stages import frequencies_of
from tuning.settings import BoundsSettings, TuningSettings, tuning_settings
from tuning.study.record import Parameters

Table = tuple[AmplitudeRow, ...]
BELOW_NYQUIST = 0.9
"""Highest frequency without a user's file over half the controller's rate [-] (assumed)."""
TRIED = 2000  # Frequencies checked to find those outside forbidden bands (assumed)
PER_JOINT = ("amplitude_nm", "frequency_hz", "displacement_rad", "forbidden_hz")
WHOLE_ARM = ("vibration_mm", "vibration_at_rest_mm")


@dataclass(frozen=True, kw_only=True, eq=False)
class Bounds:
    """Range of a search on an arm of n joints."""

    amplitude_nm: Array  # (n, 2) [N·m]
    frequency_hz: Array  # (n, 2) [Hz]
    torque_rate: Array  # (n,) [N·m/s]; inf is no limit
    forbidden_hz: tuple[tuple[tuple[float, float], ...], ...]
    """Per joint, bands that no setting may lie in [Hz]."""
    displacement_rad: Array
    """(n,) largest oscillation of a joint in the SJE, root mean square [rad]; NaN: a table's."""
    vibration_m: tuple[float, float]
    """Largest vibration in the GTE, moving and at rest, root mean square [m]; NaN: a table's."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.torque_rate)

    def largest(self, joint: int, frequency_hz: float) -> float:
        """Return the largest amplitude of a joint (from 1) at a frequency [N·m]."""
        rate = self.torque_rate[joint - 1] / (2 * np.pi * frequency_hz)
        return float(min(self.amplitude_nm[joint - 1, 1], rate))

    def forbidden(self, joint: int, frequency_hz: float) -> bool:
        """Return whether a frequency lies in a forbidden band."""
        return any(low < frequency_hz < high for low, high in self.forbidden_hz[joint - 1])

    def space(self, joint: int) -> dict[str, BaseDistribution]:
        """Return the parameters of one joint's setting and their ranges."""
        low, high = self.frequency_hz[joint - 1]
        return {
            "frequency_hz": FloatDistribution(float(low), float(high), log=True),
            "amplitude": FloatDistribution(0.0, 1.0),
        }

    def setting(self, joint: int, parameters: Parameters) -> AmplitudeRow:
        """Return the dither that parameters of `space` describe."""
        frequency = float(parameters["frequency_hz"])
        if self.forbidden(joint, frequency):
            least, most = self.frequency_hz[joint - 1]
            ends = [x for band in self.forbidden_hz[joint - 1] for x in band if least <= x <= most]
            free = [x for x in ends if not self.forbidden(joint, x)]
            frequency = min(free, key=lambda x: abs(x - frequency))
        low, high = self.amplitude_nm[joint - 1, 0], self.largest(joint, frequency)
        amplitude = float(low + parameters["amplitude"] * max(high - low, 0.0))
        return AmplitudeRow(joint, frequency, amplitude)

    def share(self, row: AmplitudeRow) -> dict[str, float]:
        """Return the parameters of `space` that are nearest to a dither."""
        low, high = self.frequency_hz[row.joint - 1]
        frequency = float(np.clip(row.frequency_hz or high, low, high))
        least, most = self.amplitude_nm[row.joint - 1, 0], self.largest(row.joint, frequency)
        share = (row.amplitude_nm - least) / max(most - least, 1e-12)
        return {"frequency_hz": frequency, "amplitude": float(np.clip(share, 0.0, 1.0))}

    def beyond(self, row: AmplitudeRow) -> str | None:
        """Return which bound a dither exceeds, and what is expected; None for none."""
        low, high = self.frequency_hz[row.joint - 1]
        if not low <= row.frequency_hz <= high:
            return f"frequency_hz is {row.frequency_hz:g}: expected {low:g} to {high:g} Hz"
        if self.forbidden(row.joint, row.frequency_hz):
            bands = ", ".join(f"{a:g} to {b:g}" for a, b in self.forbidden_hz[row.joint - 1])
            return f"frequency_hz is {row.frequency_hz:g}: expected outside of {bands} Hz"
        least = max(self.amplitude_nm[row.joint - 1, 0], 0.0)
        most = self.largest(row.joint, row.frequency_hz)
        if row.amplitude_nm > 0 and least <= row.amplitude_nm <= most:
            return None
        return f"amplitude_nm is {row.amplitude_nm:g}: expected {least:.3g} to {most:.3g} N·m there"

    def met(self, row: AmplitudeRow, tolerance: float = 0.01) -> list[str]:
        """Return which bounds a setting lies on, in words; ``tolerance`` is relative (assumed)."""
        low, high = self.frequency_hz[row.joint - 1]
        most = self.largest(row.joint, row.frequency_hz) if row.frequency_hz else np.inf
        out = []
        if row.amplitude_nm and row.frequency_hz <= low * (1 + tolerance):
            out.append(f"lowest frequency {low:g} Hz")
        if row.amplitude_nm and row.frequency_hz >= high * (1 - tolerance):
            out.append(f"highest frequency {high:g} Hz")
        if row.amplitude_nm >= most * (1 - tolerance):
            rate = most < self.amplitude_nm[row.joint - 1, 1]
            out.append("torque rate" if rate else f"largest amplitude {most:.3g} N·m")
        return out


def base_torques(experiment: SingleJointExperiment) -> Array:
    """Return the largest base torque of every joint that its friction predicts (n,) [N·m]."""
    out = np.zeros(experiment.n)
    for job in experiment.jobs():
        j = job.configuration.joint - 1
        out[j] = max(out[j], experiment.expected(job))
    return out


def bounds_of(
    experiment: SingleJointExperiment,
    file: Path | str | None = None,
    settings: BoundsSettings | None = None,
) -> Bounds:
    """Return the bounds of an arm, changed by a user's file.

    The TOML has ``[all]``, ``[joint.N]`` (`PER_JOINT`) and ``[arm]`` (`WHOLE_ARM`).

    Raises:
        StictionError: a file that cannot be read, or bounds that leave nothing.
    """
    s = tuning_settings().bounds if settings is None else settings
    n, arm, base = experiment.n, experiment.sticking.arm, base_torques(experiment)
    half = experiment.interface.controller_rate_hz / 2
    low, high = s.frequency_hz
    amplitude = np.minimum(s.largest_scale * base, arm.limits.torque)
    out = Bounds(
        amplitude_nm=np.stack([np.zeros(n), amplitude], axis=1),
        frequency_hz=np.tile([low, min(high, BELOW_NYQUIST * half)], (n, 1)),
        torque_rate=np.array(experiment.interface.torque_rate),
        forbidden_hz=((),) * n,
        displacement_rad=np.full(n, np.nan),
        vibration_m=(np.nan, np.nan),
    )
    if file is not None:
        out = _changed(out, Path(file), arm.limits.torque, half)
    for j in range(n):
        f_low, f_high = out.frequency_hz[j]
        a_low, a_high = out.amplitude_nm[j]
        where = f"{'bounds' if file is None else file}: joint {j + 1}"
        if not 0 < f_low < f_high:
            raise StictionError(
                f"{where}: frequencies from {f_low:g} to {f_high:g} Hz: expected 0 < low < high"
            )
        if not 0 <= a_low < a_high or out.largest(j + 1, float(f_low)) <= a_low:
            raise StictionError(
                f"{where}: amplitudes from {a_low:g} to {out.largest(j + 1, float(f_low)):g} N·m "
                "leave nothing: expected 0 <= low < high within torque and torque rate"
            )
        tried = np.geomspace(f_low, f_high, TRIED)
        if all(out.forbidden(j + 1, float(f)) for f in tried):
            raise StictionError(
                f"{where}: forbidden_hz leaves no frequency from {f_low:g} to {f_high:g} Hz"
            )
    return out


def reference_tables(
    experiment: SingleJointExperiment, bounds: Bounds, settings: TuningSettings
) -> dict[str, Table]:
    """Return the tables to compare a search with, by name; the first limits it.

    They are the thesis's and the protocol's. Other arms get the protocol's rule of thumb: the base
    torque at its second lowest frequency, or at its only one.
    """
    robot, out = experiment.sticking.arm.registered_name, {}
    if robot in thesis_robots("4.9"):
        out["Table 4.9"] = thesis_final_dither()
    if (shipped := shipped_table(robot)) is not None:
        out["make tune"] = tuple(read_amplitudes(shipped, n_joints=experiment.n))
    if not out:
        frequency = sorted(frequencies_of(robot, settings.thesis))[:2][-1]
        out["base torque"] = tuple(
            AmplitudeRow(j, frequency, min(base, bounds.largest(j, frequency)))
            for j, base in enumerate(base_torques(experiment).tolist(), 1)
        )
    return out


def _changed(bounds: Bounds, file: Path, torque_limit: Array, half_rate: float) -> Bounds:
    """Return bounds changed by a user's file; a joint's own table overrides ``[all]``."""
    table = read_toml(file)
    every, joints, arm = (table.get(name, {}) for name in ("all", "joint", "arm"))
    numbers = tuple(str(j + 1) for j in range(bounds.n))
    _check_names(table, f"{file}: ", "table", ("all", "joint", "arm"))
    _check_names(every, f"{file}: [all]: ", "key", PER_JOINT)
    _check_names(joints, f"{file}: ", "[joint]", numbers)
    _check_names(arm, f"{file}: [arm]: ", "key", WHOLE_ARM)
    amplitude, frequency = bounds.amplitude_nm.copy(), bounds.frequency_hz.copy()
    displacement, forbidden = bounds.displacement_rad.copy(), list(bounds.forbidden_hz)
    for j, name in enumerate(numbers):
        own = joints.get(name, {})
        _check_names(own, f"{file}: [joint.{name}]: ", "key", PER_JOINT)
        mine = {**every, **own}
        where = f"{file}: joint {name}: "
        if "amplitude_nm" in mine:
            amplitude[j] = _pair(mine["amplitude_nm"], f"{where}amplitude_nm")
            if amplitude[j, 1] > torque_limit[j]:
                raise StictionError(
                    f"{where}amplitude_nm is {amplitude[j, 1]:g}: expected at most the torque "
                    f"limit, {torque_limit[j]:g} N·m"
                )
        if "frequency_hz" in mine:
            frequency[j] = _pair(mine["frequency_hz"], f"{where}frequency_hz")
            if frequency[j, 1] >= half_rate:
                raise StictionError(
                    f"{where}frequency_hz is {frequency[j, 1]:g}: expected below half the "
                    f"controller's rate, {half_rate:g} Hz"
                )
        if "displacement_rad" in mine:
            size = mine["displacement_rad"]
            displacement[j] = checked_array(size, f"{where}displacement_rad", (), above=0)
        if "forbidden_hz" in mine:
            bands, place = mine["forbidden_hz"], f"{where}forbidden_hz"
            if not isinstance(bands, list):
                raise StictionError(f"{place} is {bands!r}: expected a list of [low, high]")
            forbidden[j] = tuple(_pair(band, place) for band in bands)
    moving, resting = (
        float(checked_array(arm[key], f"{file}: {key}", (), above=0)) / 1e3 if key in arm else now
        for key, now in zip(WHOLE_ARM, bounds.vibration_m, strict=True)
    )
    return dataclasses.replace(
        bounds,
        amplitude_nm=amplitude,
        frequency_hz=frequency,
        displacement_rad=displacement,
        forbidden_hz=tuple(forbidden),
        vibration_m=(moving, resting),
    )


def _check_names(table: object, where: str, kind: str, known: Sequence[str]) -> None:
    if not isinstance(table, Mapping):
        raise StictionError(f"{where}is {table!r}: expected a table of {', '.join(known)}")
    for name in table:
        if name not in known:
            raise StictionError(f"{where}{unknown(kind, name, known)}")


def _pair(value: object, where: str) -> tuple[float, float]:
    low, high = checked_array(value, where, (2,), expected="[low, high], finite numbers").tolist()
    if not low < high:
        raise StictionError(f"{where} is {value!r}: expected [low, high] with low < high")
    return low, high
