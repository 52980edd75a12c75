"""Bodies beside small errors of all links: each is named if the logs ask for it."""

from __future__ import annotations

import pytest

from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.hidden.hidden_logs import make_case


@pytest.mark.parametrize("seed", [911, 913])
def test_a_payload_is_named_alone_where_every_link_is_a_little_off(seed: int) -> None:
    """In 911 two links stood in for the rest, in 913 links that are far off stood in for it."""
    case = make_case(seed, ("phantom_payload",), scatter=0.03)
    (hidden,) = case.hidden
    found = diagnose_logs(case.logs, case.robot, nominal=case.nominal)
    assert [c.name for c in found.causes] == ["payload"]
    (mass,) = (p["mass_kg"] for p in found.causes[0].parameters.values())
    assert mass.ci95[0] <= hidden.values["mass_kg"] <= mass.ci95[1]
