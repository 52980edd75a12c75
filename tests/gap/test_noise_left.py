"""The noise floor of a diagnosis: that of torques which were low-passed before they were logged."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.gap.signals.prepare import lowpass
from tests.gap.signals.test_noise_floor import ARM, SECONDS, noise_behind
from tests.gap.small_logs import hidden, sliding

CAUSES = [cause_named(x) for x in ("coulomb_friction", "viscous_friction")]


def rubbing(noise: np.ndarray, drag: float = 0.6):
    """A log with dry and viscous friction, and a noise."""
    return hidden(
        ARM, lambda q, dq, ddq: drag * sliding(q) + dq + noise, noise=0.0, seconds=SECONDS
    )


@pytest.mark.parametrize("order", [1, 2])
def test_the_floor_of_low_passed_torques_is_that_of_their_noise(order: int) -> None:
    """A low-pass of 5 Hz; the floor beside the band has a half of it or less."""
    noise = noise_behind(5.0, order)
    found = diagnose_logs([rubbing(noise)], ARM, causes=CAUSES)
    data = found.data
    true = lowpass(noise, 1 / data.dt, data.cutoff).std(axis=0)
    assert (data.noise < 0.8 * true).all()
    assert found.noise == pytest.approx(true, rel=0.2)
    assert found.verdict == "explained"
    assert any("low-passed before they were logged" in x for x in found.notes)


def test_the_floor_of_white_noise_is_as_it_was() -> None:
    found = diagnose_logs([rubbing(noise_behind(0.0, 1))], ARM, causes=CAUSES)
    assert (found.noise == found.data.noise).all()
    assert not any("low-passed" in x for x in found.notes)


def test_a_floor_that_friction_hides_is_called_a_lower_bound() -> None:
    """Noise of 1 mN·m behind 5 Hz, under friction that nothing explains."""
    log = rubbing(noise_behind(5.0, 2, sd=1e-3))
    found = diagnose_logs([log], ARM, causes=[cause_named("base_tilt")])
    assert any("lower bound" in x for x in found.notes)
    assert found.verdict != "explained"
