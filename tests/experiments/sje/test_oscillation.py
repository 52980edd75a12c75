"""Oscillation of a joint: limit cases with known answers."""

import numpy as np
import pytest

from stiction_envs.experiments.sje.episodes import Oscillation

TIME = np.arange(1, 4001) * 1e-3
IDS = np.arange(2)


def fed(angle: np.ndarray, block: int = 50, **arguments: float) -> Oscillation:
    """Two arms of three joints; the first does ``angle`` (K, 3) from where it rests."""
    out = Oscillation(2, 3, **{"corner": 3.0, "far": 0.03, **arguments})
    rest = np.array([[1.0, -2.0, 0.5], [0.0, 0.0, 0.0]])
    out.start(IDS, rest, np.array([1, 0]))
    moved = np.stack([angle, np.zeros_like(angle)]) + rest[:, None]
    for k in range(0, len(angle), block):
        out.begin_step(IDS)
        out.add(IDS, moved[:, k : k + block])
    return out


def sines(*amplitudes: float, frequency: float = 20.0) -> np.ndarray:
    return np.array(amplitudes) * np.sin(2 * np.pi * frequency * TIME)[:, None]


@pytest.mark.parametrize(("frequency", "gain"), [(5.0, 0.885), (20.0, 1.0), (100.0, 1.0)])
def test_a_sine_counts_by_its_root_mean_square(frequency, gain):
    out = fed(sines(1e-3, 0, 0, frequency=frequency))
    assert out.episode_rms(IDS) == pytest.approx([gain * 1e-3 / np.sqrt(2), 0.0], rel=0.02)


def test_creep_and_running_away_do_not_count():
    """A joint that creeps, and one that speeds up with t³ to 30 mrad in its last second."""
    creep = np.zeros((4000, 3))
    creep[:, 1] = 5e-3 * TIME / 4
    assert fed(creep).episode_rms(IDS)[0] < 1e-5
    away = np.zeros((4000, 3))
    away[:, 1] = 0.03 * np.maximum(TIME - 3, 0) ** 3
    assert fed(away).episode_rms(IDS)[0] < 3e-5


def test_nothing_counts_once_the_tested_joint_is_far():
    angle = sines(0.0, 1e-3, 1e-3)
    angle[2000:, 1] += 0.05
    angle[3000:, 1] -= 0.05  # nor when it comes back
    out, before = fed(angle), fed(angle[:2000])
    assert out.episode_rms(IDS)[0] == before.episode_rms(IDS)[0]
    assert out.step_mean_square(IDS)[0] == 0
    angle[:, [1, 2]] = angle[:, [2, 1]]
    elsewhere = fed(angle)  # another joint may be anywhere
    assert elsewhere.episode_rms(IDS)[0] > before.episode_rms(IDS)[0]
