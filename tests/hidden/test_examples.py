"""The example logs are readable logs of arms that a simulation gets wrong, and can be made."""

import json

import numpy as np
import pytest

from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.examples import SHIPPED, write_example
from stiction_envs.hidden.servo_logs import ENCODER
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.reader import read_logs, read_servo_logs
from stiction_envs.robots import load_arm
from tests.hidden.make_examples import panda, so101


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("example")
    for name in ("panda", "so101"):
        write_example(name, folder / name)
    return folder


def test_the_panda_s_logs_lack_a_payload(folder):
    log, other = read_logs([folder / "panda" / f"{x}.csv" for x in ("log", "other")], 7)
    for one in (log, other):
        assert not one.warnings
        assert np.ptp(one.q, axis=0).min() > 0.05
    truth = json.loads((folder / "panda" / "hidden.json").read_text(encoding="utf-8"))
    payload = (truth["payload"]["mass_kg"], *truth["payload"]["com_m"])
    off = []
    for arm in (load_arm("panda"), load_arm("panda", payload=payload)):
        gravity = inverse_dynamics(arm.pinocchio(), log.q, 0 * log.q, 0 * log.q)
        off.append(np.abs(np.mean(log.tau - gravity, axis=0))[[1, 3]])
    # of joints 2 and 4, which carry it; friction and inertia leave less in the mean
    assert (off[0] > 1.5).all()
    assert (off[1] < 0.8).all()


def test_the_so101_stops_short_and_is_read_in_rad(folder):
    place = folder / "so101"
    arm = load_arm(place / "so101.urdf")
    assert arm.controller_rate_hz == 50
    naming = Naming(joints=arm.joint_names, calibration=place / "calibration.json")
    (recorded,) = read_servo_logs([place / "recording"], 6, limits=arm.limits, naming=naming)
    (other,) = read_servo_logs([place / "other.csv"], 6, limits=arm.limits)
    for log, rows in ((recorded, 2700), (other, 1350)):
        assert len(log.t) == rows
        assert not log.warnings
        assert (np.abs(log.q - log.q_cmd).mean(axis=0) > 2 * ENCODER).all()


@pytest.mark.slow
def test_what_is_shipped_is_what_its_script_makes(folder, tmp_path):
    """To a step of the encoders: other machines round other last bits."""
    arrays, truth = panda()
    assert json.loads(truth) == json.loads((SHIPPED / "panda.json").read_text("utf-8"))
    with np.load(SHIPPED / "panda.npz") as shipped:
        assert set(shipped) == set(arrays)
        for name in ("log_q", "other_q"):
            off = np.cumsum(arrays[name], axis=0) - np.cumsum(shipped[name], axis=0)
            assert np.abs(off).max() <= 1
        assert all(np.abs(arrays[x] - shipped[x]).max() <= 1 for x in ("log_tau", "other_tau"))
    so101(tmp_path)
    for name in ("so101.urdf", "so101.toml", "calibration.json", "hidden.json"):
        assert (tmp_path / name).read_text() == (folder / "so101" / name).read_text()
    made, other = (
        np.loadtxt(x / "other.csv", delimiter=",", skiprows=1) for x in (tmp_path, folder / "so101")
    )
    np.testing.assert_allclose(made, other, atol=1.01 * ENCODER)
