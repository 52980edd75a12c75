"""Blind tests: something is wrong with the arm, and the tables must say what.

Truths are simulated by `hidden_tables` with the whole arm, scatter and noise. Where theory says
that such tables cannot tell two causes apart, `confused_with` must name the other one.
"""

import dataclasses

import pytest

from stiction_envs.experiments.poses import find_poses
from stiction_envs.experiments.sje.protocol import Configuration
from stiction_envs.gap.tables.data import WholeArm
from stiction_envs.gap.tables.table_diagnosis import diagnose_tables
from stiction_envs.robots import load_arm
from tests.gap.tables.hidden_tables import Truth, amplitude, nominal, protocol, tables

JOINTS = [5, 7]
BAD = ("no_load", "+", 30.0, 1.0)


@pytest.fixture(scope="module")
def diagnose():
    """The diagnosis with the nominal arm; simulations are shared between the tests."""
    whole = WholeArm(load_arm("panda"), nominal(), protocol=protocol())
    return lambda rows: diagnose_tables(rows, whole)


def check(diagnosis, name, joints, key, truth):
    """The one cause is the hidden one, and its interval holds the truth."""
    assert diagnosis.verdict == "explained"
    (first,) = diagnosis.causes
    assert (first.name, first.joints) == (name, tuple(joints))
    (parameters,) = first.parameters.values()
    found = parameters[key]
    low, high = found.ci95
    assert low <= found.value <= high
    assert not found.on_bound
    assert low <= truth <= high, (found, truth)
    assert first.nats > 3
    assert list(first.confused_with) == [name for name, nats in first.rivals if nats < 3][:3]
    return first


@pytest.mark.slow
@pytest.mark.parametrize(
    ("joints", "seed"),
    [([5], 3), ([5, 7], 1), ([7], 2)],
)
def test_nothing_is_found_where_nothing_is_hidden(diagnose, joints, seed):
    found = diagnose(tables(joints, seed=seed))
    assert found.verdict == "no discrepancy", found
    assert found.causes == ()
    assert found.gain_percent == 0.0
    # four iterations of 2 % friction scatter and 5 mN·m noise
    assert all(0.4 < sd < 2.5 for sd in found.noise_floor)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "name", "joints", "key", "value", "told_from"),
    [
        (Truth(lowpass_hz=40.0), "low_pass", JOINTS, "cutoff_hz", 40.0, ""),
        (Truth(joint=7, level=1.2), "friction_level", [7], "factor", 1.2, ""),
        (Truth(joint=5, day=1.12), "base_drift", [5], "factor", 1.12, "corrupted_cell"),
        (
            Truth(joint=5, offset_nm=0.06),
            *("torque_offset", [5], "offset_nm", 0.06, "gravity_error"),
        ),
    ],
)
def test_one_cause_is_named_alone(diagnose, truth, name, joints, key, value, told_from):
    found = diagnose(tables(JOINTS, truth, seed=1))
    first = check(found, name, joints, key, value)
    assert told_from not in first.confused_with


@pytest.mark.slow
def test_gravity_error_grows_with_the_load(diagnose):
    found = diagnose(tables(JOINTS, Truth(joint=5, gravity_nm=0.08), seed=1))
    load = float(find_poses(load_arm("panda")).signed[4, 0])
    first = check(found, "gravity_error", [5], "share_of_gravity", 0.08 / load)
    assert "torque_offset" not in first.confused_with
    assert "gravity" in first.evidence


@pytest.mark.slow
def test_rotor_inertia(diagnose):
    found = diagnose(tables(JOINTS, Truth(joint=7, rotor_inertia=2.0), seed=1))
    first = check(found, "rotor_inertia", [7], "factor", 2.0)
    inertia = nominal().rotor_inertia[6]
    value = first.parameters[7]["armature_kgm2"].value
    assert value == pytest.approx(inertia * first.parameters[7]["factor"].value)
    assert found.joints == (5, 7)
    assert found.extended[1] < 0.4 * found.nominal[1]
    assert found.extended[0] == pytest.approx(found.nominal[0])


@pytest.mark.slow
def test_presliding_is_named_or_said_to_be_confused_with_inertia(diagnose):
    """Far above f_p the bristle sees A(f_p/f)²: σ0/J alone counts (sources.md 4.3)."""
    truth = Truth(joint=7, bristle_stiffness=0.4)
    found = diagnose(tables(JOINTS, truth, seed=1))
    first = found.causes[0]
    assert first.joints == (7,)
    if first.name == "rotor_inertia":
        assert "presliding" in first.confused_with
    else:
        check(found, "presliding", [7], "factor", 0.4)


@pytest.mark.slow
def test_base_drift_of_one_configuration_may_be_a_bad_base_torque(diagnose):
    truth = Truth(joint=7, day=1.12, day_at=(("load", "+"),))
    found = diagnose(tables(JOINTS, truth, seed=1))
    first = check(found, "base_drift", [7], "factor load +", 1.12)
    assert "corrupted_cell" in first.confused_with
    assert "base" in first.told_apart_by["corrupted_cell"]


@pytest.mark.slow
def test_corrupted_cell_is_one_cell(diagnose):
    """A cell as wrong as joint 2, load, −, 30 Hz in the thesis's Table 4.7 (−94 %) is named."""
    found = diagnose(tables(JOINTS, Truth(joint=7, corrupted=BAD), seed=1))
    assert found.verdict == "explained"
    (cause,) = found.causes
    assert (cause.name, cause.joints) == ("corrupted_cell", (7,))
    size = amplitude(Configuration(7, *BAD[:2]), BAD[3])
    assert f"at joint 7 no_load +, 30 Hz, {size:.4g} N·m, 0.0365 N·m is read" in cause.evidence


@pytest.mark.slow
def test_direction_asymmetry_is_told_from_offset_where_dither_is_strong(diagnose):
    """Dither reduces friction and its asymmetry equally, but not an offset (sources.md 1.6)."""
    found = diagnose(tables(JOINTS, Truth(joint=7, asymmetry_nm=0.06), seed=1))
    first = check(found, "direction_asymmetry", [7], "asymmetry_nm", 0.06)
    assert "gravity_error" not in first.confused_with


@pytest.mark.slow
def test_two_causes_on_two_joints(diagnose):
    truths = Truth(joint=7, rotor_inertia=2.0), Truth(joint=5, day=1.12)
    found = diagnose(tables(JOINTS, *truths, seed=1))
    assert {(c.name, c.joints) for c in found.causes} == {
        ("rotor_inertia", (7,)),
        ("base_drift", (5,)),
    }
    assert found.verdict == "explained"
    # each cause's gain is what is lost without it
    assert sum(c.gain_percent for c in found.causes) == pytest.approx(found.gain_percent, abs=2.0)


def test_what_no_cause_explains_is_not_explained(diagnose):
    """One block 15 % off, at the frequency where dither does least."""
    found = diagnose(
        [
            dataclasses.replace(x, tau_nm=(1.15 if x.frequency_hz == 80.0 else 1.0) * x.tau_nm)
            for x in tables([7], seed=1)
        ]
    )
    assert found.verdict == "cannot tell"
    assert found.causes == ()
    assert "joint 7" in found.reason


def test_too_few_blocks_are_no_evidence(diagnose):
    found = diagnose([x for x in tables([5], seed=1) if x.frequency_hz in (0.0, 80.0)])
    assert found.verdict == "cannot tell"
    assert "at least 3 are needed" in found.reason
