"""The blind study: cases whose links are off have rows of their own, and a column of the page."""

from typing import Any

import numpy as np
import pytest

from benchmarks.accuracy.blind_logs import STUDY, Job, Rows, page, scores
from stiction_envs.hidden.torque_effects import cause_of
from stiction_envs.robots import load_arm
from stiction_envs.robots.regressor import inertial_parameters


def row(*hidden: str, named: tuple[str, ...] = (), second: float = 0.1, **more: Any) -> Any:
    """Return a row as `judge` makes it."""
    return {
        "seed": 1,
        "hidden": list(hidden),
        "expected": [cause_of(x) for x in hidden],
        "motion": "fourier",
        "alone_over_noise": [9.0] * len(hidden),
        "verdict": "explained",
        "named": list(named),
        "joints": [[1]] * len(named),
        "right_joint": [x in named for x in hidden],
        "inside": {f"{x}.value": True for x in hidden},
        "held_out_nm": [0.1] * 7,
        "second": {"motion": "fast", "extended_nm": [second] * 7, "truth_nm": [0.1] * 7},
        "seconds": 10.0,
        **more,
    }


KNOWN = [row("torque_offset", named=("torque_offset",)), row(), row(), row("payload", broken="no")]
OFF = [
    row("torque_offset", named=("payload", "torque_offset"), second=0.2),
    row(named=("link_parameters",)),
    row(named=("torque_offset",)),
    row("torque_offset", "payload", named=("payload", "torque_offset")),
]


def test_bodies_that_are_not_hidden_are_counted() -> None:
    found = {text: hits for text, (_, hits) in scores(Rows(OFF)).items()}
    assert found["nothing is hidden, yet a cause is named"] == [True, True]
    assert found["the same, a body (payload or link)"] == [True, False]
    assert found["causes are hidden, but no body, yet one is named"] == [True]
    assert found["two causes are hidden, and all are named"] == [True]
    assert found["the model holds on a second motion"] == [False, True]


def test_links_that_are_off_are_a_column_where_there_are_rows(tmp_path: Any) -> None:
    values = page({0.0: KNOWN, 0.03: OFF, 0.1: []})
    lines = values["scores"].splitlines()
    assert lines[0] == "|  | target | links known | links 3 % and 3 mm off |"
    strongest = next(x for x in lines if "strongest" in x)
    assert strongest.endswith("| ≥ 95 % | 1/1 = 100 % | 0/1 = 0 % **missed** |")
    assert (values["cases"], values["broken"]) == (3, 1)
    first, second, third = values["links_off"]
    assert "torque_offset (" in first
    assert "nothing (" in second
    assert "nothing (" in third
    assert all(x.endswith(", links 0.03 off") for x in values["links_off"])
    options = STUDY.parser().parse_args(["--out", str(tmp_path)])
    text = STUDY.write_page(options, first=1, planned=4, **values)
    assert "In 1/1 = 100 % of simulated logs" in text
    assert "Cases with link errors in which another cause, or none, is named first:" in text


@pytest.mark.slow
def test_a_case_has_the_links_that_it_was_asked_for() -> None:
    makers = inertial_parameters(load_arm("panda").pinocchio())
    case = Job(7, ("torque_offset",), scatter=0.03).case()
    own = inertial_parameters(case.bare.rigid.pinocchio())
    assert 0.005 < np.abs(own[:, 0] / makers[:, 0] - 1).max() < 0.15
    assert [x.name for x in case.hidden] == ["torque_offset"]
    assert case.second
