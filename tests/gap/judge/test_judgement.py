"""Judgements, as ``diagnosis.json`` holds them."""

from dataclasses import replace

from stiction_envs.gap.judge.judgement import Estimate, Judgement, NamedCause, NotShown
from stiction_envs.reporting.json_text import plain

MASS = Estimate(value=1.2, ci95=[1.0, 1.4], on_bound=False)


class Plain(Judgement):
    gain_percent = 40.0

    def to_json(self) -> dict[str, object]:
        return self.judged_json()


def test_numbers_are_written_where_they_are_known() -> None:
    weighed = NamedCause(
        name="payload",
        joints=(2, 4),
        gain_percent=40.0,
        parameters={0: {"mass_kg": MASS}},
        nats=31.0,
        rivals=(("link_parameters", 1.5), ("base_tilt", 12.0)),
        evidence="it sags",
        confused_with=("link_parameters",),
    )
    not_weighed = replace(weighed, nats=float("nan"))
    judged = Plain(robot="two", verdict="explained", causes=(weighed, not_weighed))
    first, second = plain(judged.judged_json())["causes"]
    assert (first["nats"], second["nats"]) == (31.0, None)
    assert first["rivals"] == [
        {"name": "link_parameters", "nats": 1.5},
        {"name": "base_tilt", "nats": 12.0},
    ]
    assert first["parameters"] == {"mass_kg": {"value": 1.2, "ci95": [1.0, 1.4], "on_bound": False}}
    assert {"shares_percent", "not_shown"}.isdisjoint(judged.judged_json())
    shares, size = {"named": 40.0, "left": 60.0}, {"stiffness_nm_per_rad": (-6.0, 6.0)}
    spring = NotShown(name="external_spring", joints=(3,), parameters=size)
    found = plain(replace(judged, shares_percent=shares, not_shown=(spring,)).judged_json())
    assert found["shares_percent"] == shares
    assert found["not_shown"] == [
        {
            "name": "external_spring",
            "joints": [3],
            "parameters": {"stiffness_nm_per_rad": {"ci95": [-6.0, 6.0]}},
        }
    ]
