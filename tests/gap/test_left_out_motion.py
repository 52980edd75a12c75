"""One motion left out: what the others know of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.gap.validation.left_out_motion import leave_out_motions
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm
from tests.gap.small_logs import dry, found, hidden, only


def sprung(arm: Arm, stiffness: float, seed: int) -> JointLog:
    pull = stiffness * np.array([1.0, 0.0])
    return hidden(arm, lambda q, dq, ddq: dry(q, dq, ddq) + pull * q, seed=seed)


def test_one_log_has_no_other(two):
    assert leave_out_motions(found(two, hidden(two, dry))) is None


def test_what_is_in_all_motions_transfers(two):
    d = found(two, *(hidden(two, dry, seed=k) for k in (1, 2, 3)))
    left = leave_out_motions(d)
    assert left.motions == ("log1.csv", "log2.csv", "log3.csv")
    np.testing.assert_allclose(left.nominal_rms, d.nominal_rms, rtol=1e-9)
    np.testing.assert_allclose(left.extended_rms, d.extended_rms, rtol=0.05)
    assert {(c.name, c.joint, c.verdict) for c in left.causes} == {
        ("coulomb_friction", 1, "transfers"),
        ("coulomb_friction", 2, "transfers"),
    }
    for c in left.causes:
        assert c.share == pytest.approx(1.0, abs=0.03)
        assert c.motions == left.motions
        assert c.with_nm < 0.1 * c.without_nm


def test_what_is_in_one_motion_only_does_not_transfer(two):
    """A spring in one log of two: blocks of time like half of it, the other motion none."""
    d = found(two, sprung(two, 4.0, 1), sprung(two, 0.0, 2))
    library = d.library
    terms = [t for t in library.candidates if t.cause == "coulomb_friction"]
    terms += [t for t in library.candidates if (t.cause, t.joint) == ("external_spring", 0)]
    fitted = library.grams.fit(library.model_columns(terms))
    d = replace(d, terms=tuple(terms), coefficients=fitted)
    left = leave_out_motions(d)
    by = {(c.name, c.joint): c for c in left.causes}
    spring = by["external_spring", 1]
    assert spring.verdict == "does not transfer"
    assert spring.share == pytest.approx(0.0, abs=0.15)
    assert by["coulomb_friction", 2].verdict == "transfers"
    blocks = library.grams.held_out(library.model_columns(terms))[0].sum()
    count = library.grams.joints[0].count.sum()
    assert left.extended_rms[0] > 1.5 * np.sqrt(blocks / count) * d.data.noise[0]


def test_a_joint_that_moves_in_one_log_only_is_not_judged(two):
    """Friction of joint 1 is in the log in which it moves, and nowhere else."""
    logs = []
    for k, joint in ((1, 0), (2, 1), (3, 1)):
        log, rng = hidden(two, dry, seed=k), np.random.default_rng(k)
        q = only(log, joint).q + 1e-6 * np.eye(2)[1 - joint] * rng.normal(size=(len(log.t), 1))
        moves = np.eye(2)[joint]
        dq = np.gradient(q, log.t, axis=0) * moves
        ddq = np.gradient(dq, log.t, axis=0) * moves
        tau = inverse_dynamics(two.pinocchio(), q, dq, ddq) + moves * dry(q, dq, ddq)
        logs.append(replace(log, q=q, tau=tau + 0.01 * rng.normal(size=q.shape)))
    left = leave_out_motions(found(two, *logs))
    by = {(c.name, c.joint): c for c in left.causes}
    assert by["coulomb_friction", 1].verdict == "one motion shows it"
    assert by["coulomb_friction", 1].motions == ()
    assert by["coulomb_friction", 2].verdict == "transfers"
    row = next(x for x in left.to_json()["causes"] if x["joint"] == 1)
    assert row["without_nm"] is None
    # what the others do not know is not predicted: the error is the nominal one
    assert left.extended[0, 0] == pytest.approx(left.nominal[0, 0], rel=0.1)
