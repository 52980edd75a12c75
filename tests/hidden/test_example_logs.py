"""The example logs are readable logs of an arm that a rigid simulation gets wrong."""

from __future__ import annotations

import json

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.example_logs import main, write_example
from stiction_envs.measured.logs.reader import read_logs
from stiction_envs.robots import load_arm


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Short ones: the moves of the first seconds are already in them."""
    folder = tmp_path_factory.mktemp("example") / "new"
    write_example(folder, seconds=3.0, second=3.0)
    return folder


def test_both_logs_are_read_without_a_warning(folder):
    for log in read_logs([folder / "log.csv", folder / "other.csv"], 7):
        assert not log.warnings
        assert np.ptp(log.q, axis=0).min() > 0.05


def test_the_payload_is_what_a_rigid_arm_lacks(folder):
    (log,) = read_logs([folder / "log.csv"], 7)
    truth = json.loads((folder / "hidden.json").read_text(encoding="utf-8"))
    payload = (truth["payload"]["mass_kg"], *truth["payload"]["com_m"])
    off = {}
    for name, arm in (
        ("without", load_arm("panda")),
        ("with", load_arm("panda", payload=payload)),
    ):
        gravity = inverse_dynamics(arm.pinocchio(), log.q, 0 * log.q, 0 * log.q)
        off[name] = np.abs(np.mean(log.tau - gravity, axis=0))[[1, 3]]
    # of joints 2 and 4, which carry it; friction and inertia leave less in the mean
    assert (off["with"] < 0.8).all()
    assert (off["without"] > 1.5).all()


def test_a_folder_that_exists_is_left_alone(folder, capsys):
    before = (folder / "log.csv").read_bytes()
    with pytest.raises(StictionError, match="exists already"):
        write_example(folder)
    assert main([str(folder)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert (folder / "log.csv").read_bytes() == before
