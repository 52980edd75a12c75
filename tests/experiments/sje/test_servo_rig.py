"""The Single Joint Experiment on joints under position servos."""

import gymnasium as gym
import numpy as np
import pytest

from stiction_envs.cli import main
from stiction_envs.errors import ExperimentError, StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.sje.calibrate import calibrate
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import DIRECTIONS, LOADS, Configuration, Job
from stiction_envs.friction.parameters import load_friction
from stiction_envs.friction.servos import read_servos
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.measured.tables import read_base
from tests.refusal import refusal
from tests.servo_arm import STICTION, servo_arm

ELBOW = Configuration(2, "load", "+")
DITHERED = Job(ELBOW, 10.0, 0.2)


def experiment(folder, *, drive=None, **changes):
    arm, path = servo_arm(folder, **changes)
    return on_bench(arm, path, drive=drive)


def on_bench(arm, friction=None, *, drive=None):
    """Return the experiment with ramps three times as fast as the protocol's."""
    e = SingleJointExperiment(arm, friction=friction, drive=drive, scatter=False, threads=1)
    return e.replace(protocol=e.protocol.replace(ramp_rate=0.2))


def measured(e, jobs):
    return {m.job: m for m in e.run(jobs, iterations=1)}


@pytest.fixture(scope="module")
def together(tmp_path_factory):
    """All configurations, and the elbow with dither, measured in one batch."""
    e = experiment(tmp_path_factory.mktemp("arm"))
    return measured(e, [DITHERED, *e.jobs()])


def test_the_breakaway_torque_is_the_stiction_against_gravity(together):
    found = {job.configuration: m for job, m in together.items() if job != DITHERED}
    assert len(found) == 8
    for c, m in found.items():
        expected = c.sign * STICTION[c.joint - 1]
        # a bristle lets go a little before its level while the joint creeps
        np.testing.assert_allclose(m.tau, expected, rtol=0.03)


def test_dither_of_the_command_frees_the_joint(tmp_path):
    e, jobs = experiment(tmp_path), [Job(ELBOW), Job(ELBOW, 10.0, 0.3)]
    base, dithered = (measured(e, jobs)[j].mean for j in jobs)
    assert abs(dithered) < 0.5 * abs(base)


def test_a_servo_too_weak_for_the_friction_leaves_the_joint_stuck(tmp_path):
    up = Configuration(2, "load", "-")  # against gravity, which takes 0.59 N·m; friction 0.3
    weak, strong = (experiment(tmp_path, torque_limit=np.array([1e6, x])) for x in (0.85, 0.95))
    assert np.isnan(measured(weak, [Job(up)])[Job(up)].tau).all()
    assert np.isfinite(measured(strong, [Job(up)])[Job(up)].tau).all()


def test_a_servo_that_cannot_carry_the_arm_is_an_error(tmp_path):
    with pytest.raises(ExperimentError, match=r"joint 1 stopped .* at most 0\.85 N"):
        measured(experiment(tmp_path, torque_limit=0.85), [Job(ELBOW)])


def test_a_job_does_not_depend_on_the_others(tmp_path, together):
    alone = measured(experiment(tmp_path), [DITHERED])[DITHERED]
    assert np.array_equal(together[DITHERED].tau, alone.tau)


def test_torques_drive_where_that_is_asked_for_and_servos_where_they_are_known(tmp_path):
    assert experiment(tmp_path, drive="torque").servos is None
    assert experiment(tmp_path).servos is not None
    refusal(lambda: SingleJointExperiment("panda", drive="position"), r"\[servo\]")
    with pytest.raises(StictionError, match="expected one of torque, position"):
        SingleJointExperiment("panda", drive="speed")


def test_the_report_says_how_far_the_command_leads(tmp_path):
    e = experiment(tmp_path)
    result = e.measure([Job(ELBOW), Job(ELBOW, 10.0, 0.3)], iterations=1)
    result.write(tmp_path)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "| 10.0 |" in text  # 0.3 N·m over 30 N·m/rad, in mrad
    assert "dither A/K [mrad]" in text
    assert result.to_json()["servo_stiffness"].tolist() == [80.0, 30.0]


def test_a_model_keeps_its_servos_whatever_runs_on_it(tmp_path, together):
    """By torque first: the servos of the same model object still lift the arm afterwards."""
    arm, path = servo_arm(tmp_path)
    model = sticking_model(arm, path)
    by_torque, driven = on_bench(model, drive="torque"), on_bench(model)
    assert by_torque.servos is None
    assert by_torque.sticking.model.body_gravcomp.any()
    assert np.array_equal(measured(driven, [Job(ELBOW)])[Job(ELBOW)].tau, together[Job(ELBOW)].tau)


def test_what_drives_by_torque_says_that_servos_are_in_the_way(tmp_path):
    arm, path = servo_arm(tmp_path)
    with pytest.raises(StictionError, match=r"impedance controllers drive joints by torque.*servo"):
        GeneratedTrajectoryExperiment(arm, friction=path)
    with pytest.raises(StictionError, match=r"environments drive joints by torque.*\[servo\]"):
        gym.make("stiction_envs:PandaSJE-v0", robot=tmp_path / "two_links.xml", friction=path)


def test_base_torques_are_calibrated_by_torque_and_the_servos_are_kept(tmp_path):
    arm, path = servo_arm(tmp_path)
    by_torque = SingleJointExperiment(arm, friction=path, drive="torque", scatter=False, threads=1)
    tau = 1.2 * by_torque.measure(by_torque.jobs(), iterations=1).tau
    rows = [
        f"arm,{j + 1},{load},{direction},0,0,{tau[j, k, d]},0,1,0"
        for j in range(2)
        for k, load in enumerate(LOADS)
        for d, direction in enumerate(DIRECTIONS)
    ]
    head = "robot,joint,load,direction,frequency_hz,amplitude_nm,tau_nm,std_nm,iterations,reduction"
    table, out = tmp_path / "base.csv", tmp_path / "friction.toml"
    table.write_text("\n".join([head, *rows]), encoding="utf-8")
    words = ["calibrate", tmp_path / "two_links.xml", table, "--friction", path, "--out", out]
    assert main([str(w) for w in words]) == 0
    # the slide to the threshold adds the same whatever the stiction
    expected = np.array(STICTION) + tau[:, 0, 0] * (1 - 1 / 1.2)
    np.testing.assert_allclose(load_friction(out, 2).stiction.mean(axis=1), expected, rtol=0.01)
    assert np.array_equal(read_servos(out, 2).stiffness, read_servos(path, 2).stiffness)
    with pytest.raises(StictionError, match="expected drive torque"):
        calibrate(read_base(table, "arm", 2), SingleJointExperiment(arm, friction=path))
