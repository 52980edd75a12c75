"""The study of a real SO-101: its simulations in stock MuJoCo, and its page."""

import mujoco
import numpy as np

from benchmarks.servo import servo_friction as study
from stiction_envs.gap.servo.servo_mjcf import servo_mjcf
from stiction_envs.measured.logs.robot_log import ServoLog
from tests.servo_arm import LOAD, STICTION, joint_parameters, servo_arm


def test_frictionloss_creeps_at_default_settings_and_holds_at_the_hardest(tmp_path):
    arm, _ = servo_arm(tmp_path)
    xml, _ = servo_mjcf(arm, joint_parameters(), LOAD)
    t = np.arange(0.0, 6.0, 0.02)
    # hanging, where gravity is zero, off its command by less than friction holds
    command = np.tile([np.pi / 2, 0.0], (len(t), 1))
    log = ServoLog(source="a", t=t, q=command + 0.006, dq=None, q_cmd=command)
    models = [study.with_frictionloss(xml, np.array(STICTION), hard=hard) for hard in (False, True)]
    models.append(mujoco.MjModel.from_xml_string(xml))
    default, hard, lugre = (study.follow(m, log, np.zeros(2)) for m in models)
    assert abs(default[-1] - log.q[0]).max() > 3e-3
    assert abs(hard[-1] - log.q[0]).max() < 1e-3
    # bristles start relaxed and give at first
    assert abs(lugre[-1] - lugre[50]).max() < 1e-4
    assert abs(lugre[-1] - command[0]).min() > 3e-3


def test_the_page_has_every_model_and_both_groups(tmp_path):
    names = (study.OBEYS, study.LUGRE, study.DEFAULT, study.HARD, study.PLANT)
    errors = {
        group: {name: np.full(6, 1.0 + k) for k, name in enumerate(names)}
        for group in ("left out", "left out, fast")
    }
    options = study.STUDY.parser().parse_args(["--out", str(tmp_path)])
    text = study.STUDY.write_page(options, **study.page(errors))
    assert all(text.count(f"| {name} |") == 2 for name in names)
    assert "to 2.0 mrad" in text
    t = np.arange(0.0, 20.0, 0.02)
    shown = {study.LUGRE: 0 * t, study.DEFAULT: 0 * t + 0.05, "measured": 0 * t + 0.01, "t": t}
    study.draw(shown, tmp_path / study.PICTURE)
    assert (tmp_path / study.PICTURE).stat().st_size > 5000
