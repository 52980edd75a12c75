import math

import numpy as np
import pytest

from stiction_envs.experiments.sje.protocol import configurations
from tests.refusal import refusal
from tuning.robot.measured_table import check_measured, read_measured
from tuning.search.bounds import Bounds
from tuning.settings import tuning_settings

HEADER = "robot,joint,load,direction,frequency_hz,amplitude_nm,tau_nm"
BASE = dict.fromkeys(configurations(2), 0.8)
BOUNDS = Bounds(
    amplitude_nm=np.array([[0.0, 2.0], [0.1, 3.0]]),
    frequency_hz=np.array([[15.0, 80.0], [20.0, 60.0]]),
    torque_rate=np.array([100.0, np.inf]),
    forbidden_hz=((), ((35.0, 45.0),)),
    displacement_rad=np.full(2, np.nan),
    vibration_m=(np.nan, np.nan),
)


@pytest.fixture
def told(tmp_path):
    path = tmp_path / "told.csv"

    def read(*rows, header=HEADER):
        path.write_text("\n".join([header, *rows]) + "\n")
        found = read_measured(path, "panda", 2)
        check_measured(found, BOUNDS, BASE, tuning_settings().robot)
        return found

    return read


def test_rows_are_read(told):
    rows = told(
        "panda,1,load,+,0,0,0.82",
        "panda,1,load,+,15,0.5,0.7",
        "panda,1,load,+,15,0.5,0.72",
        "panda,1,load,-,15,0.5,nan",
        "panda,1,no_load,-,15,0.5,",
    )
    assert [r.tau_nm for r in rows[:3]] == [0.82, 0.7, 0.72]
    assert rows[0].is_base
    assert math.isnan(rows[3].tau_nm)
    assert len(rows) == 4, "an empty torque is no measurement"


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("iiwa7,1,load,+,15,0.5,0.7", "robot is 'iiwa7': expected panda"),
        ("panda,3,load,+,15,0.5,0.7", "joint is 3: expected a whole number from 1 to 2"),
        ("panda,1,loaded,+,15,0.5,0.7", "unknown load 'loaded': expected one of load, no_load"),
        ("panda,1,load,+,nan,0.5,0.7", "frequency_hz is 'nan': expected a finite number"),
        ("panda,1,load,+,0,0.5,0.7", "frequency_hz is 0: expected > 0"),
        ("panda,1,load,+,15,-0.5,0.7", "expected >= 0"),
        ("panda,1,load,+,15,0.5,inf", "tau_nm is 'inf'"),
        ("panda,1,load,+,15,0.5,700", "tau_nm is 700: expected up to 3.2 N·m"),
        ("panda,1,load,+,0,0,820", r"tau_nm is 820: expected 0.08 to 8 N·m"),
        ("panda,1,load,+,0,0,0.00082", "tau_nm is 0.00082: expected 0.08 to 8 N·m"),
        ("panda,1,load,-,15,0.5,0.7", "tau_nm is 0.7 in direction -: expected < 0"),
        ("panda,1,load,+,94.2,0.5,0.7", "frequency_hz is 94.2: expected 15 to 80 Hz"),
        ("panda,2,load,+,40,0.5,0.7", "frequency_hz is 40: expected outside of 35 to 45 Hz"),
        ("panda,1,load,+,15,500,0.7", "amplitude_nm is 500: expected 0 to 1.06 N·m there"),
        ("panda,2,load,+,30,0.05,0.7", "amplitude_nm is 0.05: expected 0.1 to 3 N·m there"),
        ("panda,1,load,+,15,0.5,", "every tau_nm is empty"),
    ],
)
def test_what_cannot_be_a_measurement_is_one_clear_line(told, row, message):
    assert "told.csv" in refusal(lambda: told(row), message)


def test_a_measured_base_torque_goes_before_the_simulated_one(told):
    """A robot that sticks three times as much as simulated may say so."""
    told("panda,1,load,+,0,0,2.4", "panda,1,load,+,15,0.5,4.0")
    refusal(lambda: told("panda,1,load,+,15,0.5,4.0"), "expected up to 3")
