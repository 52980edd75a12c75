"""Friction compensation in the Generated Trajectory Experiment: limit cases, bits, own friction."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.control.compensation import Compensation
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.protocol import Case
from tests.experiments.gte.short_paths import DITHER, SOFT, STIFF, assert_same, bench, friction, one
from tests.refusal import refusal

PLAIN = Case(trajectory="corner", stiffness=STIFF)
SHAKEN = dataclasses.replace(PLAIN, dither=DITHER)


def with_(case: Case, compensation: Compensation | None) -> Case:
    return dataclasses.replace(case, compensation=compensation)


def test_compensation_reduces_what_friction_leaves():
    """Feedforward on the way, push at the goal; the arm that is pushed shakes no more at rest."""
    b = bench(tail=3.0, scatter=False)
    case = Case(trajectory="away", stiffness=SOFT)
    kinds = ("feedforward", "push")
    runs = b.run([case, *(with_(case, b.compensation(k)) for k in kinds)], iterations=1)
    none, feedforward, push = (Measures(run, b.protocol) for run in runs)
    assert np.linalg.norm(feedforward.rms[0, :3]) < 0.75 * np.linalg.norm(none.rms[0, :3])
    left, undithered = (np.linalg.norm(m.settling[0, -1, :3]) for m in (push, none))
    assert left < 0.5 * undithered
    assert push.shaking_at_rest[0] < 1.2 * none.shaking_at_rest[0]


def test_a_relay_beyond_friction_hunts_and_vibration_shows_it():
    """Push by the bare sign of the error: below friction it rests, above it never does."""
    b = bench(tail=4.0, scatter=False)
    case = Case(trajectory="there", stiffness=SOFT)
    relays = [
        b.compensation("push", factor).replace(error=1e-5, speed=0.1) for factor in (0.5, 1.5, 4.0)
    ]
    runs = b.run([case, *(with_(case, c) for c in relays)], iterations=1)
    last_second = [np.sqrt(run.mean_square[0, -100:].mean(axis=0).sum()) for run in runs]
    assert max(last_second[:2]) < 1e-7
    assert 2e-5 < last_second[2] < 0.5 * last_second[3]
    none, under, over, far = (Measures(run, b.protocol).shaking_at_rest[0] for run in runs)
    assert under < 1.5 * none
    assert far > 2 * over > 6 * none


def test_more_than_friction_hunts():
    """An observer that adds 1.6 times the friction does not come to rest; with 0.8 it does."""
    b = bench(tail=4.0, scatter=False)
    case = Case(trajectory="there", stiffness=SOFT)
    observers = [
        b.compensation("lugre_observer", factor).replace(injection=3.0) for factor in (0.8, 1.6)
    ]
    runs = b.run([with_(case, c) for c in observers], iterations=1)
    moved = [np.ptp(run.actual[0, -200:, :3], axis=0).max() for run in runs]
    assert moved[0] < 0.1 * moved[1]


def test_each_case_may_have_its_own_friction():
    """Bit for bit what an experiment with that friction gives; None is the model's."""
    nominal = friction()
    strong = nominal.replace(stiction=1.3 * nominal.stiction)
    lopsided = nominal.replace(stiction=nominal.stiction * [1.2, 0.8])
    compensation = bench().compensation("feedforward")
    cases = [PLAIN, with_(SHAKEN, compensation), with_(PLAIN, compensation)]
    true = [None, strong, lopsided]
    runs = bench().run(cases, parameters=true, iterations=2)
    for case, p, run in zip(cases, true, runs, strict=True):
        own = bench() if p is None else bench(friction=p)
        assert_same(one(own, case, 2), run)
    assert not np.array_equal(runs[1].actual[:, :100], one(bench(), cases[1], 2).actual[:, :100])


def test_friction_that_does_not_fit():
    b, p = bench(), friction()
    refusal(lambda: b.run([PLAIN], parameters=[p, p]), "2 cases: expected 1")
    six = type(p)(**{k: getattr(p, k)[:6] for k in p.__dataclass_fields__})
    refusal(lambda: b.run([PLAIN], parameters=[six]), "6 joints: expected 7")
    with pytest.raises(StictionError, match="elastic"):
        b.run([PLAIN], parameters=[p.replace(joint_stiffness=np.full(7, 1e4))])
    with pytest.raises(StictionError, match="2 joints: expected 7"):
        b.run([with_(PLAIN, Compensation(kind="push", gain=(1.0, 1.0)))])
