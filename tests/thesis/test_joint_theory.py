"""Theory on the Panda's joints: limits, and agreement with the fast simulation of one joint."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.protocol import Configuration
from stiction_envs.friction.parameters import load_friction
from stiction_envs.gap.tables.cells import cells
from stiction_envs.gap.tables.model import Bench, JointTables
from stiction_envs.measured import thesis_base
from stiction_envs.robots import load_arm
from stiction_envs.thesis.joint_theory import JointTheory

PARAMETERS = {
    4: {
        "rotor_inertia": 0.3,
        "bristle_stiffness": 1500.0,
        "coulomb_ratio": 0.85,
        "stribeck_velocity": 0.003,
        "joint_stiffness": 15000.0,
    },
    7: {
        "rotor_inertia": 0.09,
        "bristle_stiffness": 1500.0,
        "coulomb_ratio": 0.9,
        "stribeck_velocity": 0.004,
    },
}


@pytest.fixture(scope="module")
def bench():
    return Bench.of(load_arm("panda"), thesis_base("panda"), load_friction("panda"))


@pytest.mark.parametrize("joint", PARAMETERS)
def test_shaken_bristles_predict_the_simulation(bench, joint):
    """Law checked: LuGre averaged over the shaking, to 3 points where the joint sticks."""
    mine = [c for c in cells() if c.row.joint == joint and c.row.table == "4.6"]
    simulated = JointTables(joint, mine, bench).predict([PARAMETERS[joint]])[0]
    theory = JointTheory(joint=joint, parameters=PARAMETERS[joint])
    gaps = [
        abs(theory.change("creep", c.configuration, c.row.frequency_hz, c.row.amplitude_nm) - s)
        for c, s in zip(mine, simulated, strict=True)
        if theory.sticks(c.row.frequency_hz, c.row.amplitude_nm, c.configuration.index[1])
    ]
    assert len(gaps) >= 8
    assert np.median(gaps) < 0.03


def test_no_dither_changes_nothing():
    theory = JointTheory(joint=7, parameters=PARAMETERS[7])
    where = Configuration(7, "load", "+")
    for kind in ("sliding", "free", "creep", "slip", "band"):
        assert theory.change(kind, where, [15.0, 80.0], 0.0) == pytest.approx([0.0, 0.0], abs=1e-9)


def test_band_takes_the_amplitude_off():
    where = Configuration(7, "load", "+")
    change = JointTheory(joint=7).change("band", where, 15.0, 0.1)
    assert change == pytest.approx(-0.1 / abs(thesis_base("panda").get(7, "load", "+")))


def test_resonances_are_those_of_one_mass_and_of_two():
    """Rigid: √(σ0/J)/2π of rotor and link. Elastic: the rotor on its spring, √(K/J_r)/2π, too."""
    rigid = JointTheory(joint=7, parameters=PARAMETERS[7])
    (peak,) = rigid.resonances(0)
    expected = np.sqrt(1500.0 / rigid.on_bristles(0)) / (2 * np.pi)
    assert peak[0] == pytest.approx(expected, rel=0.3)  # damping lowers it
    assert peak[1] > 1
    elastic = JointTheory(joint=4, parameters=PARAMETERS[4])
    upper = elastic.resonances(0)[-1][0]
    alone = np.sqrt(15000.0 * (1 / 0.3 + 1 / elastic.link(0))) / (2 * np.pi)
    assert upper == pytest.approx(alone, rel=0.15)


def test_what_is_not_fitted_is_the_priors_centre():
    theory = JointTheory(joint=1)
    assert not theory.elastic
    assert theory.rotor == 0.195
    assert theory.on_bristles(0) == theory.rotor + theory.link(0)
    assert -0.5 < theory.step() < 0


def test_unknown_theory_is_named():
    with pytest.raises(StictionError, match="creep"):
        JointTheory(joint=1).change("magic", Configuration(1, "load", "+"), 15.0, 0.1)
