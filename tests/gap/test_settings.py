"""A user's own constants reach every stage of a diagnosis, and are known by their hash."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.gap.settings import gap_settings
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.method_settings import fingerprint
from tests.gap.small_logs import hidden, panda

ARM = panda()


@pytest.fixture(scope="module")
def log() -> JointLog:
    """An offset of 1 N·m on joint 2."""
    return hidden(ARM, lambda q, dq, ddq: np.eye(7)[1] + 0 * q, seconds=8.0)


def found(log: JointLog, settings=None) -> Diagnosis:
    return diagnose_logs([log], ARM, causes=[cause_named("torque_offset")], settings=settings)


@pytest.fixture(scope="module")
def usual(log) -> Diagnosis:
    return found(log)


def test_the_defaults_name_the_offset(usual):
    assert [(c.name, c.joints) for c in usual.causes] == [("torque_offset", (2,))]
    assert usual.settings == gap_settings()


@pytest.mark.parametrize(
    ("settings", "changed"),
    [
        ({"selection.least_torque": 1e6}, lambda d: not d.causes),
        ({"verdict": {"close": 1e-3, "small": 1e-9}}, lambda d: d.verdict == "partly explained"),
        ({"measured.motion.travel_span": 100.0}, lambda d: d.verdict == "cannot tell"),
        ({"recording": {"blocks": 5}}, lambda d: d.data.blocks == 5),
        ({"estimates.model_error": 0.5}, lambda d: interval(d) > 0.5),
        ({"noise.least_noise": 0.7}, lambda d: (d.noise >= 0.7).all()),
    ],
)
def test_a_changed_constant_is_felt(log, usual, settings, changed):
    d = found(log, settings)
    assert changed(d)
    assert not changed(usual)
    assert fingerprint(d.settings) != fingerprint(gap_settings())


def interval(d: Diagnosis) -> float:
    low, high = d.causes[0].parameters[2]["offset_nm"].ci95
    return high - low


def test_a_toml_holds_them(log, tmp_path):
    (tmp_path / "own.toml").write_text("[selection]\nleast_torque = 1e6\n", "utf-8")
    assert not found(log, tmp_path / "own.toml").causes


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"selection.chanse": 0.1}, r"selection\.chanse: no such setting: expected one of"),
        ({"causes": {"payload": {"mass": 1}}}, "settings: causes: no such setting: expected"),
        ({"selection.chance": -1}, r"selection\.chance is -1: expected"),
    ],
)
def test_a_constant_that_nothing_has_is_one_clear_line(log, settings, says):
    with pytest.raises(StictionError, match=says):
        found(log, settings)
