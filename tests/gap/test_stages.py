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
