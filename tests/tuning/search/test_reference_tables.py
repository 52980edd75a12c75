"""What a search is compared with on an arm that the thesis did not measure."""

import pytest

from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.method_settings import override
from tuning.search.bounds import bounds_of
from tuning.search.reference_tables import reference_tables
from tuning.settings import tuning_settings


@pytest.mark.parametrize("tried", [(30.0,), (50.0, 20.0, 30.0)])
def test_the_limit_is_the_base_torque_at_the_second_slowest_frequency(small_arm, fast, tried):
    experiment = SingleJointExperiment(small_arm, protocol=fast)
    settings = override(tuning_settings(), {"thesis.frequencies_hz": tried})
    found = reference_tables(experiment, bounds_of(experiment), settings)
    assert [r.frequency_hz for r in found.pop("base torque")] == [30.0, 30.0]
    assert found == {}
