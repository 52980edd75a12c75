"""Torque tables of an arm that is not quite the nominal one: what the diagnosis has to find.

The whole arm runs the thesis's experiment, with scatter and measurement noise of its own seed,
after its true model was changed. Shares nothing with the diagnosis but the experiment itself.
"""

import dataclasses
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import (
    Configuration,
    Job,
    Protocol,
    configurations,
    load_protocol,
)
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.measured.tables import SJERow
from stiction_envs.measured.thesis_tables import thesis_base
from stiction_envs.robots import load_arm

SETTINGS = ((80.0, 1.0), (50.0, 1.0), (30.0, 1.0), (15.0, 1.0), (30.0, 1.2), (15.0, 1.2))
"""(frequency [Hz], amplitude over base torque): Table 4.6 and part of 4.7."""
RAMP_RATE = 0.14
"""Twice the protocol's, so that the tests take half the time [N·m/s]."""


@lru_cache
def protocol() -> Protocol:
    """Return what the tables are measured with."""
    return load_protocol("panda").replace(ramp_rate=RAMP_RATE)


@lru_cache
def nominal() -> FrictionParameters:
    """Return the friction of the nominal arm."""
    return load_friction("panda")


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Differences from the nominal arm; factors 1 and offsets 0 are none."""

    joint: int = 0
    """Where it differs; 0 for the whole arm."""
    lowpass_hz: float | None = None
    rotor_inertia: float = 1.0
    bristle_stiffness: float = 1.0
    offset_nm: float = 0.0
    """Constant torque."""
    gravity_nm: float = 0.0
    """Offset in the load pose, in proportion to the signed load elsewhere."""
    asymmetry_nm: float = 0.0
    """Dry friction: more in direction +, less in direction −."""
    level: float = 1.0
    """Factor on dry friction, in all measurements."""
    day: float = 1.0
    """Friction of the day of the dithered measurements over that of the base torques."""
    day_at: tuple[tuple[str, str], ...] = ()
    """Pose and direction where the day differs; none for all four."""
    corrupted: tuple[str, str, float, float] | None = None
    """Pose, direction, frequency and scale of the one bad reading: 6 % of the torque is left."""

    def at(self, joint: int) -> "Truth":
        """Return what of it concerns a joint."""
        return self if self.joint in (0, joint) else Truth()

    def friction(self, arm: FrictionParameters, joint: int, load: float) -> FrictionParameters:
        """Return the true friction, given the signed load [N·m] of the load pose."""
        j, names = joint - 1, ("rotor_inertia", "bristle_stiffness", "offset", "gravity_error")
        p = {k: np.array(getattr(arm, k)) for k in (*names, "stiction", "load_coefficient")}
        p["rotor_inertia"][j] *= self.rotor_inertia
        p["bristle_stiffness"][j] *= self.bristle_stiffness
        p["offset"][j] += self.offset_nm
        p["gravity_error"][j] += self.gravity_nm / load
        p["load_coefficient"][j] *= self.level
        p["stiction"][j] *= self.level
        p["stiction"][j] += self.asymmetry_nm * np.array([1.0, -1.0])
        return arm.replace(**p)


def amplitude(where: Configuration, scale: float) -> float:
    """Return the dither amplitude [N·m] that was commanded."""
    return round(scale * abs(float(thesis_base("panda").tau[where.index])), 4)


def tables(joints: list[int], *truths: Truth, seed: int) -> list[SJERow]:
    """Return the base and dithered torques of some joints (1..7), of one truth per joint."""
    rows = []
    for joint in joints:
        mine = next((t.at(joint) for t in truths if t.at(joint) != Truth()), Truth())
        for (where, frequency, scale), value in _read(joint, mine, seed).items():
            if mine.corrupted == (where.load, where.direction, frequency, scale):
                value *= 0.06
            size = amplitude(where, scale) if frequency else 0.0
            place = "panda", joint, where.load, where.direction
            rows.append(SJERow(*place, frequency, size, value, np.nan, 1, np.nan))
    return rows


@lru_cache
def _read(joint: int, truth: Truth, seed: int) -> dict[tuple[Configuration, float, float], float]:
    """Return the mean torque [N·m] by configuration, frequency and scale; 0, 0 is the base."""
    clean = dataclasses.replace(truth, joint=joint, corrupted=None)
    if truth != clean:
        # the same readings, whatever happened to one of them afterwards
        return _read(joint, clean, seed)
    arm = load_arm("panda")
    load = float(SingleJointExperiment(arm, friction=nominal()).poses.signed[joint - 1, 0])
    friction = truth.friction(nominal(), joint, load)
    settings = ((0.0, 0.0), *SETTINGS)
    cells = [(where, f, s) for where in configurations(7, [joint]) for f, s in settings]
    # a replica of its own, so that no two cells share their scatter
    jobs = {
        c: Job(c[0], c[1], amplitude(c[0], c[2]) if c[1] else 0.0, replica=k)
        for k, c in enumerate(cells)
    }
    out = {}
    if truth.day != 1.0:
        # all of the other day is as it was
        out = dict(_read(joint, dataclasses.replace(truth, day=1.0, day_at=()), seed))
        friction = friction.replace(
            stiction=friction.stiction * truth.day,
            load_coefficient=friction.load_coefficient * truth.day,
        )
        for c in cells:
            if c[1] and (not truth.day_at or (c[0].load, c[0].direction) in truth.day_at):
                del out[c]
    experiment = SingleJointExperiment(
        arm,
        friction=friction,
        protocol=protocol(),
        interface=dataclasses.replace(
            TorqueInterface.of(arm), lowpass_hz=truth.lowpass_hz or arm.lowpass_hz
        ),
        scatter=True,
        seed=seed,
    )
    mean = {m.job: m.mean for m in experiment.run([jobs[c] for c in cells if c not in out])}
    return {c: out.get(c, mean.get(jobs[c], np.nan)) for c in cells}
