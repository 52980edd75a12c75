"""A cause of servo logs of somebody else's: one class and one call, and it works everywhere."""

from collections.abc import Iterator

import numpy as np
import pytest

from stiction_envs.gap.causes import Cause, Parameter, register, unregister
from stiction_envs.gap.servo.findings import joint_causes, reported_columns
from stiction_envs.gap.servo.joint_search import judge
from stiction_envs.gap.servo.servo_parameters import InServo
from tests.gap.servo.small_arm import parameters
from tests.gap.servo.test_fit import CAUSES, asked, made


class ColdGrease(Cause):
    """Grease of a cold gear: dry friction and damping rise together."""

    name = "cold_grease"
    parameters = (Parameter("grease_nm", "N·m"), Parameter("grease_nms", "N·m·s/rad"))
    servo = InServo(
        sizes={"stiction": 0.03, "damping": 0.1},
        starts=lambda x: [
            {"stiction": 0.01 * x["stiffness"], "damping": x["damping"] + 0.03 * x["stiffness"]}
        ],
        evidence="the joint stops short and is late, as in cold grease of {value:.2g} N·m",
        alike=("coulomb_friction", "damping"),
    )


@pytest.fixture
def outside() -> Iterator[Cause]:
    cause = register(ColdGrease())
    yield cause
    unregister(cause.name)


def test_a_registered_cause_is_named_on_its_joint_in_place_of_two(outside: Cause) -> None:
    truth = {"stiction": 0.3, "damping": 1.6}
    found = judge(asked(made(**truth), CAUSES | {outside.name: outside.servo}))
    assert set(found.causes) == {outside.name}
    (cause,) = joint_causes({1: found}, np.array([0.1, 0.1]))
    assert (cause.name, cause.joints) == (outside.name, (2,))
    for value, estimate in zip(truth.values(), cause.parameters[2].values(), strict=True):
        low, high = estimate.ci95
        assert low < value < high < 1.3 * low
    assert cause.evidence.endswith("as in cold grease of 0.3 N·m")
    assert set(cause.confused_with) >= {"coulomb_friction", "damping"}
    columns = reported_columns(parameters(**truth)[None])
    assert (columns["grease_nm"], columns["grease_nms"]) == (0.3, 1.6)
