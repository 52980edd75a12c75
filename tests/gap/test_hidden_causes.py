"""Every cause that a motion can show is named, with its value, on an arm that is a little off.

`hidden` simulates the logs and shares no code with the diagnosis. All links are 3 % and 3 mm off,
torques have noise, steps of 0.01 N·m and 1 ms of lag, angles have noise and steps of 5 µrad.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.gap.judge.judgement import NamedCause
from stiction_envs.hidden.hidden_logs import Hidden, make_case
from stiction_envs.hidden.torque_effects import EFFECTS

LAG = 1e-3
"""Delay of logged torques [s]; it is really there, so it may be named."""
DELAY = "actuator_delay"
SURE = 2.58 / 1.96
"""Half width of a 99 % interval over that of a 95 % one: of 22 of the latter one misses."""
ANGLES = ("phase_rad", "azimuth_rad")
VISIBLE = [x for x in EFFECTS if x != "backlash"]
"""No motion shows a gap beside the elasticity that comes with it."""
WELL_SHOWN: dict[str, dict[str, Any]] = {
    # a wrist's zero, or a fifth of a link's mass, is not told from links that are a little off
    "encoder_offset": {"joint": 4},
    "link_parameters": {"joint": 4, "size": 1.0},
    # over a small range of angles a spring is a smooth torque
    "external_spring": {"motion": "fourier"},
}
SLOW = (
    *("actuator_delay", "joint_elasticity", "link_inertia", "presliding_hysteresis"),
    "viscous_friction",
)


def diagnosed(*names: str, seed: int = 40, **options: Any) -> tuple[Diagnosis, tuple[Hidden, ...]]:
    """Hide effects in a log of 20 s; return its diagnosis and the truth."""
    given = {"size": 0.7, **options}
    case = make_case(seed, names, scatter=0.03, seconds=20.0, **given)
    (log,) = case.logs
    late = np.stack([np.interp(log.t - LAG, log.t, tau) for tau in log.tau.T], axis=1)
    found = diagnose_logs([replace(log, tau=late)], case.robot, nominal=case.nominal)
    return found, tuple(map(_with_lag, case.hidden))


def _with_lag(hidden: Hidden) -> Hidden:
    """A delay as it shows in torques that lag."""
    if hidden.name != DELAY:
        return hidden
    return replace(hidden, values={"delay_s": float(np.ravel(hidden.values["delay_s"])[0]) - LAG})


def outside(cause: NamedCause, hidden: Hidden) -> list[str]:
    """Return which true values are not in their 99 % intervals."""
    out, values = [], dict(hidden.values)
    joint = int(np.ravel(values.pop("link", hidden.joint))[0])
    for key, true in values.items():
        low, high = np.array(cause.parameters[joint][key].ci95).reshape(-1, 2).T
        middle, truth = (low + high) / 2, np.ravel(true)
        if key in ANGLES:
            truth = middle + (truth - middle + np.pi) % (2 * np.pi) - np.pi
        if not np.all(np.abs(truth - middle) <= SURE * (high - low) / 2):
            out.append(f"{key}: {truth} not in {low} to {high}")
    return out


@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=pytest.mark.slow) if x in SLOW else x for x in VISIBLE]
)
def test_a_hidden_cause_is_named_with_its_value_and_nothing_else(name: str) -> None:
    found, (hidden,) = diagnosed(name, **WELL_SHOWN.get(name, {}))
    cause = next((c for c in found.causes if c.name == hidden.name), None)
    assert cause is not None
    assert {c.name for c in found.causes} <= {hidden.name, *EFFECTS[name].expected, DELAY}
    if hidden.joint:
        assert cause.joints == (hidden.joint,)
    assert not outside(cause, hidden)


@pytest.mark.parametrize(("seed", "motion"), [(31, "fourier"), (32, "poses"), (12, "sweeps")])
def test_nothing_is_named_where_links_are_only_a_little_off(seed: int, motion: str) -> None:
    found, _ = diagnosed(seed=seed, motion=motion)
    assert {c.name for c in found.causes} <= {DELAY}


def test_friction_of_a_joint_that_turns_one_way_may_be_an_offset() -> None:
    """Whichever is named has the value, and the other as its nearest rival."""
    found, (hidden,) = diagnosed("coulomb_friction", motion="one_way", known=False, joint=4)
    (cause,) = found.causes
    names = {"coulomb_friction": "coulomb_nm", "torque_offset": "offset_nm"}
    assert {cause.name, cause.rivals[0][0]} == set(names)
    (estimate,) = (cause.parameters[4][key] for name, key in names.items() if name == cause.name)
    low, high = np.abs(estimate.ci95)
    assert min(low, high) <= abs(float(hidden.values["coulomb_nm"])) <= max(low, high)  # type: ignore[arg-type]
