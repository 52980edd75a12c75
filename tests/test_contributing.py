"""The examples of CONTRIBUTING.md work from outside the package, as they are printed."""

import dataclasses
import json
import re
import sys
from types import ModuleType

import gymnasium as gym
import numpy as np
import pytest

from stiction_envs.control.compensation_files import write_compensation
from stiction_envs.control.laws import LAWS
from stiction_envs.control.trajectory import Path
from stiction_envs.dither.dither import Dither
from stiction_envs.envs.registration import EXPERIMENTS
from stiction_envs.experiments.conformance import conformance
from stiction_envs.experiments.conformance_report import ConformanceSettings
from stiction_envs.experiments.engines import ENGINES
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.gap.causes import unregister
from stiction_envs.gap.diagnosis import diagnose_logs, model_of
from stiction_envs.gap.extended_model import extend
from stiction_envs.gap.report.figures import draw_cause
from stiction_envs.measured.checks.files import check
from stiction_envs.measured.logs.formats import registry
from stiction_envs.measured.logs.reader import read_logs
from stiction_envs.robots import load_arm
from tests.command_line import ROOT
from tests.experiments.test_conformance import lugre
from tests.gap.small_logs import hidden, panda

PAGE = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
SECTIONS = dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S))


def block(section: str, language: str) -> str:
    (found,) = re.findall(rf"```{language}\n(.*?)```", SECTIONS[section], re.S)
    return found


def test_the_cause_is_named_drawn_and_put_into_the_model(tmp_path):
    exec(block("A cause", "python"), {"__name__": "contributed"})
    try:
        fifth, path = np.eye(7)[4], tmp_path / "model.toml"
        log = hidden(panda(), lambda q, dq, ddq: 0.8 * np.sin(12 * q) ** 3 * fifth)
        found = diagnose_logs([log], "panda")
        made = extend(found.base, model_of(found))
        path.write_text(made.toml(meta={}, provenance={}), "utf-8")
        again = diagnose_logs([log], "panda", nominal=path)
        caption = draw_cause(found, found.causes[0], tmp_path)
    finally:
        unregister("magnetic_detent")
    (cause,) = found.causes
    assert (cause.name, cause.joints) == ("magnetic_detent", (5,))
    assert cause.parameters[5]["detent_nm"].value == pytest.approx(0.8, abs=0.03)
    assert "magnetic_detent of joint 5: MuJoCo's joints have no such thing" in made.missing
    assert again.causes == ()
    assert "twelve waves a turn" in caption
    assert (tmp_path / "cause_magnetic_detent.png").is_file()


def test_the_waveform_shakes():
    code = block("A waveform", "python").replace('"sawtooth"', '"sawtooth_of_the_page"')
    exec(code, {"__name__": "contributed"})
    shaken = Dither(amplitude=[[1.5]], frequency=10.0, waveform="sawtooth_of_the_page")
    assert [shaken.torque(t)[0, 0] for t in (0.0, 0.02, 0.06)] == pytest.approx([0.0, 0.6, -1.2])


def test_the_log_format_is_read_as_any_other(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "_formats", [*registry._formats])
    exec(block("A log format", "python"), {"__name__": "contributed"})
    log = hidden(panda(), lambda q, dq, ddq: 0.4 * dq, seconds=3.0)
    channels = {"time [ms]": 1e3 * log.t, "q": log.q, "torque": log.tau}
    (tmp_path / "log.json").write_text(json.dumps({k: x.tolist() for k, x in channels.items()}))
    (found,) = read_logs([tmp_path / "log.json"], 7)
    np.testing.assert_allclose(found.t, log.t, atol=1e-9)
    np.testing.assert_array_equal(found.q, log.q)
    np.testing.assert_array_equal(found.tau, log.tau)
    (finding,) = check(tmp_path / "log.json", robot="panda").findings[:1]
    assert "torque1 to torque7 are tau1 to tau7" in finding.message


def test_the_law_compensates_in_the_loop(tmp_path):
    """A second of a path: the torque is that of the measured speed; files and report know it."""
    exec(block("A friction compensation", "python"), {"__name__": "contributed"})
    try:
        there = Path(name="there", position=np.array([[0.02, 0, 0]]), quaternion=np.eye(4)[:1])
        bench = GeneratedTrajectoryExperiment("panda", paths={"there": there}, scatter=False)
        found = bench.compensation("dead_zone").replace(width=0.02)
        write_compensation(tmp_path / "gains.csv", found)
        assert bench.compensation(tmp_path / "gains.csv") == found
        case = Case(trajectory="there", stiffness=(200, 20, 0), compensation=found)
        text = str(
            bench.measure([dataclasses.replace(case, compensation=None), case], iterations=1)
        )
        rig = bench.rig(1, 1)
        rig.begin(np.array([0]), [there], np.array([case.stiffness]), [(0,)])
        rig.compensator.set_rows(np.array([0]), [found])
        for _ in range(1000):
            speed = rig.seen_velocity[0].copy()
            rig.advance(1)
            expected = np.where(np.abs(speed) > 0.02, found.gain * np.sign(speed), 0.0)
            np.testing.assert_array_equal(rig.compensator.arrays.torque[0], expected)
    finally:
        LAWS.pop("dead_zone", None)
    assert "sign of the speed with a dead zone" in text


def test_the_engine_tests_joints():
    exec(block("An engine", "python"), {"__name__": "contributed"})
    try:
        settings = ConformanceSettings(hold_time=2.0, watched_time=1.0, go_time=2.0)
        here, there = (
            conformance(lugre(), engine=name, settings=settings, rates=())
            for name in ("mujoco", "one_by_one")
        )
    finally:
        ENGINES.pop("one_by_one", None)
    assert there.joints == here.joints
    assert there.engine.startswith("one_by_one 4")


def test_the_experiment_has_environments_of_every_arm(monkeypatch):
    code = block("An experiment", "python").replace('"still"', '"pagestill"')
    module = ModuleType("my_still")
    monkeypatch.setitem(sys.modules, "my_still", module)
    try:
        exec(code, vars(module))
        for env in (gym.make("PandaPAGESTILL-v0"), gym.make_vec("IiwaPAGESTILL-v0", num_envs=2)):
            env.reset(seed=1)
            assert np.all(env.step(env.action_space.low)[1] <= 0.0)
    finally:
        EXPERIMENTS.pop("pagestill", None)


def test_the_arm_has_environments(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for room in ("robots", "friction"):
        (tmp_path / "arms" / room).mkdir(parents=True)
    arms = tmp_path / "arms"
    name = "toy_of_the_page"
    toml = block("An arm", "toml").replace('"toy"', f'"{name}"').replace('"Toy"', '"ToyPage"')
    (arms / "robots" / f"{name}.xml").write_text(block("An arm", "xml"))
    (arms / "robots" / f"{name}.toml").write_text(toml)
    code = block("An arm", "python").replace("toy.toml", f"{name}.toml")
    exec(code, {"__name__": "contributed"})
    assert load_arm(name).joint_names == ("yaw", "shoulder")
    env = gym.make("ToyPageSJE-v0")
    observation, _ = env.reset(seed=0, options={"joint": 2, "load": "load", "direction": "+"})
    assert env.observation_space.contains(observation)
    assert env.step(env.action_space.low)[1] <= 0.0
