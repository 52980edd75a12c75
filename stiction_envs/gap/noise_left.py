"""The noise floor to which a diagnosis is compared, given what its causes leave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.selection.candidates import Candidate, RegressorLibrary
from stiction_envs.gap.signals.noise_floor import slow_noise
from stiction_envs.gap.signals.prepare import Signals
from stiction_envs.reporting.markdown import joints as joint_list

Array = NDArray[np.float64]


def noise_left(
    library: RegressorLibrary, terms: Sequence[Candidate], c: Array, signals: Signals
) -> tuple[Array, list[str]]:
    """Return (n,) noise floor [N·m], and how that of low-passed torques was found.

    It is the floor before any cause is known. For torques that were low-passed before logging it is
    the larger of this floor and `slow_noise` of what the extended model leaves, with coefficients
    ``c`` (P,) of its terms.
    """
    data = library.data
    noise = np.array(data.noise)
    joints = np.flatnonzero(signals.low_passed)
    if not len(joints):
        return noise, []
    left = np.stack([data.residual[:, j] - library.torque(terms, c, int(j)) for j in joints], 1)
    slow, start = slow_noise(data.recording, left, signals.motion_hz)
    noise[joints] = np.fmax(noise[joints], slow)
    seen, hidden = ((joints[x] + 1).tolist() for x in (np.isfinite(slow), np.isnan(slow)))
    notes = []
    fall = "fall above the filter's band, as if torques were low-passed before they were logged"
    if seen:
        notes.append(
            f"torque spectra of {joint_list(seen)} {fall}: the noise floor is measured in the "
            f"model's residual above {np.nanmax(start):.2g} Hz, with the same density assumed "
            "below, where noise and model error cannot be distinguished"
        )
    if hidden:
        notes.append(
            f"torque spectra of {joint_list(hidden)} {fall}, and the model's residual hides their "
            "noise: the noise floor is a lower bound"
        )
    return noise, notes
