"""Torque tables as files: what `diagnose` is given, and a hidden rotor found through them."""

import dataclasses
import re

import numpy as np
import pytest

from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Job
from stiction_envs.friction.parameters import load_friction
from stiction_envs.gap.diagnose import diagnose
from stiction_envs.gap.extended_model import load_model
from stiction_envs.gap.tables.data import read_tables
from stiction_envs.measured.tables import SJERow, write_sje
from stiction_envs.robots import load_arm
from tests.gap.tables.hidden_tables import SETTINGS
from tests.refusal import refusal

ARM = load_arm("panda")
KEYS = [(load, d) for load in ("load", "no_load") for d in "+-"]


def base(joint: int, robot: str = "panda", tau: float = 0.8) -> list[SJERow]:
    return [
        SJERow(robot, joint, load, d, 0.0, 0.0, float(f"{d}{tau}"), 0.01, 4, 0.0)
        for load, d in KEYS
    ]


def dithered(joint: int, robot: str = "panda") -> list[SJERow]:
    return [
        SJERow(robot, joint, load, d, 30.0, 0.96, float(f"{d}0.6"), 0.01, 4, 0.25)
        for load, d in KEYS
    ]


@pytest.fixture
def put(tmp_path):
    def write(name: str, rows: list[SJERow]):
        write_sje(tmp_path / name, rows)
        return tmp_path / name

    return write


def test_base_and_dithered_torques_may_lie_in_several_files(put):
    """Files as `tune` writes them; a base torque in both counts once, each joint keeps its rows."""
    paths = [put("base.csv", base(5) + base(7, tau=0.7)), put("scale.csv", base(5) + dithered(5))]
    assert read_tables(paths, ARM) == base(5) + dithered(5)


def test_rows_of_other_robots_are_left_out(put):
    rows = base(5) + dithered(5) + base(5, "iiwa7", tau=2.0) + dithered(5, "iiwa7")
    assert read_tables([put("a.csv", rows)], ARM) == base(5) + dithered(5)
    rows = base(5, "iiwa") + dithered(5, "iiwa")  # as the thesis calls it
    assert read_tables([put("b.csv", rows)], load_arm("iiwa7")) == rows


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        (base(5) + base(5, tau=0.9) + dithered(5), "is 0.9 N·m and 0.8 N·m: expected one"),
        (base(5)[:3] + dithered(5), "but no base torque in no_load -: expected all four"),
        (base(5, tau=0.0) + dithered(5), "no base torque in load +: expected all four, not 0"),
        (base(5), "expected rows with dither too"),
        (base(5, "ur5") + dithered(5, "ur5"), "torques of ur5: expected robot panda"),
        (base(8) + dithered(8), "joint 8: panda has 7"),
    ],
)
def test_unusable_tables_are_refused(put, rows, says):
    refusal(lambda: read_tables([put("a.csv", rows)], ARM), re.escape(says))


@pytest.mark.slow
def test_a_hidden_rotor_is_found_and_put_into_the_model(tmp_path):
    """From an arm whose joint 7 has twice the rotor, through `sje.csv`, to a model that has it."""
    friction = load_friction("panda")
    rotor = friction.rotor_inertia * np.where(np.arange(7) == 6, 2.0, 1.0)
    hidden = SingleJointExperiment("panda", friction=friction.replace(rotor_inertia=rotor), seed=1)
    known = {j.configuration: hidden.expected(j) for j in hidden.jobs([7])}
    jobs = [Job(c, replica=0) for c in known]
    for k, (f, scale) in enumerate(SETTINGS, 1):
        jobs += [Job(c, f, round(scale * tau, 4), replica=k) for c, tau in known.items()]
    hidden.measure(jobs).save(tmp_path / "measured")
    d = diagnose(tmp_path / "measured" / "sje.csv", "panda")
    first = d.causes[0]
    assert (first.name, first.joints) == ("rotor_inertia", (7,))
    d.save(tmp_path / "why")
    found = load_model(tmp_path / "why" / "model.toml").parameters
    np.testing.assert_allclose(found.rotor_inertia, rotor, rtol=0.1)
    own = dataclasses.asdict(found)
    for name, value in dataclasses.asdict(friction).items():
        if name != "rotor_inertia":
            np.testing.assert_array_equal(own[name], value)
