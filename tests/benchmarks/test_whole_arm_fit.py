"""Tests of benchmarks/whole_arm_fit.py on made losses: no arm is simulated."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.whole_arm_fit import POPULATION, Search, with_left_out_bases
from stiction_envs.cli.progress import Progress
from stiction_envs.gap.tables.cells import cells

NAMES = ("a", "b")
GENERATIONS = 3


class Quadratic:
    """What `Search` asks of a problem; each joint's best is 0.7 of every axis of the cube."""

    def __init__(self, stop_after: int = 10**6) -> None:
        fit = SimpleNamespace(
            tables=SimpleNamespace(names=NAMES),
            cube=lambda p: np.array([p[n] for n in NAMES]),
            parameters=lambda x: dict(zip(NAMES, map(float, x), strict=True)),
        )
        self.fits = {1: fit, 2: fit}
        self.start = {j: {"a": 0.5, "b": 0.6} for j in self.fits}
        self.asked: list[dict[int, dict[str, float]]] = []
        self._stop_after = stop_after

    def losses(self, parameters: dict[int, dict[str, float]]) -> dict[int, float]:
        if len(self.asked) == self._stop_after:
            raise KeyboardInterrupt
        self.asked.append(parameters)
        return {j: sum((v - 0.7) ** 2 for v in p.values()) for j, p in parameters.items()}


def test_an_interrupted_search_goes_on_with_the_same_candidates(tmp_path: Path) -> None:
    whole = Quadratic()
    best = Search(whole, tmp_path / "whole.json", "code").run(GENERATIONS, Progress())
    first, rest = Quadratic(stop_after=POPULATION + 3), Quadratic()
    with pytest.raises(KeyboardInterrupt):
        Search(first, tmp_path / "kept.json", "code").run(GENERATIONS, Progress())
    again = Search(rest, tmp_path / "kept.json", "code").run(GENERATIONS, Progress())
    assert first.asked + rest.asked == whole.asked
    assert again == best
    assert all(f.loss < 0.05 for f in best.values())


def test_candidates_of_other_code_are_not_taken(tmp_path: Path) -> None:
    Search(Quadratic(), tmp_path / "kept.json", "code").run(1, Progress())
    assert Search(Quadratic(), tmp_path / "kept.json", "code").losses
    assert not Search(Quadratic(), tmp_path / "kept.json", "other").losses


def test_a_left_out_base_undoes_what_is_common_to_a_configuration_and_nothing_else() -> None:
    every = cells()
    measured = np.array([c.change for c in every])
    configurations = list(dict.fromkeys(c.configuration for c in every))
    factor = np.array([0.9 + 0.01 * configurations.index(c.configuration) for c in every])
    off_by_bases = (1 + measured) / factor - 1
    np.testing.assert_allclose(with_left_out_bases(every, off_by_bases), measured, atol=1e-12)
    one_cell = measured.copy()
    one_cell[5] += 0.1
    assert with_left_out_bases(every, one_cell)[5] == pytest.approx(one_cell[5])
