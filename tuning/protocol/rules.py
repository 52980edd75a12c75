"""Choices of the thesis's protocol as rules: which frequencies, which amplitude, and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.measured import AmplitudeRow
from stiction_envs.robots.arm_toml import lookup
from stiction_envs.robots.registry import ARMS
from tuning.settings import ThesisSettings, tuning_settings


def frequencies_of(robot: str | None, settings: ThesisSettings) -> tuple[float, ...]:
    """Return the frequencies [Hz] to try on a robot: its TOML's, else the settings'."""
    known = ARMS.get(str(robot))
    own = None if known is None else lookup(known.table, "tuning.frequencies_hz")
    return settings.frequencies_hz if own is None else tuple(own)


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Choice for one joint, and its basis."""

    row: AmplitudeRow
    """Final dither; amplitude 0 if none reduced the torque."""
    scale: float
    """Best amplitude over base torque at that frequency [-]."""
    intermediate: Array
    """(2, 2) amplitude of each configuration, scale × |base|: [load, no load] × [+, −] [N·m]."""
    reason: str


def final_amplitude(
    intermediate: Array,
    half_width: float,
    *,
    frequency_hz: float,
    torque_rate: float,
    settings: ThesisSettings | None = None,
) -> tuple[float, str]:
    """Return the final amplitude [N·m] of a joint and the reason for it (thesis Table 4.9).

    It is the largest of the four configurations, but no candidate above `cap_half_widths` friction
    half-widths, as the thesis chose by hand for joint 2. It never exceeds the torque-rate limit.

    Args:
        intermediate: amplitudes of the configurations, any shape [N·m].
        half_width: friction half-width of the joint in its freest pose [N·m].
        frequency_hz: dither frequency [Hz].
        torque_rate: limit of the torque rate [N·m/s]; inf for none.
        settings: None for those of ``settings.toml``.
    """
    s = settings or tuning_settings().thesis
    candidates = np.sort(np.abs(np.ravel(intermediate)))[::-1]
    cap = s.cap_half_widths * half_width
    kept = candidates[candidates <= cap]
    if len(kept) == len(candidates):
        amplitude, reason = float(candidates[0]), "largest of the four configurations"
    elif len(kept):
        amplitude = float(kept[0])
        reason = f"largest of the four up to {cap:.3f} N·m; {candidates[0]:.3f} N·m was dropped"
    else:
        amplitude, reason = float(cap), f"capped at {cap:.3f} N·m, all four were above"
    fastest = torque_rate / (2 * np.pi * frequency_hz)
    if amplitude > fastest:
        amplitude = float(fastest)
        reason = f"limited to {fastest:.3f} N·m by the torque rate of {torque_rate:.0f} N·m/s"
    return amplitude, reason
