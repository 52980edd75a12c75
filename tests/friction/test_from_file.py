"""Friction that a robot's own file states is the friction of its arm."""

from pathlib import Path

import numpy as np
import pytest

from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.export import export
from stiction_envs.friction.from_file import (
    ASSUMED,
    FROM_LOGS,
    file_friction,
    friction_note,
    own_friction,
    shipped_friction,
    simulated_note,
)
from stiction_envs.friction.parameters import GENERIC, QUANTITIES, friction_sources, load_friction
from stiction_envs.friction.sticking import friction_of, sticking_model
from stiction_envs.robots import Arm, load_arm

TWO = """<mujoco><compiler angle="radian"/><worldbody><body name="l1" pos="0 0 0.1">
<joint name="a" axis="0 1 0" range="-2 2" {a}/><geom size="0.05" pos="0 0 0.1" mass="2.5"/>
<body name="l2" pos="0 0 0.3"><joint name="b" axis="0 1 0" range="-2 2" {b}/>
<geom size="0.05" pos="0 0 0.1" mass="1"/></body></body></worldbody></mujoco>"""


def arm_of(tmp_path: Path, a: str = "", b: str = "") -> Arm:
    """Load an arm whose joints have some attributes."""
    path = tmp_path / "own.xml"
    path.write_text(TWO.format(a=a, b=b), "utf-8")
    return load_arm(path)


def test_an_arm_of_a_file_that_states_nothing_has_generic_friction(tmp_path: Path):
    own, generic = own_friction(arm_of(tmp_path)), load_friction(GENERIC, 2)
    assert all(np.array_equal(getattr(own, q), getattr(generic, q)) for q in QUANTITIES)


STATED = 'armature="0.05" damping="0.7" frictionloss="1.3"'


def test_stated_friction_and_rotors_replace_generic_ones(tmp_path: Path):
    """Sources tell the file from the numbers that are assumed."""
    own = own_friction(arm_of(tmp_path, STATED, STATED.replace("1.3", "0.4")))
    np.testing.assert_array_equal(own.stiction, [[1.3, 1.3], [0.4, 0.4]])
    np.testing.assert_array_equal(own.coulomb_ratio, 1.0)
    np.testing.assert_array_equal(own.viscous, 0.7)
    np.testing.assert_array_equal(own.rotor_inertia, 0.05)
    assert not own.ripple_amplitude.any()
    sources, _ = friction_sources(own)
    file = {k for k, x in sources.items() if x.startswith("the robot's file")}
    assert {"stiction", "viscous", "rotor_inertia"} <= file
    assert sources["warm_up_viscous"].startswith("assumed")


def test_without_stated_dry_friction_it_stays_assumed(tmp_path: Path):
    arm = arm_of(tmp_path, 'damping="0.7"', 'damping="0.2"')
    own, generic = own_friction(arm), load_friction(GENERIC, 2)
    np.testing.assert_array_equal(own.stiction, generic.stiction)
    np.testing.assert_array_equal(own.viscous[:, 0], [0.7, 0.2])
    assert friction_note(arm, own) == ASSUMED
    assert friction_note(arm, file_friction(arm)) == ""


def test_a_report_of_simulations_says_what_was_taken(tmp_path: Path):
    arm = arm_of(tmp_path, f'{STATED} stiffness="9"')
    own = own_friction(arm)
    taken = "rotor inertia 0.05 0 kg·m², dry friction 1.3 0 N·m, damping 0.7 0 N·m·s/rad, springs"
    assert simulated_note(arm, own).startswith(f"own: taken from the file: {taken} 9 0 N·m/rad; in")
    calibrated = simulated_note(arm, own.replace(stiction=2 * own.stiction))
    assert "left out: dry friction 1.3 0 N·m." in calibrated
    assert simulated_note(load_arm("panda"), load_friction("panda")) == ""


def test_shipped_friction_takes_the_rotors_of_the_file(tmp_path: Path):
    shipped = shipped_friction(arm_of(tmp_path, 'armature="0.5" frictionloss="9"'))
    np.testing.assert_array_equal(shipped.rotor_inertia, [0.5, 0.0])
    np.testing.assert_array_equal(shipped.stiction, load_friction(GENERIC, 2).stiction)


def test_an_export_read_again_has_the_same_friction(tmp_path: Path):
    arm = arm_of(tmp_path, STATED, 'damping="0.2"')
    first = sticking_model(arm)
    path = tmp_path / "model.xml"
    path.write_text(export(arm).xml, "utf-8")
    again = sticking_model(path)
    for name in ("stiction", "coulomb_ratio", "viscous", "bristle_stiffness", "rotor_inertia"):
        one, other = (getattr(model.parameters, name) for model in (first, again))
        np.testing.assert_allclose(other, one, rtol=1e-9)


def test_the_friction_of_a_registered_arm_is_its_own():
    assert own_friction(load_arm("panda")).stiction[0, 0] == load_friction("panda").stiction[0, 0]


@pytest.mark.slow
def test_joints_break_away_at_the_frictionloss_of_the_file(tmp_path: Path):
    arm = arm_of(tmp_path, 'armature="0.05" frictionloss="1.3"', 'frictionloss="0.4"')
    experiment = SingleJointExperiment(arm, scatter=False)
    result = experiment.measure(experiment.jobs([1, 2], loads=["no_load"], directions=["+"]))
    tau = [row.tau_nm for row in result.rows]
    np.testing.assert_allclose(tau, [1.3, 0.4], rtol=0.2)


def test_a_report_notes_that_friction_is_assumed_until_it_is_given(tmp_path: Path):
    own = arm_of(tmp_path)
    friction = friction_of(own)
    assert friction_note(own, friction) == ASSUMED
    assert friction_note(own, None) == FROM_LOGS
    for name in ("stiction", "bristle_stiffness", "rotor_inertia"):
        other = friction.replace(**{name: 1.01 * np.asarray(getattr(friction, name)) + 1e-9})
        assert friction_note(own, other) == "", name


def test_the_commands_that_are_named_exist():
    from stiction_envs.cli.dispatch import all_commands, build_parser

    parser = build_parser(all_commands())
    for line in (
        ["excite", "ROBOT", "--sweeps"],
        ["diagnose", "LOG", "--robot", "ROBOT"],
        ["calibrate", "ROBOT", "TABLE.csv"],
        ["sje", "ROBOT", "--friction", "model.toml"],
    ):
        parser.parse_args(line)
        assert line[0] == "sje" or f"`stiction {' '.join(line)}`" in ASSUMED
