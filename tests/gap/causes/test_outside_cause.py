"""A cause from outside: a class and a line; it is named, written, read back and drawn."""

from typing import ClassVar

import numpy as np
import pytest

from stiction_envs.gap.causes import Cause, Parameter, View, register, unregister
from stiction_envs.gap.diagnosis import diagnose_logs, model_of
from stiction_envs.gap.extended_model import extend
from stiction_envs.gap.report.figures import draw_cause
from tests.gap.small_logs import hidden, panda


class MagneticDetent(Cause):
    """Magnets that pull a joint into twelve places: τ = k sin³(12 q)."""

    name: ClassVar = "magnetic_detent"
    what: ClassVar = "magnets that pull the joint into places"
    what_to_record: ClassVar = "slow motion over a tenth of a turn, there and back"
    parameters: ClassVar = (Parameter("detent_nm", "N·m", low=0.0),)
    view: ClassVar = View(
        "joint angle [rad]", lambda data, joint, shape: data.q[:, joint], note="twelve waves a turn"
    )

    def columns(self, data, joint, shape):
        return data.smooth(np.sin(12 * data.q[:, joint, None]) ** 3)

    def values(self, coefficients, shape):
        return {"detent_nm": float(coefficients[0])}

    def why_not_identifiable(self, data, joint):
        return "" if np.ptp(data.q[:, joint]) > 0.3 else f"joint {joint + 1} turns too little"


@pytest.fixture
def _detent():
    register(MagneticDetent())
    yield
    unregister("magnetic_detent")


@pytest.mark.usefixtures("_detent")
def test_a_cause_from_outside_works_end_to_end(tmp_path):
    fifth = np.eye(7)[4]
    log = hidden(panda(), lambda q, dq, ddq: 0.8 * np.sin(12 * q) ** 3 * fifth)
    found = diagnose_logs([log], "panda")
    (cause,) = found.causes
    assert (cause.name, cause.joints) == ("magnetic_detent", (5,))
    assert cause.parameters[5]["detent_nm"].value == pytest.approx(0.8, abs=0.03)
    made = extend(found.base, model_of(found))
    assert made.missing == ("magnetic_detent of joint 5: MuJoCo's joints have no such thing",)
    (tmp_path / "model.toml").write_text(made.toml(meta={}, provenance={}), "utf-8")
    assert diagnose_logs([log], "panda", nominal=tmp_path / "model.toml").causes == ()
    assert "twelve waves a turn" in draw_cause(found, cause, tmp_path / "cause.png").caption
    assert (tmp_path / "cause.png").stat().st_size > 0
