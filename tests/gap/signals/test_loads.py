"""What the torques of a log say about its mounting, signs and sensors, on an arm of any size."""

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.robots import Arm, load_arm
from tests.gap.signals.test_torque import shown
from tests.gap.small_logs import hidden

LENGTHS, MASSES, TORQUES = (0.3, 0.4, 0.3, 0.1), (4.0, 3.0, 1.5, 0.7), (87.0, 87.0, 30.0, 12.0)
AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0")
FRICTION = np.array([2.0, 3.0, 1.0, 0.5])


def arm_of(folder, size: float, tilt: float = 0.0) -> Arm:
    """Four joints whose masses and torques are ``size`` times those of a small industrial arm."""
    text = ""
    for k in range(4):
        text += (
            f'<body pos="{LENGTHS[k - 1] if k else 0} 0 0"><joint name="a{k}" axis="{AXES[k]}" '
            f'range="-3 3" actuatorfrcrange="{-TORQUES[k] * size} {TORQUES[k] * size}"/>'
            f'<geom type="capsule" fromto="0 0 0 {LENGTHS[k]} 0 0" size=".04" '
            f'mass="{MASSES[k] * size}"/>'
        )
    path = folder / f"arm_{size}.xml"
    path.write_text(f"<mujoco><worldbody>{text}{4 * '</body>'}</worldbody></mujoco>")
    return load_arm(path, tilt=(tilt, 0.0))


@pytest.mark.parametrize("size", [0.02, 1.0, 1000.0])
def test_defects_of_torques_are_found_on_an_arm_of_any_size(tmp_path, size):
    arm, ceiling = arm_of(tmp_path, size), arm_of(tmp_path, size, np.pi)

    def friction(q, dq, ddq):
        return size * FRICTION * np.tanh(dq / 1e-3)

    log = hidden(arm, friction, noise=0.02 * size)
    upright = shown(log, arm)
    assert upright.findings == []
    assert upright.sign.tolist() == [1, 1, 1, 0]  # the last one carries next to nothing
    inverted = shown(replace(log, tau=log.tau * [1, -1, 1, 1]), arm)
    assert inverted.sign.tolist() == [1, -1, 1, 0]
    amperes = shown(replace(log, tau=log.tau / 12.5), arm)
    assert amperes.unit == pytest.approx(1 / 12.5, rel=0.03)
    dead = shown(replace(log, tau=log.tau * [1, 1, 0, 1]), arm)
    assert dead.measured.tolist() == [True, True, False, True]
    hanging = shown(hidden(arm, friction, true=ceiling, noise=0.02 * size), arm)
    assert "mounted on a ceiling" in hanging.findings[0]
