"""Checks that pictures can be drawn on this machine; their colours."""

import mujoco
import numpy as np
import pytest

from stiction_envs.envs.render.arm_scene import ArmScene
from stiction_envs.errors import StictionError
from stiction_envs.robots import load_arm


def orange(picture: np.ndarray) -> np.ndarray:
    """Return where a picture is coloured as the marker is."""
    r, g, b = (picture[..., k].astype(int) for k in range(3))
    return (r > 150) & (r - g > 50) & (g - b > 30)


def blue(picture: np.ndarray) -> np.ndarray:
    """Return where a picture is coloured as the path is."""
    r, g, b = (picture[..., k].astype(int) for k in range(3))
    return (b - r > 60) & (b > 120) & (g - r > 20)


@pytest.fixture(scope="session")
def gl():
    """OpenGL."""
    scene = ArmScene(load_arm("panda"), 16, 16)
    try:
        scene.picture(mujoco.MjvCamera(), lambda _: None)
    except StictionError as error:
        pytest.skip(str(error))
    scene.close()
