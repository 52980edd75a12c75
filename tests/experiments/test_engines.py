"""The conformance test inside other engines: same questions, same answers, or the engine's refusal.

Tests of an engine are left out where its package is missing; the rest run with stock MuJoCo.
"""

import dataclasses
from importlib.util import find_spec
from typing import ClassVar

import mujoco
import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.experiments.conformance import STILL_SINGLE, conformance
from stiction_envs.experiments.conformance_report import ConformanceSettings
from stiction_envs.experiments.engines import ENGINES, Refused, base, engine_named
from stiction_envs.experiments.engines.base import MuJoCo
from stiction_envs.friction.export import plain_mjcf
from tests.command_line import csv_rows
from tests.experiments.test_conformance import lugre, stock
from tests.friction.gyro import sticking
from tests.refusal import refusal

SHORT = ConformanceSettings(hold_time=4.0, watched_time=1.0, rise_time=2.0, go_time=4.0)


class Copy(MuJoCo):
    """Stock MuJoCo under another name, which keeps what it was asked to simulate."""

    name: ClassVar = "copy"
    single: ClassVar = True
    motor: ClassVar = "voltage"

    def __init__(self) -> None:
        self.asked: list[base.Bare] = []

    def simulate(self, drive):
        self.asked.append(drive.bare)
        return super().simulate(drive)


class Picky(MuJoCo):
    """Takes no model."""

    name: ClassVar = "picky"

    def simulate(self, drive):
        raise Refused("no LuGre\n   here")


@pytest.fixture
def copy(monkeypatch) -> Copy:
    engine = Copy()
    monkeypatch.setitem(ENGINES, "copy", engine)
    monkeypatch.setitem(ENGINES, "picky", Picky())
    return engine


def test_another_engine_answers_the_same_questions(copy):
    """One that computes what MuJoCo does gives its numbers to the bit, without ramps."""
    here, there = (conformance(lugre(), engine=e, settings=SHORT) for e in ("mujoco", "copy"))
    assert dataclasses.replace(here.joints[0], breakaway=()) == there.joints[0]
    assert there.rates == ()
    (joint,) = conformance(lugre(), engine="copy", settings=SHORT, rates=(1.0,)).joints
    assert joint.breakaway[0] == pytest.approx(here.joints[0].breakaway[-1])


def test_rows_name_the_engine_and_its_tolerance(copy, tmp_path):
    report = conformance(lugre(), engine="copy", settings=SHORT)
    assert report.settings.still == STILL_SINGLE > SHORT.still
    assert report.provenance["arguments"]["engine"]["mujoco"] == mujoco.__version__
    report.save(tmp_path / "a")
    (row,) = csv_rows(tmp_path / "a" / "conformance.csv")
    assert row["engine"] == f"copy {mujoco.__version__}"
    assert row["refused"] == ""
    assert f"in copy {mujoco.__version__}" in str(report)
    with_mujoco = conformance(lugre(), settings=SHORT, rates=()).to_json()
    assert "engine" not in with_mujoco["rows"][0]
    assert with_mujoco["settings"]["still"] == SHORT.still


def test_a_model_is_what_export_writes_for_the_engine(copy):
    model = sticking(stiction=0.5)
    assert conformance(model, engine="copy", settings=SHORT).passed
    text = copy.asked[0].mjcf
    assert text == plain_mjcf(model, friction_name=model.arm.name, motor="voltage")


def test_a_refusal_is_a_row_with_the_engines_line(copy):
    report = conformance(lugre(), engine="picky", settings=SHORT)
    assert not report.passed
    (row,) = report.to_json()["rows"]
    assert row["refused"] == "no LuGre here"
    assert (row["holds"], row["goes"]) == (False, False)
    assert np.isnan(row["creep_rad_s"])
    assert "refused: no LuGre here" in str(report)


def test_a_missing_package_names_its_extra(monkeypatch):
    monkeypatch.setattr(base, "find_spec", lambda name: None if "warp" in name else object())
    with pytest.raises(StictionError, match=r"mujoco-warp: pip install 'stiction-envs\[warp\]'"):
        conformance(lugre(), engine="warp")
    refusal(lambda: engine_named("bullet"), "unknown engine 'bullet': expected one of mujoco")


def test_actuators_in_groups_that_are_off_are_silenced():
    text = stock(actuator='<position joint="j" kp="9" group="30"/>')
    model = mujoco.MjModel.from_xml_string(text)
    assert base.silent(model).actuator_gainprm[0, 0] == 9.0
    model.opt.disableactuator = 1 << 30
    assert not base.silent(model).actuator_gainprm.any()
    assert not model.actuator_biasprm.any()


def needs(name: str) -> None:
    for module, package in ENGINES[name].packages:
        if find_spec(module) is None:
            pytest.skip(f"{package} is not installed (extra {name})")


@pytest.mark.parametrize("name", ["warp", "newton"])
def test_lugre_sticks_there_as_in_mujoco(name):
    needs(name)
    motor = ENGINES[name].motor
    model = sticking(stiction=0.5, joint_stiffness=[5e3, np.inf], rotor_inertia=0.1)
    here = conformance(model, settings=SHORT, rates=())
    there = conformance(model, engine=name, settings=SHORT)
    assert motor is not None
    assert there.passed, str(there)
    for a, b in zip(here.joints, there.joints, strict=True):
        assert b.deflection == pytest.approx(a.deflection, rel=2e-3)
        assert b.go_time == pytest.approx(a.go_time, abs=2e-3)


@pytest.mark.parametrize("name", ["warp", "newton"])
def test_stock_frictionloss_creeps_there_too(name):
    needs(name)
    (joint,) = conformance(stock(0.3 / 0.9), engine=name, settings=SHORT).joints
    assert not joint.holds
    assert joint.creep == pytest.approx(1.6e-3, rel=0.05)


@pytest.mark.parametrize(("name", "says"), [("newton", "'voltage'"), ("mjx", "DCMOTOR")])
def test_refusals(name, says):
    needs(name)
    report = conformance(lugre(), engine=name, settings=SHORT)
    assert says in report.refused
