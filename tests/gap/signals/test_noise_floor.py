"""The noise floor of torques that passed a low-pass before they were logged."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from stiction_envs.gap.signals.noise_floor import slow_noise
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.measured.logs.reader import JointLog
from tests.gap.small_logs import RATE, data_of, hidden, panda

ARM = panda()
SECONDS = 40.0


def noise_behind(corner: float, order: int, seed: int = 0, sd: float = 0.3) -> np.ndarray:
    """(T, 7) white noise of ``sd`` [N·m] behind a causal low-pass [Hz]; 0 for none."""
    rng = np.random.default_rng(seed)
    white = sd * rng.normal(size=(round(SECONDS * RATE) + 1000, 7))
    if corner:
        white = sosfilt(butter(order, corner, fs=RATE, output="sos"), white, axis=0)
    return white[1000:]


def noisy(noise: np.ndarray) -> JointLog:
    """A log of the rigid arm with such noise."""
    return hidden(ARM, lambda q, dq, ddq: noise, noise=0.0, seconds=SECONDS)


@pytest.mark.parametrize(("corner", "order"), [(0, 1), (5, 1), (5, 2), (10, 1), (10, 2), (30, 2)])
def test_slow_noise_is_found_whatever_low_pass_it_passed(corner: float, order: int) -> None:
    """Limit case: of white noise it is the noise itself."""
    data = data_of(ARM, noisy(noise_behind(corner, order)))
    true = data.smooth(noise_behind(corner, order))[: len(data.t)].std(axis=0)
    found, start = slow_noise(data.recording, data.residual, 0.5)
    assert found == pytest.approx(true, rel=0.15)
    assert found.mean() == pytest.approx(true.mean(), rel=0.05)
    assert (start < 3.0).all()


def test_in_the_band_of_the_motion_nobody_can_tell_noise() -> None:
    """What is flat there may be what the model gets wrong: a real robot's was called explained."""
    data = data_of(ARM, noisy(noise_behind(5.0, 1)))
    found, start = slow_noise(data.recording, data.residual, 3.0)
    assert np.isnan(found).all()
    assert np.isnan(start).all()


def test_a_low_pass_is_seen_where_rounding_hides_it() -> None:
    """Torques of two digits, whose noise is all below what the rounding makes."""
    log = noisy(noise_behind(3, 2))
    rounded = JointLog(source="x", t=log.t, q=log.q, dq=None, tau=np.round(log.tau, 2))
    assert prepare([rounded], cutoff_hz=20.0).low_passed.all()
