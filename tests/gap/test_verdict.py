"""What is left is "explained" only where no listed cause would take most of it."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import TOLERANCES, cause_named
from stiction_envs.gap.selection.candidates import Candidate, RegressorLibrary
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.verdict import structured, verdict_of
from tests.gap.small_logs import data_of, dry, hidden, panda, with_torque

JOINT = 1
NAMES = (
    *("coulomb_friction", "viscous_friction", "external_spring", "torque_scale"),
    "warm_up_drift",
)
TERMS = [Candidate("coulomb_friction", j, ()) for j in range(7)]
OVER = {
    "speed": lambda d: d.dq[:, JOINT],
    "angle": lambda d: d.q[:, JOINT] - d.q[:, JOINT].mean(),
    "load": lambda d: d.rigid[:, JOINT],
    "time": lambda d: d.smooth(d.growth(JOINT, d.t - d.t[0])),
}


class Named:
    name = "coulomb_friction"
    confused_with = ()


@pytest.fixture(scope="module")
def data() -> Data:
    return data_of(panda(), hidden(panda(), dry, noise=0.02))


def judged(data: Data, terms: list[Candidate] = TERMS):
    """Return what `structured` says of the model with terms, and the verdict."""
    library = RegressorLibrary(data, [TOLERANCES, *map(cause_named, NAMES)])
    grams = library.grams
    nominal, left = (
        np.sqrt(grams.held_out(library.model_columns(x)).sum(axis=1) / grams.counts)
        for x in ([], terms)
    )
    found = structured(library, terms, left)
    noise = library.data.noise
    return found, verdict_of([Named()], nominal * noise, left * noise, noise, library, found)


def more(data: Data, over: str, size: float) -> Data:
    """Return data whose joint has a torque of ``size`` times its noise over a variable."""
    x = OVER[over](data)
    torque = np.zeros_like(data.q)
    torque[:, JOINT] = size * data.noise[JOINT] * x / np.sqrt(np.mean(x**2))
    return with_torque(data, torque)


@pytest.mark.parametrize("over", OVER)
def test_a_missing_cause_is_not_explained(data: Data, over: str) -> None:
    """Of four times the noise: 2 % of the joint's torque would pass as nothing left."""
    found, verdict = judged(more(data, over, 4.0))
    assert np.flatnonzero(found).tolist() == [JOINT]
    assert verdict == "partly explained"


def test_noise_has_no_structure(data: Data) -> None:
    found, verdict = judged(data)
    assert not found.any()
    assert verdict == "explained"
