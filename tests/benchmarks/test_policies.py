"""How far the policy benchmark is: in seconds that are assumed, of everything that it will do."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from benchmarks._policies_plan import SMALL, trainings
from benchmarks._policies_rows import Rows
from benchmarks._policies_training import DONE, folder
from benchmarks.policies import Benchmark


def finish(work: Path, best: str | None) -> None:
    """Finish trainings, of which TD3's had the best evaluations."""
    for training in trainings(SMALL, best):
        one = folder(work, SMALL, training)
        one.path.mkdir(parents=True, exist_ok=True)
        found = {"code": "any", "steps_per_second": 1.0}
        (one.path / DONE).write_text(json.dumps(found), "utf-8")
        one.policy.write_bytes(b"weights")
        value = -0.5 if training.algorithm == "td3" else -0.9
        text = f"steps,evaluation_return\n0,-1.0\n1,{value}\n"
        (one.path / "curve.csv").write_text(text, "utf-8")


def test_the_bar_is_full_when_all_is_done_and_not_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def share() -> float:
        whole = Benchmark(tmp_path, SMALL, math.inf)
        whole.close()
        return whole._bar.n / whole._bar.total

    assert share() == 0
    monkeypatch.setattr(Rows, "there", lambda *_: True)
    agents = share()
    finish(tmp_path, None)
    panda = share()
    finish(tmp_path, "td3")
    assert 0 < agents < panda < 1
    assert share() == pytest.approx(1)


def test_the_bar_follows_a_training(tmp_path: Path):
    whole = Benchmark(tmp_path, SMALL, math.inf)
    one = trainings(SMALL, None)[0]
    whole._training("panda", {one: 0.25})
    quarter = whole._bar.n
    whole._training("panda", {one: 1.0})
    assert whole._bar.n == pytest.approx(4 * quarter)
    assert quarter > 0
    whole.close()
