"""What a report says of an arm's friction: assumed, from its logs, or nothing where it is known."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.friction.from_file import ASSUMED, FROM_LOGS, friction_note, is_assumed
from stiction_envs.friction.parameters import load_friction
from stiction_envs.friction.sticking import friction_of
from stiction_envs.robots import load_arm
from tests.robots.arms import chain


@pytest.fixture
def own(tmp_path):
    (tmp_path / "own.xml").write_text(chain(3))
    return load_arm(tmp_path / "own.xml")


def test_of_an_own_arm_until_its_friction_is_given(own):
    friction = friction_of(own)
    assert friction_note(own, friction) == ASSUMED
    assert friction_note(own, None) == FROM_LOGS
    assert not is_assumed(load_friction("panda"))
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
