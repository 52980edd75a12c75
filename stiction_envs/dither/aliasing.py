"""Aliasing of dither at a controller that holds its command."""

from __future__ import annotations

import numpy as np

from stiction_envs.errors import StictionError


def alias(frequency_hz: float, rate_hz: float) -> float:
    """Frequency [Hz] that a sine has at a controller that holds its command at ``rate_hz``.

    0 means that every sample is the same: a constant torque A·sin φ. At half the rate the samples
    are ±A·sin φ. Harmonics of the other waveforms alias by the same rule.

    Raises:
        StictionError: a frequency or rate that is not above 0.
    """
    for what, value in (("frequency", frequency_hz), ("controller rate", rate_hz)):
        if not (np.isfinite(value) and value > 0):
            raise StictionError(f"{what} {value} Hz: expected > 0")
    return float(abs(frequency_hz - rate_hz * np.rint(frequency_hz / rate_hz)))


def check_frequency(frequency_hz: float, rate_hz: float) -> str | None:
    """Warning where a controller of ``rate_hz`` [Hz] aliases a sine of ``frequency_hz`` [Hz].

    None below half the rate; one line from there up to the rate itself (the thesis commanded 100
    and 200 Hz on the iiwa, whose driver runs at 200 Hz by default); an error above it.
    """
    shown = alias(frequency_hz, rate_hz)
    f, r = f"{frequency_hz:g} Hz", f"{rate_hz:g} Hz"
    if frequency_hz > rate_hz:
        raise StictionError(f"dither frequency {f} at a {r} controller: expected at most {r}")
    if 2 * frequency_hz < rate_hz:
        return None
    if 2 * frequency_hz == rate_hz:
        return f"dither of {f} at a {r} controller sits at Nyquist: samples are ±A·sin φ"
    if shown == 0:
        return f"dither of {f} at a {r} controller aliases to a constant offset A·sin φ"
    return f"dither of {f} at a {r} controller aliases to {shown:g} Hz"
