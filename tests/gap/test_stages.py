"""Progress of a diagnosis: shares of the whole that only grow, from nothing to all of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction_envs.gap.diagnose import diagnose
from stiction_envs.gap.stages import WEIGHTS, Stages
from stiction_envs.hidden.hidden_logs import make_case


@pytest.mark.slow
def test_a_diagnosis_says_every_stage_in_its_order(tmp_path: Path) -> None:
    said: list[tuple[str, float | None]] = []
    stages = Stages(lambda *x: said.append(x))
    found = diagnose(make_case(0, ("coulomb_friction",)).logs, "panda", progress=stages)
    found.write(tmp_path, progress=stages)
    assert list(dict.fromkeys(x for x, _ in said)) == [x for x in WEIGHTS if x != "check"]
    shares = [y for _, y in said]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_stage_that_comes_again_takes_nothing_back() -> None:
    said: list[float | None] = []
    stages = Stages(lambda _, share: said.append(share))
    for stage, part in (("choosing causes", 0.5), ("reading", 0.2), ("choosing causes", 0.4)):
        stages(stage, part)
    assert said == [said[0]] * 3


def test_all_stages_are_the_whole_with_and_without_a_check() -> None:
    for without in ((), ("check",)):
        said: list[float | None] = []
        stages = Stages(lambda _, share, said=said: said.append(share), without)
        for stage in WEIGHTS:
            if stage not in without:
                stages(stage, 0.0)
        assert said[0] == 0.0
        assert len(set(said)) == len(said)
        stages("report", 1.0)
        assert said[-1] == pytest.approx(1.0, abs=1e-12)


def test_of_a_stage_that_is_not_known_no_share_is_said() -> None:
    said: list[tuple[str, float | None]] = []
    Stages(lambda *x: said.append(x))("simulating the nominal arm", 0.0)
    assert said == [("simulating the nominal arm", None)]
