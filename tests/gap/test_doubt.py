"""A model file keeps the causes' covariance, the robot's lag and its sessions."""

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs, model_of
from stiction_envs.gap.doubt import earlier_factor
from stiction_envs.gap.judge.problem import Term
from stiction_envs.gap.model_file import Nominal, dump, read
from stiction_envs.hidden.hidden_logs import make_case
from stiction_envs.measured.logs.reader import JointLog
from tests.gap.small_logs import dry, hidden, panda, sliding, write_model

NAMES = ("coulomb_friction", "viscous_friction", "torque_offset", "actuator_delay")


def again(log: JointLog, nominal: str | Nominal = "rigid", names=NAMES, seed: int = 0) -> Diagnosis:
    causes = [cause_named(x) for x in names]
    return diagnose_logs([log], panda(), nominal=nominal, causes=causes, seed=seed)


def rough(q, dq, ddq):
    """Dry friction of 0.5 N·m with the scatter of a bad day: slow noise that depends on time."""
    rng = np.random.default_rng(5)
    slow = np.repeat(rng.normal(size=(len(q) // 300 + 1, q.shape[1])), 300, axis=0)[: len(q)]
    return (0.5 + 0.3 * slow) * sliding(q)


def late(log: JointLog, delay: float) -> JointLog:
    tau = np.stack([np.interp(log.t - delay, log.t, x) for x in log.tau.T], axis=1)
    return replace(log, tau=tau)


@pytest.fixture(scope="module")
def first() -> Diagnosis:
    return again(hidden(panda(), rough))


@pytest.fixture(scope="module")
def model(first: Diagnosis) -> Nominal:
    return model_of(first)


def coulomb(found: Diagnosis, joint: int) -> tuple[float, float]:
    """Return the half width of the interval of a joint's dry friction, and its value [N·m]."""
    (cause,) = (c for c in found.causes if c.name == "coulomb_friction")
    estimate = cause.parameters[joint]["coulomb_nm"]
    low, high = estimate.ci95
    return (high - low) / 2, estimate.value


def test_a_model_is_read_back_to_the_bit(model: Nominal, tmp_path) -> None:
    known = replace(model, torque_lag=(0.1 + 0.2, 1 / 3), sessions=((1.7e9 + 0.1, 1.7e9 + 2 / 3),))
    found = read(write_model(tmp_path, known))
    assert all(part.doubt for part in found.parts)
    for name in ("parts", "torque_lag", "sessions", "torque_sign", "distance"):
        assert getattr(found, name) == getattr(known, name)
    assert dump(found) == dump(known)


def test_an_interval_of_a_cause_found_again_contains_the_earlier_doubt(
    first: Diagnosis, model: Nominal
) -> None:
    log = hidden(panda(), lambda q, dq, ddq: 2.0 * sliding(q), seed=3)
    blind = replace(model, parts=tuple(replace(p, doubt=()) for p in model.parts))
    sure, found, *more = again(log, blind), *(again(log, model, seed=k) for k in range(4))
    assert all("coulomb_friction" in [c.name for c in x.causes] for x in (sure, found))
    for joint in (2, 4):
        (part,) = (p for p in model.parts if (p.cause, p.joint) == ("coulomb_friction", joint))
        earlier = float(np.linalg.norm(part.doubt[0]))
        alone, _ = coulomb(sure, joint)
        both = float(np.mean([coulomb(x, joint)[0] for x in (found, *more)]))
        assert both > 1.9 * earlier
        assert both == pytest.approx(
            np.hypot(alone, 1.96 * earlier), rel=0.15
        )  # of 1000 draws each
        # what is known of the sum is what the second log says of it
        term = Term("coulomb_friction", joint - 1, ())
        sums = [earlier_factor(model_of(x).parts, term, 1) for x in (found, sure)]
        assert np.linalg.norm(sums[0]) == pytest.approx(np.linalg.norm(sums[1]), rel=1e-9)


@pytest.mark.slow
def test_its_own_logs_show_no_discrepancy_where_all_links_are_a_little_off(tmp_path) -> None:
    case = make_case(43, ("viscous_friction", "payload"), known=False, scatter=0.03)
    before = diagnose_logs(case.logs, case.robot, nominal=case.nominal)
    assert {c.name for c in before.causes} == {"viscous_friction", "payload"}
    path = write_model(tmp_path, before)
    assert {p.cause for p in read(path).parts if p.doubt}.isdisjoint({"payload"})  # in [links]
    found = diagnose_logs(case.logs, case.robot, nominal=path)
    assert (found.verdict, found.causes) == ("no discrepancy", ())


@pytest.mark.parametrize("delay", [0.12, 0.02])
def test_a_known_lag_is_no_news(delay: float, tmp_path) -> None:
    """A long one is undone before, and a short one is a part of the model."""
    one, other = (late(hidden(panda(), dry, seed=k, noise=0.03), delay) for k in (1, 2))
    before = again(one)
    known = read(write_model(tmp_path, before))
    if delay > 0.1:
        assert known.torque_lag == pytest.approx((delay, 0.0), abs=0.011)
    else:
        assert "actuator_delay" in {p.cause for p in known.parts}
    for log in (one, other):
        found = again(log, known)
        assert not found.causes
        assert found.verdict == "no discrepancy"
        assert model_of(found).torque_lag == known.torque_lag
    undone = [c.text for x in again(other, known).logs for c in x.corrections]
    assert undone == ([] if delay < 0.1 else undone)
    assert all("as those of the nominal model's logs" in x for x in undone)


def test_a_log_without_the_known_lag_is_left_alone() -> None:
    found = again(hidden(panda(), dry), Nominal(torque_lag=(0.12, 0.0)))
    (log,) = found.logs
    assert not log.corrections
    assert "not so in this log: torques come 120 ms later" in log.warnings[0]
    assert model_of(found).torque_lag is None


def test_a_later_log_of_the_same_session_is_warm(tmp_path) -> None:
    day = 1.7e9
    one, later = (replace(hidden(panda(), dry), date=day + x) for x in (0.0, 600.0))
    model = model_of(again(one))
    assert model.sessions == ((day, day + one.t[-1]),)
    since = again(later, model).data.recording.since_session
    assert since[0] == pytest.approx(600.0, abs=2.0)
    assert again(later).data.recording.since_session[0] < 2.0
