"""Arms whose links are all 3 % and 3 mm off, which is no cause: is only what is hidden named?"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.hidden.hidden_logs import make_case

pytestmark = pytest.mark.slow
BODIES = {"payload", "link_parameters"}
SCATTER = 0.03
SIZE = float(np.log(0.8 / 0.1) / np.log(2.0 / 0.1))
"""Of a payload of 0.8 kg: `torque_effects` hides 0.1 to 2 kg, even in the logarithm."""


def diagnosed(seed: int, causes: tuple[str, ...] = (), **options: Any) -> tuple[Diagnosis, Any]:
    """Return the diagnosis of a case, and the values that are hidden."""
    case = make_case(seed, causes, known=False, scatter=SCATTER, **options)
    found = diagnose_logs(case.logs, case.robot, nominal=case.nominal)
    return found, case.hidden[0].values if case.hidden else {}


@pytest.mark.parametrize(("seed", "motion"), [(31, "fourier"), (32, "poses")])
def test_no_body_is_named_where_links_are_only_a_little_off(seed: int, motion: str) -> None:
    found, _ = diagnosed(seed, motion=motion)
    assert BODIES.isdisjoint(c.name for c in found.causes)


@pytest.mark.parametrize(("seed", "motion"), [(33, "fourier"), (34, "poses")])
def test_a_payload_is_weighed_on_links_that_are_a_little_off(seed: int, motion: str) -> None:
    found, hidden = diagnosed(seed, ("payload",), motion=motion, size=SIZE)
    payload = next(c for c in found.causes if c.name == "payload")
    weighed = payload.parameters[0]["mass_kg"]
    assert hidden["mass_kg"] == pytest.approx(0.8)
    low, high = weighed.ci95
    assert low <= hidden["mass_kg"] <= high
    assert high - low < 0.8


def test_an_offset_that_small_errors_of_links_would_make_up_for_is_named() -> None:
    """In a log of few poses they leave a twentieth of its torque to it."""
    case = make_case(900, ("torque_offset",), scatter=SCATTER)
    assert case.motion == "rests"
    found = diagnose_logs(case.logs, case.robot, nominal=case.nominal)
    (offset,) = found.causes
    (joint,) = offset.joints
    assert (offset.name, joint) == ("torque_offset", case.hidden[0].joint)
    low, high = offset.parameters[joint]["offset_nm"].ci95
    assert low <= case.hidden[0].values["offset_nm"] <= high


def test_no_bodies_are_named_where_small_errors_of_all_links_explain_as_much() -> None:
    """A log of few independent rows: three bodies and an offset are 0.8 nats likelier."""
    size = float(np.random.default_rng([4900, 77]).uniform(0.4, 1.0))
    found, hidden = diagnosed(4900, ("coulomb_friction",), motion="one_way", size=size)
    (cause,) = found.causes
    # in one direction dry friction is the same as an offset
    assert cause.name == "torque_offset"
    assert "coulomb_friction" in cause.confused_with
    low, high = cause.parameters[4]["offset_nm"].ci95
    assert low <= hidden["coulomb_nm"] <= high
