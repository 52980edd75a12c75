"""A model is judged by what it leaves on held-out time, and by the joints that move."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from stiction_envs.gap.servo.questions import Servo
from stiction_envs.gap.servo.servo_diagnosis import _Joints
from stiction_envs.measured.logs.robot_log import ServoLog
from tests.gap.servo.small_arm import two_links

FOUND = {j: SimpleNamespace(causes={"coulomb_friction": 1e-3}) for j in range(2)}


def _joints(folder: Path, workers: ThreadPoolExecutor, second: float) -> _Joints:
    t = np.arange(0.0, 4.0, 0.02)
    command = np.stack([0.4 * np.sin(2.0 * t), second * np.sin(3.0 * t)], axis=1)
    log = ServoLog(source="plan.csv", t=t, q=command.copy(), dq=None, q_cmd=command)
    joints = _Joints([log], two_links(folder), Servo(), workers, lambda *_: None)
    joints.found = FOUND
    return joints


def test_a_joint_that_the_model_makes_worse_has_no_causes(tmp_path: Path) -> None:
    nominal = np.array([1e-2, 1e-3])
    with ThreadPoolExecutor() as workers:
        joints = _joints(tmp_path, workers, 0.3)
        assert joints.helped(nominal, 0.5 * nominal) == [0, 1]
        assert joints.notes == []
        assert joints.helped(nominal, np.array([1e-3, 1.5e-3])) == [0]
        assert "joint 2: on held-out time the model is worse" in joints.notes[0]
        assert joints.helped(nominal, np.array([1e-3, 3e-3])) == []
        assert "nothing is named" in joints.notes[1]


def test_a_joint_that_rests_decides_nothing(tmp_path: Path) -> None:
    """A servo of unknown stiffness may sag where a perfect one stands: 10 mrad against none."""
    with ThreadPoolExecutor() as workers:
        joints = _joints(tmp_path, workers, 0.0)
        assert joints.helped(np.array([1e-2, 0.0]), np.array([1e-3, 1e-2])) == [0]
