"""Compiled code against the same code in Python, where every index is checked."""

import numpy as np

from stiction_envs.control import impedance, operational, rotation
from stiction_envs.control.impedance import ImpedanceSettings
from stiction_envs.robots import load_arm
from tests.control import rig
from tests.control.rig import Controllers, Look, poses

ROWS = np.array([3, 17])


def commands() -> np.ndarray:
    """(5, 2, 7) torques of two arms, with everything a controller can do [N·m]."""
    settings = ImpedanceSettings(nullspace_stiffness=5.0, torque_rate=3.0)
    look = Look(*(part[ROWS] for part in poses()))
    control = Controllers(settings, 2, load_arm("panda").limits)
    control.reset(np.arange(2), look.position, look.quaternion, look.q + 0.1)
    control.update_model(look.jacobian, look.mass)
    control.set_reference(look.position + 0.05, np.roll(look.quaternion, 1, axis=0))
    dither = np.random.default_rng(5).normal(size=(2, 7))
    return np.array([control.torque(*look[:5], dither=dither) for _ in range(5)])


def test_compiled_code_stays_within_its_arrays(monkeypatch):
    """numba reads and writes past their ends without a word; Python raises."""
    compiled = commands()
    for module in (impedance, operational, rotation, rig):
        for name, function in list(vars(module).items()):
            if hasattr(function, "py_func"):
                monkeypatch.setattr(module, name, function.py_func)
    with np.errstate(all="ignore"):  # compiled code does not warn
        np.testing.assert_allclose(commands(), compiled, rtol=1e-9, atol=1e-9)
    assert np.abs(np.diff(compiled, axis=0)).max() > 0.1
