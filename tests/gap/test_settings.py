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
        ({"measured.motion.travel_span": 100.0}, lambda d: d.verdict == "cannot tell"),
        ({"recording": {"blocks": 5}}, lambda d: d.data.blocks == 5),
    ],
)
def test_a_changed_constant_is_felt(log, usual, settings, changed):
    d = found(log, settings)
    assert changed(d)
    assert not changed(usual)
    assert fingerprint(d.settings) != fingerprint(gap_settings())


def test_a_toml_holds_them(log, tmp_path):
    (tmp_path / "own.toml").write_text("[recording]\nblocks = 5\n", "utf-8")
    assert found(log, tmp_path / "own.toml").data.blocks == 5


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"recording.block": 5}, r"recording\.block: no such setting: expected one of"),
        ({"causes": {"payload": {"mass": 1}}}, "settings: causes: no such setting: expected"),
        ({"recording.blocks": -1}, r"recording\.blocks is -1: expected"),
    ],
)
def test_a_constant_that_nothing_has_is_one_clear_line(log, settings, says):
    with pytest.raises(StictionError, match=says):
        found(log, settings)
