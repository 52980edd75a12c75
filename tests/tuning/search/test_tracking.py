"""The error that a treatment leaves at the goals, and its vibration."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.control.compensation import KINDS
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import measure
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from tuning.search.bounds import bounds_of
from tuning.search.tracking import TrackingObjective, Treatment
from tuning.study.record import LIMITS

PLACE = ("triangle", (200.0, 20.0, 0.0))


@pytest.fixture(scope="module")
def experiment():
    return GeneratedTrajectoryExperiment("panda", seed=2)


@pytest.fixture(scope="module")
def make(experiment):
    bounds = bounds_of(SingleJointExperiment("panda"))

    def made(**options):
        defaults = {"iterations": 1, "joints": (5, 7), "limits": thesis_final_dither()}
        return TrackingObjective(
            experiment,
            options.pop("bounds", bounds),
            [experiment.sticking.parameters],
            [PLACE],
            **{**defaults, **options},
        )

    return made


def test_nothing_leaves_all_and_the_limiting_table_is_allowed(make):
    objective = make()
    nothing, limit = objective.measure([Treatment(), Treatment(dither=thesis_final_dither())])
    assert nothing.left(objective.plain) == (1.0, 1.0)
    assert limit.shaking == tuple(objective.vibration)
    outcome = objective.outcome(limit, -np.inf)
    assert outcome.constraints == (0.0, 0.0)
    assert outcome.values[0] == outcome.measures["objective"] < 0


@pytest.mark.parametrize("price", ["shaking", "power", "torque_rate"])
def test_a_second_objective_is_what_it_is_called(make, price):
    """Shaking is a constraint, unless it is the second objective."""
    objective = make(pareto=price)
    found = objective.measure([Treatment(dither=thesis_final_dither())])[0]
    outcome = objective.outcome(found, -np.inf)
    measures = {"shaking": "vibration_m", "power": "power_w", "torque_rate": "torque_rate_nm_s"}
    assert outcome.values == (outcome.measures["objective"], outcome.measures[measures[price]])
    assert outcome.values[1] > 0
    twice = dataclasses.replace(found, vibration=2 * found.vibration)
    over = objective.outcome(twice, -np.inf).constraints[0]
    assert over == pytest.approx(0.0 if price == "shaking" else 1.0)
    assert len(objective.outcome(None, 0.5).values) == 2


def test_errors_are_those_of_the_experiment(make, experiment):
    objective = make()
    treatment = Treatment(dither=thesis_final_dither())
    found = objective.measure([treatment])[0]
    runs = experiment.run([Treatment().case(PLACE), treatment.case(PLACE)], iterations=1)
    plain, dithered = (measure(r, experiment.protocol, experiment.motion) for r in runs)
    ratio = np.linalg.norm(dithered.settling[0, :, :3], axis=1) / np.linalg.norm(
        plain.settling[0, :, :3], axis=1
    )
    assert found.left(objective.plain)[0] == pytest.approx(np.exp(np.log(ratio).mean()))
    by = found.by_friction(objective.plain)
    assert by["resting_position"][0] == pytest.approx(ratio[-1])


def test_forbidden_bands_are_not_simulated(make):
    bounds = bounds_of(SingleJointExperiment("panda"))
    band = ((20.0, 30.0),)
    bounds = dataclasses.replace(bounds, forbidden_hz=((),) * 6 + (band,))
    objective = make(bounds=bounds)
    parameters = objective.parameters(())
    parameters |= {"frequency_hz_7": 25.0, "amplitude_7": 0.2}
    objective.measure = None  # would be called
    outcome = objective.evaluate([(0, parameters)])[0]
    assert max(outcome.constraints) == pytest.approx(5.0)


@pytest.mark.parametrize("kind", KINDS)
def test_every_compensation_is_searched(make, kind):
    """Its parameters are within its space, and the middle of it is a treatment."""
    objective = make(joints=(), compensation=kind, rest_margin=1.0)
    space, parameters = objective.space(), objective.parameters(())
    assert set(space) == set(parameters)
    assert all(d.low <= parameters[name] <= d.high for name, d in space.items())
    found = objective.treatment(parameters).compensation
    assert found.kind == kind
    top = objective.treatment({name: d.high for name, d in space.items()}).compensation
    assert top.gain > found.gain
    assert ("compensation_load" in space) == (kind == "push")


def test_treatments_are_limited_at_rest_and_in_torque_rate(make):
    """At rest the untreated arm and the margin; torque as fast as that of the limit's table."""
    margin = 1e-6
    objective = make(limits=thesis_final_dither(), rest_margin=margin)
    assert objective.vibration[1] == objective.plain.shaking[1] + margin
    assert np.isfinite(objective.torque_rate)
    assert objective.torque_rate >= objective.plain.torque_rate.max()
    shaken = objective.evaluate([(0, objective.parameters(thesis_final_dither()))])[0]
    over = shaken.measures[LIMITS]
    assert len(over) == 3
    assert over[1] > 0
    assert over[2] == pytest.approx(shaken.measures["torque_rate_nm_s"] / objective.torque_rate - 1)
