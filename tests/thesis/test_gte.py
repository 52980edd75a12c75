"""Table 4.11 beside the simulation: rows, signs, page; the runs are made up."""

import csv
import dataclasses
import math

import numpy as np
import pytest

from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.rows import thesis_final_dither, thesis_window_sums
from stiction_envs.measured import thesis_table
from stiction_envs.thesis.gte import (
    FIGURES,
    run_thesis_cases,
    score,
    thesis_cases,
    window_sums,
    write_gte,
)
from tests.experiments.gte.made_up import made_up

SAMPLES = 200


def as_printed(self, cases, *, iterations=None, progress=None):
    """Pretend to run: constant errors whose sums are the printed ones."""
    runs = []
    for case in cases:
        size = np.array(list(thesis_window_sums(case).values())) / SAMPLES
        error = np.tile(size, (iterations or 10, 700, 1))
        run = made_up(error, iterations=iterations or 10, trajectory=case.trajectory)
        runs.append(dataclasses.replace(run, case=case))
    return runs


@pytest.fixture
def pairs(monkeypatch):
    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", as_printed)
    return run_thesis_cases(GeneratedTrajectoryExperiment("panda"), iterations=3)


def test_cases_are_those_of_table_4_11():
    cases = thesis_cases()
    assert [c.dithered for c in cases] == [False, True] * 4
    assert all(c.dither == thesis_final_dither() for c in cases[1::2])
    assert 6 * len({(c.trajectory, c.stiffness) for c in cases}) == len(thesis_table("4.11"))


def test_sums_as_printed_have_all_signs_right(pairs):
    rows = window_sums(pairs)
    assert len(rows) == 24
    for row, printed in zip(rows, thesis_table("4.11"), strict=True):
        assert (row.trajectory, row.axis) == (printed["trajectory"], printed["axis"])
        assert row.simulated_no_dither == pytest.approx(printed["mean_error_no_dither"])
        assert row.simulated_dither == pytest.approx(printed["mean_error_dither"])
        assert row.simulated_change == pytest.approx(row.measured_change)
    found = score(rows)
    assert (found["axes"], found["signs_right"]) == (24, 24)
    assert found["rises"] == found["rises_right"] == 5
    assert found["always_falls"] == 19
    assert found["factor"] == pytest.approx(1.0)


def test_a_wrong_sign_and_a_wrong_size_are_seen(pairs):
    rows = window_sums(pairs)
    turned = dataclasses.replace(
        rows[0],
        simulated_no_dither=2 * rows[0].simulated_dither,
        simulated_dither=2 * rows[0].simulated_no_dither,
    )
    found = score([turned, *rows[1:]])
    assert found["signs_right"] == 23
    assert found["factor"] > 1.05


def test_a_change_within_the_scatter_is_not_clear(pairs):
    row = dataclasses.replace(
        window_sums(pairs)[0], simulated_no_dither_std=0.3, simulated_dither_std=0.4
    )
    noisy = dataclasses.replace(row, simulated_no_dither=5.0, simulated_dither=5.2)
    # standard error of the change: 0.5 / 5 = 0.1 for 25 iterations
    assert not dataclasses.replace(noisy, simulated_dither=5.19).clear(25)
    assert dataclasses.replace(noisy, simulated_dither=5.21).clear(25)


@pytest.mark.slow
def test_files(pairs, tmp_path):
    found = write_gte(tmp_path, pairs, ensemble="## Other set-ups\n\nMany.\n")
    assert found["signs_right"] == 24
    with open(tmp_path / "table_4_11.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 24
    assert rows[0]["stiffness"] == "200/20/0"
    assert rows[0]["unit"] == "m·samples"
    text = (tmp_path / "gte.md").read_text(encoding="utf-8")
    assert "Signs of the dither's effect right: 24 of 24" in text
    assert '("every error falls" would have 19)' in text
    assert text.index("## Other set-ups\n\nMany.") < text.index("## Figure 4.6")
    for number in set(FIGURES.values()):
        assert f"## Figure {number}\n" in text
    drawn = {p.name for p in (tmp_path / "plots").iterdir()}
    assert len(drawn) == 16
    assert all(f"plots/{name}" in text for name in drawn)
    assert (tmp_path / "table_4_11.png").stat().st_size > 10_000


def test_one_iteration_has_no_spread(monkeypatch, tmp_path):
    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", as_printed)
    pairs = run_thesis_cases(GeneratedTrajectoryExperiment("panda"), iterations=1)
    rows = window_sums(pairs)
    assert math.isnan(rows[0].simulated_no_dither_std)
    assert not rows[0].clear(1)
