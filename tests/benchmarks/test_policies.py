"""What counts as beating, its statistics, and one yardstick for all agents of `policies`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from benchmarks.learning import policies
from benchmarks.learning.policies import Agent, improvement, mean, measure, with_interval
from benchmarks.learning.policies_page import BASELINE
from stiction_envs.control.compensation import Compensation
from stiction_envs.envs.agents import NoDither
from stiction_envs.envs.evaluation import evaluate


def test_interquartile_mean_is_of_the_middle_half_and_infinite_scores_count():
    assert mean(np.array([[[-1e9, 1.0], [2.0, 3.0], [4.0, 5.0], [6.0, 1e9]]])) == [3.5]
    assert mean(np.array([[[1.0, 2.0, 3.0, np.inf]]])) == [2.5]
    assert mean(np.array([[[1.0, 2.0, np.inf, np.inf]]])) == [np.inf]


def test_runs_that_agree_leave_no_doubt_however_tasks_differ():
    assert with_interval(mean, np.tile([1.0, 5.0, 100.0, 7.0], (5, 1))) == (6.0, 6.0, 6.0)


def test_the_interval_covers(monkeypatch):
    """Normal scores of ten runs on four tasks, whose true interquartile mean is 0."""
    monkeypatch.setattr(policies, "DRAWS", 400)
    rng = np.random.default_rng(2)
    found = [with_interval(mean, rng.normal(size=(10, 4))) for _ in range(200)]
    assert 0.85 < np.mean([x.low <= 0 <= x.high for x in found]) < 0.99


def test_improvement_is_the_statistic_of_mann_and_whitney_task_by_task():
    rng = np.random.default_rng(6)
    ours, theirs = rng.integers(4, size=(2, 5, 30)).astype(float)  # many ties
    ours[0, :9] = theirs[1, 5:12] = np.inf
    wins = stats.mannwhitneyu(theirs, ours, axis=0, method="asymptotic").statistic
    assert improvement(ours[None], theirs[None]) == pytest.approx(wins.mean() / 25)


def made_up(error: float, vibration: float) -> list[dict[str, float]]:
    """Return episodes of five runs on all random paths, which scatter by 1 %."""
    rng = np.random.default_rng(0)
    gone = {f"undithered_{k}": 1.0 for k in ("position_left_m", "orientation_left_rad")}
    gone["undithered_vibration_mm"] = 1.0
    return [
        {
            **gone,
            "position_left_m": error * rng.uniform(0.99, 1.01),
            "orientation_left_rad": error * rng.uniform(0.99, 1.01),
            "vibration_moving_mm": vibration,
            "vibration_at_rest_mm": vibration,
        }
        for _ in range(5 * policies.PATHS)
    ]


@pytest.mark.parametrize(
    ("error", "vibration", "beats"), [(0.8, 1.0, 1), (0.8, 1.01, 0), (1.0, 1.0, 0)]
)
def test_who_is_better_without_doubt_and_as_calm_beats(error, vibration, beats):
    found = policies.compared("gte", made_up(error, vibration), made_up(1.0, 1.0))
    assert found["beats"].value == beats
    assert found["position_change_percent"].value == pytest.approx(100 * (error - 1), abs=0.5)


@pytest.mark.slow
def test_compensation_does_not_touch_the_undithered_runs_of_others(monkeypatch):
    """The yardstick of all agents: what the environment's own argument would take away."""
    for name in ("PATHS", "RUNS", "TOGETHER"):
        monkeypatch.setattr(policies, name, 1)
    gains = Compensation(kind="push", gain=(0.5,) * 7)
    rows = [
        measure(("gte", 1.0, Agent(name="x", make=NoDither, compensation=c)))["episodes"][0]
        for c in (None, gains)
    ]
    task = policies.environment("gte", compensation=gains)
    env = task.make(1)
    [theirs] = evaluate(env, NoDither(env), [policies.SEED], policies.episodes("gte"))
    name = "position_left_m"
    assert rows[1][name] == theirs[name] != rows[0][name]
    assert rows[1][f"undithered_{name}"] == rows[0][f"undithered_{name}"]
    assert rows[1][f"undithered_{name}"] != theirs[f"undithered_{name}"]


def test_the_page_is_made_of_the_rows(tmp_path: Path):
    options = policies.STUDY.parser().parse_args(["--out", str(tmp_path)])
    text = policies.STUDY.write_page(options, **policies.page(policies.ROWS, tmp_path))
    assert (tmp_path / "policies.md").read_text() == (
        policies.ROWS.parent / "policies.md"
    ).read_text()
    assert f"| {BASELINE} | –" in text
    assert (tmp_path / "policies.png").is_file()
