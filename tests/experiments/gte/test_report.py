"""A Generated Trajectory Experiment's report, of made-up runs."""

import dataclasses

import numpy as np
import pytest
from matplotlib.figure import Figure

from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.results import write_report
from stiction_envs.experiments.gte.rows import error_rows, run_row
from stiction_envs.reporting.png import save_full
from tests.experiments.gte.made_up import made_up


@pytest.fixture
def report(tmp_path):
    for name in ("path_xy", "path_3d", "error_position", "error_orientation"):
        save_full(Figure(figsize=(1, 1)), tmp_path / f"{name}.png")

    def write(*runs):
        found = [(run, Measures(run), "panda") for run in runs]
        rows = [row for x in found for row in error_rows(*x)]
        write_report(tmp_path, rows, [run_row(*x) for x in found])
        return (tmp_path / "report.md").read_text("utf-8"), (tmp_path / "report.html").read_text()

    return write


def constant(*values):
    return np.tile(values, (2, 700, 1))


def test_shares_are_of_what_is_left_without_dither(report):
    plain = made_up(constant(3e-3, 4e-3, 0.0, 0.01, 0.0, 0.0))
    shaken = made_up(constant(3e-3, 0.0, 0.0, 0.002, 0.0, 0.0), dithered=True)
    text, page = report(plain, shaken)
    verdict = text.splitlines()[2]
    start = "**Dither** leaves 60 % of the position error and 20 % of the orientation"
    assert verdict.startswith(start)
    assert "13.000 mm of vibration (13.000 mm at rest)" in verdict
    assert "| y [mm] | 4.00 | 0 (−100 %) |" in text
    assert "| roll [rad] | 2.00 ± 0.00 | 0.400 ± 0.000 (−80 %) |" in text
    assert page.index("leaves 60 %") < page.index("<img ") < page.index("<table")
    assert "http" not in page


def test_iterations_near_a_singular_pose_are_reported(report):
    run = made_up(constant(*[1e-3] * 6))
    near = {"singular": np.ones(2, dtype=bool)}
    text, _ = report(dataclasses.replace(run, flags=run.flags | near))
    assert "> No dither: 2 iterations came near a singular pose of 2." in text
    text, _ = report(run)
    assert "**1.73 mm and 1.73 mrad are left at the last goal**" in text
