"""A finished model against logs that took no part: what holds, what does not, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

import stiction_envs as st
from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.gap.validation.check import check_model, refuse_unfit
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm, load_arm
from tests.gap.small_logs import RATE, dry, found, hidden, only, write_csv
from tests.refusal import refusal

NOISE = 0.01
SPRING, STIFF = np.array([3.0, 0.0]), np.array([-60.0, 0.0])


def dry_and_sprung(q, dq, ddq):
    return dry(q, dq, ddq) + SPRING * q


@pytest.fixture(scope="module")
def friction(two) -> Diagnosis:
    return found(two, hidden(two, dry))


@pytest.fixture(scope="module")
def sprung(two) -> Diagnosis:
    return found(two, hidden(two, dry_and_sprung))


def test_a_right_model_holds_down_to_the_noise(two, friction):
    check = check_model(friction, [hidden(two, dry, seed=7)])
    assert check.verdict == "holds"
    assert check.worse_joints == check.not_transferring == ()
    assert (check.extended_rms < 0.1 * check.nominal_rms).all()
    assert (check.extended_rms < 1.3 * friction.extended_rms).all()
    (cause,) = check.transfers
    np.testing.assert_allclose(cause.without, check.nominal_rms, rtol=0.05)
    assert "holds" in str(check)


def test_a_model_that_leaves_most_of_the_torque_does_not_hold(two, friction):
    """A stiff spring is in neither model: the found one is no worse than the nominal, and wrong."""
    log = hidden(two, lambda q, dq, ddq: dry(q, dq, ddq) + STIFF * q, seed=7)
    check = check_model(friction, [log])
    share = check.extended_rms[0] / np.sqrt(np.mean(check.data.tau[:, 0] ** 2))
    assert 0.5 < share < 1.0
    assert check.extended_rms[0] < 1.05 * check.nominal_rms[0]
    assert check.worse_joints == (1,)


def test_a_cause_that_was_only_in_the_diagnosed_log_is_named(two, sprung):
    """The spring was unhooked; friction, which is there still, transfers."""
    assert {c.name for c in sprung.causes} == {"coulomb_friction", "external_spring"}
    check = check_model(sprung, [hidden(two, dry, seed=7)])
    assert check.verdict == "does not hold"
    assert check.worse_joints == (1,)
    assert check.not_transferring == ("external_spring",)
    by = {x.name: x for x in check.transfers}
    assert by["external_spring"].harmed == (1,)
    assert by["external_spring"].without[0] < 0.1 * check.extended_rms[0]
    assert not by["coulomb_friction"].harmed
    text = str(check)
    assert "does not hold on joint 1" in text
    assert "Not transferring: external_spring (joint 1)" in text
    assert check.to_json() == {
        "nominal_rms_nm": check.nominal_rms.tolist(),
        "extended_rms_nm": check.extended_rms.tolist(),
        "verdict": "does not hold",
        "worse_joints": [1],
        "not_transferring": ["external_spring"],
        "cutoff_hz": sprung.data.recording.cutoff,
    }


def test_diagnose_holds_its_model_against_logs_that_took_no_part(two, tmp_path):
    """Through the library's face, from files and from memory."""
    log, other = hidden(two, dry, seconds=8.0), hidden(two, dry, seed=7, seconds=8.0)
    write_csv(tmp_path / "other.csv", other)
    third = replace(hidden(two, dry, seed=8, seconds=8.0), source="third")
    found = st.diagnose(log, two, check=[tmp_path / "other.csv", third])
    assert found.check.data.recording.cutoff == found.diagnosis.data.recording.cutoff
    assert f"cutoff {found.check.data.recording.cutoff:.3g} Hz" in found.check.notes[0]
    assert found.check.verdict == "holds"
    assert [x.source for x in found.check.logs] == [str(tmp_path / "other.csv"), "third"]
    assert "On logs that took no part the model holds" in found.summary
    assert found.provenance["arguments"]["check"] == [str(tmp_path / "other.csv"), "third"]
    assert set(found.sources.names) == {"log1", "check1", "check2"}


def test_a_joint_at_its_noise_floor_is_not_worse(two, friction):
    """Only added error above the noise floor counts, however small the nominal error is."""
    log = hidden(two, seed=7, noise=NOISE)
    floor = check_model(friction, [log]).data.noise
    for size, worse in ((0.5, ()), (4.0, (1, 2))):
        level = {t: 0 if t.small else size * floor[t.joint] for t in friction.terms}
        parts = friction.predictor.problem.split(friction.terms, friction.coefficients)
        each = [np.full(len(c), level[t]) for t, c in zip(friction.terms, parts, strict=True)]
        wrong = replace(friction, coefficients=np.concatenate(each))
        check = check_model(wrong, [log])
        assert (check.nominal_rms < 2 * floor).all()
        assert check.worse_joints == worse


def partly(arm: Arm, part: float, until: float = 1.0) -> JointLog:
    """A log with part of the spring in the first part of the time."""

    def add(q, dq, ddq):
        there = np.arange(len(q))[:, None] < until * len(q)
        return dry(q, dq, ddq) + part * there * SPRING * q

    return hidden(arm, add, seed=7, noise=1e-4)


@pytest.mark.parametrize(
    ("part", "until", "named"),
    [
        (0.4, 1.0, True),  # it adds (0.6² − 0.4²)/0.4² to the squared error
        (0.46, 1.0, True),
        (0.485, 1.0, False),  # 6 % of the squared error is no harm
        (0.6, 1.0, False),
        (0.9, 0.7, False),  # it helps more than it harms
    ],
)
def test_what_hardly_harms_is_not_named(two, sprung, part, until, named):
    check = check_model(sprung, [partly(two, part, until)])
    assert check.not_transferring == (("external_spring",) if named else ())


@pytest.mark.parametrize(("joint", "named"), [(1, ()), (0, ("payload",))])
def test_what_acts_on_the_whole_arm_is_judged_as_a_whole(two, two_xml, joint, named):
    """A payload that one joint does not feel: the load is most of joint 1's torque."""
    arm, loaded = two, load_arm(two_xml, payload=(0.5, 0.0, 0.0, 0.05))
    d = diagnose_logs([hidden(arm, true=loaded)], arm, causes=[cause_named("payload")])
    assert [c.name for c in d.causes] == ["payload"]

    def unfelt(q, dq, ddq):
        with_it, without = (inverse_dynamics(x.pinocchio(), q, dq, ddq) for x in (loaded, arm))
        return (without - with_it) * np.eye(2)[joint]

    check = check_model(d, [hidden(arm, unfelt, true=loaded, seed=7)])
    assert check.transfers[0].harmed == (joint + 1,)
    assert check.worse_joints == (joint + 1,)
    assert check.not_transferring == named


def test_torques_are_inverted_as_the_diagnosed_ones_were(two):
    """A small motion says nothing of the sign; the diagnosed log of the same robot did."""
    log = hidden(two, dry)
    turned = replace(log, tau=-log.tau)
    d = found(two, turned)
    assert any(c.kind == "sign" for c in d.logs[0].corrections)
    small = hidden(two, seed=7, size=0.005)
    small = replace(small, tau=-small.tau)
    check = check_model(d, [small])
    assert "as those of the diagnosed logs" in check.logs[0].corrections[-1].text
    assert (check.nominal_rms < 0.1).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda x: cut(x, len(x.t), 1), r"check log other\.csv: 1 joints: expected 2, those of"),
        (lambda x: replace(x, static=True), "poses without time"),
        (lambda x: cut(x, round(0.5 * RATE)), "expected 1 s or more"),
        (lambda x: x, "it is diagnosed too"),
        (lambda x: replace(x, q=0.01 * x.q), "no joint moves more than 0.05 rad in it, joint 1"),
        (lambda x: only(x, 1), "joint 2 moves more than 0.05 rad in it, joint 1 in the diagnosed"),
    ],
)
def test_logs_that_cannot_check_are_refused_in_one_line(two, change, says):
    made = hidden(two)
    diagnosed = only(made, 0)
    other = replace(made, source="other.csv")
    given = diagnosed if says == "it is diagnosed too" else change(other)
    refusal(lambda: refuse_unfit([given], [diagnosed], two), says)


def cut(log: JointLog, rows: int, n: int = 2) -> JointLog:
    return replace(log, t=log.t[:rows], q=log.q[:rows, :n], tau=log.tau[:rows, :n])
