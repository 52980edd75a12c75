"""A joint with made-up settings, for tests that need no simulation; tables of made-up robots."""

import csv

import numpy as np

from tests.command_line import csv_rows
from tuning.robot.posterior import Candidates, Posterior, Readings
from tuning.settings import tuning_settings

S = tuning_settings().robot
COLUMNS = ("robot", "joint", "load", "direction", "frequency_hz", "amplitude_nm", "tau_nm")
BASE_NM = 0.8


def joint(predicted: np.ndarray, frequencies: np.ndarray | None = None) -> Candidates:
    """Return settings with the same prediction in all four configurations."""
    s = len(predicted)
    f = np.geomspace(15.0, 80.0, s) if frequencies is None else frequencies
    return Candidates(
        joint=1,
        frequency_hz=f,
        amplitude_nm=np.ones(s),
        predicted=np.repeat(np.asarray(predicted, dtype=float)[:, None], 4, axis=1),
        displacement=np.repeat(1e-4 / f[:, None], 4, axis=1),
        deviation=np.zeros((1, s, 4)),
        eligible=np.ones(s, dtype=bool),
    )


def read(truth: np.ndarray, settings: list[int]) -> Readings:
    """Return readings of all cells of settings; truth (S, 4)."""
    return Readings(len(truth), [(s, c, float(truth[s, c])) for s in settings for c in range(4)])


def posterior_of(candidates: Candidates, readings: Readings) -> Posterior:
    return Posterior(candidates, readings, S)


def fill(out, name="told.csv", *, left=lambda joint, f: 0.9):
    """Answer measure.csv as a robot whose dither leaves ``left`` of the base torque."""
    rows = csv_rows(out / "measure.csv")
    for row in rows:
        f, dithered = float(row["frequency_hz"]), float(row["amplitude_nm"]) > 0
        sign = 1 if row["direction"] == "+" else -1
        row["tau_nm"] = sign * BASE_NM * (left(int(row["joint"]), f) if dithered else 1.0)
    return write(out.parent / name, rows)


def write(path, rows):
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    return path
