import numpy as np
import pytest

from stiction_envs.gap.servo.fit import fit
from stiction_envs.gap.servo.parameters import INDEX
from tests.gap.servo.small_arm import motion, parameters


def _commands() -> np.ndarray:
    t = 0.01 * np.arange(2000)
    return 0.3 * np.sin(2 * np.pi * 0.2 * t) + 0.1 * np.sin(2 * np.pi * 1.1 * t)


def test_a_fit_recovers_what_made_a_log() -> None:
    truth = parameters(damping=0.9, stiction=0.25, delay=0.012, armature=0.03)
    command = _commands()
    log = motion(command, q=motion(command).simulate(truth[None])[0])
    found = fit(
        log,
        parameters(damping=0.5, stiction=0.1),
        ("damping", "stiction", "delay", "armature"),
        iterations=40,
    )
    assert np.sqrt(np.mean(found.error**2)) < 2e-4
    for name, off in (("damping", 0.03), ("stiction", 0.01), ("delay", 2e-3), ("armature", 0.01)):
        assert found.parameters[INDEX[name]] == pytest.approx(truth[INDEX[name]], abs=off)
