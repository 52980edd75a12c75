from __future__ import annotations

import itertools

import optuna
import pytest
from optuna.trial import TrialState

from stiction_envs.errors import StictionError
from tuning.search import GridStudy, run_grids

GRID = {"frequency_hz": (80.0, 15.0), "scale": (0.8, 1.0, 1.2)}
CELLS = list(itertools.product(*GRID.values()))


@pytest.fixture(autouse=True)
def quiet():
    optuna.logging.set_verbosity(optuna.logging.ERROR)


@pytest.fixture
def storage(tmp_path):
    return f"sqlite:///{tmp_path / 'optuna.db'}"


def value(cell):
    return cell[0] / 100 + cell[1]


def evaluate(wanted):
    return {(i, cell): value(cell) for i, cell in wanted}


def test_a_grid_is_filled_once(storage):
    study = GridStudy("a", storage, GRID, seed=0)
    assert run_grids([study], evaluate) == [{c: value(c) for c in CELLS}]
    calls = []
    run_grids([GridStudy("a", storage, GRID, seed=0)], lambda w: calls.append(w) or {})
    assert calls == []
    assert len(study.study.get_trials(states=[TrialState.COMPLETE])) == len(CELLS)


def test_an_interrupted_batch_is_continued(storage):
    def interrupted(wanted):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_grids([GridStudy("a", storage, GRID, seed=0)], interrupted)
    study = GridStudy("a", storage, GRID, seed=0)
    assert run_grids([study], evaluate) == [{c: value(c) for c in CELLS}]
    assert len(study.study.get_trials()) == len(CELLS), "a trial was made twice"


@pytest.mark.parametrize("torn", [1, 3])
def test_a_trial_torn_before_its_parameters_is_replaced(storage, torn):
    """Killed between ask and suggest: the sampler believes the cell visited."""
    study = GridStudy("a", storage, GRID, seed=0)
    for _ in range(torn):
        study.study.ask()
    again = GridStudy("a", storage, GRID, seed=0)
    assert run_grids([again], evaluate) == [{c: value(c) for c in CELLS}]


def test_a_stuck_joint_is_a_failed_trial(storage):
    study = GridStudy("a", storage, GRID, seed=0)
    found = run_grids(
        [study],
        lambda w: {(i, c): float("nan") if c == (80.0, 1.0) else value(c) for i, c in w},
    )
    assert set(found[0]) == set(CELLS) - {(80.0, 1.0)}


def test_a_study_of_another_run_is_not_continued(storage):
    """A shared storage must not lend one robot's values to another."""
    run_grids([GridStudy("a", storage, GRID, seed=0, fingerprint="panda")], evaluate)
    GridStudy("a", storage, GRID, seed=0, fingerprint="panda")
    with pytest.raises(StictionError, match="of another run"):
        GridStudy("a", storage, GRID, seed=0, fingerprint="iiwa7")
