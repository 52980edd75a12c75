"""Judgements, as ``diagnosis.json`` holds them."""

from __future__ import annotations

import math

from stiction_envs.gap.judge.judgement import Estimate, Judgement, NamedCause, NotShown
from stiction_envs.reporting.json_text import plain

MASS = Estimate(value=1.2, ci95=[1.0, 1.4], on_bound=False)


class Plain(Judgement):
    gain_percent = 40.0

    def to_json(self) -> dict[str, object]:
        return self.judged_json()


def judgement(**changes: object) -> Plain:
    """Return a judgement with one named cause."""
    cause = NamedCause(
        name="payload",
        joints=(2, 4),
        gain_percent=40.0,
        parameters={0: {"mass_kg": MASS}},
        nats=31.0,
        rivals=(("link_parameters", 1.5), ("base_tilt", 12.0)),
        evidence="it sags",
        confused_with=("link_parameters",),
    )
    return Plain(robot="two", verdict="explained", causes=(cause,), **changes)  # type: ignore[arg-type]


def test_how_sure_a_cause_is_and_its_rivals_are_written() -> None:
    (cause,) = judgement().judged_json()["causes"]  # type: ignore[misc]
    assert cause["nats"] == 31.0
    assert cause["rivals"] == [
        {"name": "link_parameters", "nats": 1.5},
        {"name": "base_tilt", "nats": 12.0},
    ]
    assert cause["parameters"] == {"mass_kg": {"value": 1.2, "ci95": [1.0, 1.4], "on_bound": False}}


def test_shares_and_what_was_not_shown_are_written_where_known() -> None:
    assert {"shares_percent", "not_shown"}.isdisjoint(judgement().judged_json())
    shares = {"named": 40.0, "links": 10.0, "set_up": 0.0, "left": 50.0}
    spring = NotShown(
        name="external_spring", joints=(3,), parameters={"stiffness_nm_per_rad": (-6.0, 6.0)}
    )
    found = plain(judgement(shares_percent=shares, not_shown=(spring,)).judged_json())
    assert found["shares_percent"] == shares
    assert found["not_shown"] == [
        {
            "name": "external_spring",
            "joints": [3],
            "parameters": {"stiffness_nm_per_rad": {"ci95": [-6.0, 6.0]}},
        }
    ]


def test_a_cause_that_was_not_weighed_has_no_number() -> None:
    cause = NamedCause(
        name="payload",
        joints=(),
        gain_percent=1.0,
        parameters={0: {}},
        evidence="",
        confused_with=(),
    )
    assert math.isnan(cause.nats)
    assert plain(cause.to_json())["nats"] is None
