"""Both models in stock MuJoCo along held-out windows: no NaN, or a reason."""

import xml.etree.ElementTree as ET
from contextlib import suppress
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.gap.extended_model import Extension, extend
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.validation import forward
from stiction_envs.gap.validation.forward import ForwardValidation, silent_engine, validate_forward
from stiction_envs.robots import Arm, load_arm
from tests.gap.small_logs import hidden, sliding

DRY = np.array([1.0, 0.6, 0.5, 0.6, 0.4, 0.2, 0.3])


@pytest.fixture(scope="module")
def upright() -> Arm:
    """An arm whose joints 1, 3, 5 and 7 are in line, as in the measured iiwa's sweeps."""
    return replace(load_arm("iiwa14"), rest=np.array([0.0, 0.05, 0.0, -0.05, 0.0, 0.05, 0.0]))


@pytest.fixture(scope="module")
def stretched(upright) -> Diagnosis:
    bent = load_arm("iiwa14")
    log = hidden(upright, lambda q, dq, ddq: DRY * sliding(q), noise=0.02, seconds=10.0)
    # the model is that of the bent arm: the pose of its rest says nothing of the logs'
    return diagnose_logs([log], bent, causes=[cause_named("coulomb_friction")])


def test_a_stretched_arm_follows_its_log(stretched, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    result = validate_forward(stretched, threads=1)
    assert isinstance(result, ForwardValidation)
    assert result.unstable == ""
    for errors in (result.replay, result.tracking):
        assert all(np.isfinite(x).all() for x in errors.values())
    assert result.gains[1].mean() > 50
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def test_an_unstable_model_is_a_reason_and_no_result(stretched, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)

    def damped(base: Data, model: Nominal) -> Extension:
        """The extended model with bristles that no step of 1 ms can hold."""
        made = extend(base, model)
        if not model.parts:
            return made
        root = ET.fromstring(made.xml)
        for motor in root.iter("dcmotor"):
            stiffness, damping, *rest = motor.attrib["lugre"].split()
            motor.set("lugre", " ".join([stiffness, str(100 * float(damping)), *rest]))
        return replace(made, xml=ET.tostring(root, encoding="unicode"))

    monkeypatch.setattr(forward, "extend", damped)
    result = validate_forward(stretched, threads=1)
    assert isinstance(result, str)
    assert "the simulation is unstable" in result
    assert "nominal" not in result
    assert "the extended model in" in result
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def test_the_engine_speaks_again_after_an_error():
    before = mujoco.MjLogConfig.get()
    with suppress(ValueError), silent_engine():
        assert not mujoco.MjLogConfig.get().logto_file
        raise ValueError("stop")
    after = mujoco.MjLogConfig.get()
    assert (after.logto_file, after.logto_console) == (before.logto_file, before.logto_console)
