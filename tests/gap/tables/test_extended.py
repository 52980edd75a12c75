"""Causes of torque tables, put into friction: the inverse of `hidden_tables`."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.experiments.poses import find_poses
from stiction_envs.friction.parameters import QUANTITIES
from stiction_envs.gap.judge.judgement import Estimate, NamedCause
from stiction_envs.gap.report.results import extended_friction
from stiction_envs.robots import load_arm
from tests.gap.tables.hidden_tables import Truth, nominal

ARM = load_arm("panda")
JOINT = 5


def cause(name: str, joint: int = JOINT, **values: float) -> NamedCause:
    return NamedCause(
        name=name,
        joints=(joint,),
        parameters={
            joint: {
                k.replace("__", " "): Estimate(value=v, ci95=(v, v), on_bound=False)
                for k, v in values.items()
            }
        },
        gain_percent=10.0,
        evidence="made up",
        confused_with=(),
    )


def same(a, b) -> None:
    for name in QUANTITIES:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    ("truth", "found"),
    [
        ({"rotor_inertia": 2.0}, cause("rotor_inertia", factor=2.0, armature_kgm2=0.3)),
        ({"bristle_stiffness": 0.4}, cause("presliding", factor=0.4)),
        ({"offset_nm": 0.1}, cause("torque_offset", offset_nm=0.1)),
        ({"asymmetry_nm": 0.05}, cause("direction_asymmetry", asymmetry_nm=0.05)),
        # an asymmetry may replace an offset
        (
            {"asymmetry_nm": 0.05, "offset_nm": -0.05},
            cause("direction_asymmetry", asymmetry_nm=0.05, offset_nm=-0.05),
        ),
    ],
)
def test_a_cause_is_put_where_it_was_hidden(truth, found):
    hidden = Truth(joint=JOINT, **truth).friction(nominal(), JOINT, load=1.0)
    friction, changed, missing = extended_friction(ARM, nominal(), (found,))
    same(friction, hidden)
    assert missing == []
    assert set(changed.values()) == {found.name}


@pytest.mark.parametrize(
    ("values", "factors"),
    [
        ({"factor": 1.2}, (1.2, 1.2)),
        ({"factor__load": 1.2}, (1.2, 1.0)),
        ({"factor__load": 1.2, "factor__no_load": 0.9}, (1.2, 0.9)),
        ({"factor": 1.1, "factor__load": 1.2}, (1.32, 1.1)),
    ],
)
def test_a_friction_level_may_be_of_one_pose(values, factors):
    """Friction in both poses is what was found, and other joints keep theirs."""
    friction, _, _ = extended_friction(ARM, nominal(), (cause("friction_level", **values),))
    poses = find_poses(ARM)
    for k, factor in enumerate(factors):
        before = nominal().stiction_at(poses.load[:, k])
        after = friction.stiction_at(poses.load[:, k])
        expected = np.where(np.arange(7) == JOINT - 1, factor, 1.0)[:, None]
        np.testing.assert_allclose(after.mean(axis=1) / before.mean(axis=1), expected[:, 0])


def test_what_is_not_of_the_arm_is_left_out_with_a_reason():
    causes = (
        dataclasses.replace(cause("low_pass", cutoff_hz=40.0), joints=(5, 7)),
        cause("base_drift", factor=1.1),
        cause("corrupted_cell"),
    )
    friction, changed, missing = extended_friction(ARM, nominal(), causes)
    same(friction, nominal())
    assert changed == {}
    assert missing[0] == (
        "low_pass of joints 5 and 7: a low-pass of 40 Hz on the commanded torque is the interface's"
    )
    assert [m.split(" of ")[0] for m in missing] == ["low_pass", "base_drift", "corrupted_cell"]
