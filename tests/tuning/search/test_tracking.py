"""The error that a treatment leaves at the goals, its vibration, and the unseen start."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.control.laws import LAWS
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.robots import load_arm
from tuning.search.bounds import bounds_of
from tuning.search.tracking import TrackingObjective, Treatment
from tuning.search.verify import another_start
from tuning.study.record import LIMITS

PLACE = ("triangle", (200.0, 20.0, 0.0))
THESIS = Treatment(dither=thesis_final_dither())


@pytest.fixture(scope="module")
def experiment():
    return GeneratedTrajectoryExperiment("panda", seed=2)


@pytest.fixture(scope="module")
def make(experiment):
    bounds = bounds_of(SingleJointExperiment("panda"))

    def made(**options):
        defaults = {"iterations": 1, "joints": (5, 7), "limits": THESIS.dither}
        return TrackingObjective(
            experiment,
            options.pop("bounds", bounds),
            [experiment.sticking.parameters],
            [PLACE],
            **{**defaults, **options},
        )

    return made


@pytest.fixture(scope="module")
def objective(make):
    return make()


@pytest.fixture(scope="module")
def dithered(objective):
    """The errors with the thesis's dither."""
    return objective.measure([THESIS])[0]


@pytest.fixture
def measured(objective, dithered, monkeypatch):
    """Let objectives be made without simulating anything again."""

    def measure(self, treatments):
        return [dithered if t.dither else objective.plain for t in treatments]

    monkeypatch.setattr(TrackingObjective, "measure", measure)


def test_nothing_leaves_all_and_the_limiting_table_is_allowed(objective, dithered):
    assert objective.plain.left(objective.plain) == (1.0, 1.0)
    assert dithered.shaking == tuple(objective.vibration)
    outcome = objective.outcome(dithered)
    assert outcome.constraints == (0.0, 0.0)
    assert outcome.values[0] == outcome.measures["objective"] < 0


@pytest.mark.usefixtures("measured")
def test_shaking_is_a_constraint_unless_it_is_an_objective(make, dithered):
    twice = dataclasses.replace(dithered, vibration=2 * dithered.vibration)
    for pareto, values, over in ((True, 2, 0.0), (False, 1, 1.0)):
        objective = make(pareto=pareto)
        outcome = objective.outcome(dithered)
        measured = outcome.measures["objective"], outcome.measures["vibration_m"]
        assert outcome.values == measured[:values]
        assert outcome.values[-1] != 0
        assert objective.outcome(twice).constraints[0] == pytest.approx(over)


def test_errors_are_those_of_the_experiment(objective, dithered, experiment):
    cases = [treatment.case(PLACE) for treatment in (Treatment(), THESIS)]
    runs = experiment.run(cases, iterations=1)
    measures = [Measures(run, experiment.protocol, experiment.motion) for run in runs]
    left, right = (np.linalg.norm(m.settling[0, :, :3], axis=1) for m in measures)
    ratio = right / left
    assert dithered.left(objective.plain)[0] == pytest.approx(np.exp(np.log(ratio).mean()))
    by = dithered.by_friction(objective.plain)
    assert by["resting_position"][0] == pytest.approx(ratio[-1])


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("kind", LAWS)
def test_every_compensation_is_searched(make, kind):
    """The parameters of a kind are within its space, whose middle is a treatment."""
    objective = make(joints=(), compensation=kind, rest_margin=1.0)
    space, parameters = objective.space(), objective.parameters(())
    assert set(space) == set(parameters)
    assert all(d.low <= parameters[name] <= d.high for name, d in space.items())
    found = objective.treatment(parameters).compensation
    assert found.kind == kind
    top = objective.treatment({name: d.high for name, d in space.items()}).compensation
    assert top.gain > found.gain
    assert ("compensation_load" in space) == (kind == "push")


@pytest.mark.usefixtures("measured")
def test_treatments_are_limited_at_rest_and_in_torque_rate(make, dithered):
    """At rest the untreated arm and the margin; torque as fast as that of the limit's table."""
    margin = 1e-6
    objective = make(rest_margin=margin)
    assert objective.vibration[1] == objective.plain.shaking[1] + margin
    assert objective.torque_rate == dithered.torque_rate.max() >= objective.plain.torque_rate.max()
    over = objective.outcome(dithered).measures[LIMITS]
    assert over[1] > 0
    assert over[2] == 0.0


@pytest.mark.parametrize("robot", ["panda", "iiwa7", "iiwa14"])
def test_another_start_is_another_pose_off_the_limits(robot):
    arm, most = load_arm(robot), 0.1
    low, high = arm.limits.position.T
    starts = np.array([another_start(arm, most, seed) for seed in range(20)])
    assert np.all(starts >= low + most)
    assert np.all(starts <= high - most)
    moved = np.abs(starts - np.clip(arm.rest, low + most, high - most))
    assert np.all(moved <= most)
    assert moved.mean() > 0.3 * most, "of even draws half"
    assert np.array_equal(another_start(arm, most, [3, 4]), another_start(arm, most, [3, 4]))
