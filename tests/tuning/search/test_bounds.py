"""A search never proposes settings past limits, rates or in forbidden bands."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.measured.tables import AmplitudeRow
from stiction_envs.method_settings import override
from tests.refusal import refusal
from tuning.search.bounds import bounds_of, reference_tables
from tuning.settings import tuning_settings


@pytest.fixture(scope="module")
def panda():
    return SingleJointExperiment("panda")


@settings(deadline=None, max_examples=200)
@given(
    joint=st.integers(1, 7),
    place=st.floats(0.0, 1.0),
    share=st.floats(0.0, 1.0),
)
def test_no_setting_passes_torque_or_rate(panda, joint, place, share):
    bounds, limits = bounds_of(panda), panda.sticking.arm.limits
    d = bounds.space(joint)["frequency_hz"]
    f = float(np.clip(d.low * (d.high / d.low) ** place, d.low, d.high))
    row = bounds.setting(joint, {"frequency_hz": f, "amplitude": share})
    assert 15.0 <= row.frequency_hz <= 80.0
    assert 0.0 <= row.amplitude_nm <= limits.torque[joint - 1]
    rate = 2 * np.pi * row.frequency_hz * row.amplitude_nm
    assert rate <= limits.torque_rate[joint - 1] * (1 + 1e-12)


def test_frequencies_of_a_slow_controller_stay_below_half_its_rate():
    bounds = bounds_of(SingleJointExperiment("iiwa7"))
    assert bounds.frequency_hz[:, 1].max() < 100.0


def test_a_file_changes_all_joints_or_one(panda, tmp_path):
    file = tmp_path / "bounds.toml"
    file.write_text(
        "[all]\nfrequency_hz = [20, 60]\nforbidden_hz = [[38.0, 42.0]]\n"
        "[joint.7]\namplitude_nm = [0.1, 0.5]\ndisplacement_rad = 3e-4\n"
        "[arm]\nvibration_mm = 0.1\n"
    )
    bounds = bounds_of(panda, file)
    assert np.all(bounds.frequency_hz == [20.0, 60.0])
    assert bounds.amplitude_nm[6].tolist() == [0.1, 0.5]
    assert bounds.displacement_rad[6] == 3e-4
    assert np.isnan(bounds.displacement_rad[0])
    assert bounds.vibration_m[0] == pytest.approx(1e-4)
    assert np.isnan(bounds.vibration_m[1])
    for drawn, used in ((37.0, 37.0), (38.5, 38.0), (41.0, 42.0)):
        assert bounds.setting(1, {"frequency_hz": drawn, "amplitude": 0.5}).frequency_hz == used
    assert bounds.forbidden(1, 40.0)
    assert not bounds.forbidden(1, 42.0)


def test_bounds_that_are_met_are_named(panda):
    bounds = bounds_of(panda)
    most = bounds.largest(7, 15.0)
    words = bounds.met(AmplitudeRow(7, 15.0, most))
    assert any("lowest frequency 15 Hz" in w for w in words)
    assert any("largest amplitude" in w for w in words)
    assert "torque rate" in bounds.met(AmplitudeRow(2, 80.0, bounds.largest(2, 80.0)))
    assert bounds.met(AmplitudeRow(7, 30.0, 0.5)) == []


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("[all\n", "TOML"),
        ("[joints]\n", "table 'joints'"),
        ("[joint.9]\n", "'9'"),
        ("all = 5\n", r"\[all\]: is 5: expected a table"),
        ("[joint]\n1 = 3\n", r"\[joint.1\]: is 3: expected a table"),
        ("[all]\namplitude = [0, 1]\n", "'amplitude'"),
        ("[arm]\nvibration = 1\n", "'vibration'"),
        ("[all]\nfrequency_hz = [50, 20]\n", "low < high"),
        ("[all]\nfrequency_hz = 50\n", r"expected \[low, high\]"),
        ("[all]\nfrequency_hz = [20, 600]\n", "half the controller's rate"),
        ("[joint.7]\namplitude_nm = [0, 50]\n", "torque limit"),
        ("[joint.7]\namplitude_nm = [0, inf]\n", "finite number"),
        ("[joint.2]\namplitude_nm = [20, 50]\nfrequency_hz = [70, 80]\n", "leave nothing"),
        ("[all]\nforbidden_hz = [[10, 90]]\n", "leaves no frequency"),
        ("[all]\ndisplacement_rad = 0\n", "above 0"),
    ],
)
def test_bad_bounds_are_one_clear_line(panda, tmp_path, text, what):
    file = tmp_path / "bounds.toml"
    file.write_text(text)
    refusal(lambda: bounds_of(panda, file), what)


@pytest.mark.parametrize("tried", [(30.0,), (50.0, 20.0, 30.0)])
def test_the_limit_is_the_base_torque_at_the_second_slowest_frequency(small_arm, fast, tried):
    """On an arm that the thesis did not measure."""
    experiment = SingleJointExperiment(small_arm, protocol=fast)
    settings = override(tuning_settings(), {"thesis.frequencies_hz": tried})
    found = reference_tables(experiment, bounds_of(experiment), settings)
    assert [r.frequency_hz for r in found.pop("base torque")] == [30.0, 30.0]
    assert found == {}
