"""Observations of arms that follow paths, and the options of a reset.

A controller has all of it: the joints' angles and speeds, the commanded torque, the pose of the
tool point and the reference.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Array, Index
from stiction_envs.control.rotation import to_rpy
from stiction_envs.control.trajectory import POSITION, MotionLimits
from stiction_envs.errors import StictionError, unknown
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import (
    AXES,
    PATHS,
    TRAJECTORIES,
    Case,
    episode_settings,
    pose_error,
)
from stiction_envs.experiments.gte.random_paths import RANDOM, random_path_settings
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.experiments.observation import (
    DITHER,
    TORQUE,
    Checked,
    Group,
    named_options,
    observation_bounds,
    observed_action,
    pack,
)
from stiction_envs.plant import CONTROL_DT

OPTIONS = ("trajectory", "path", "stiffness", "iteration")
"""Names of the reset options."""
CAPACITY = max(random_path_settings().most_goals, *(len(p().position) for p in PATHS.values()))
"""Most goals of a path."""
_UNIT = episode_settings().unit
GROUPS = (
    Group("displacement", -3.0, 3.0, "rad", "link angle minus the start's", per_joint=True),
    Group("velocity", -3.0, 3.0, "rad/s", "link speed", per_joint=True),
    TORQUE,
    Group("error", -20.0, 20.0, "tolerance", "pose minus reference", labels=AXES),
    Group("reference", -1.0, 1.0, "v_max", "velocity of the reference", labels=POSITION),
    Group("turning", 0.0, 1.0, "ω_max", "angular speed of the reference"),
    Group("remaining", -20.0, 20.0, "s", "time until the reference comes to rest, < 0 since"),
    Group("goal", -2.0, 2.0, "m", "goal on the way to, minus the tool point", labels=POSITION),
    Group(
        *("onward", -2.0, 2.0, "m", "goal behind it, minus that goal; 0 at the last"),
        labels=POSITION,
    ),
    Group("goals_left", 0.0, float(CAPACITY), "1", "goals not reached yet"),
    Group("translational", 0.0, 20.0, f"{_UNIT[0]:g} N/m", "translational stiffness"),
    Group("rotational", 0.0, 20.0, f"{_UNIT[1]:g} N·m/rad", "rotational stiffness"),
    *DITHER,
)
"""The observation, in order; bounds are assumed: wider than what occurs."""


class GTEObserver:
    """Observations of a rig's arms, in the units of the nominal arm."""

    def __init__(self, experiment: GeneratedTrajectoryExperiment, low: Array, high: Array) -> None:
        """Prepare.

        Args:
            experiment: whose arms are observed.
            low: (2n,) lowest action: amplitudes [N·m], frequencies [Hz].
            high: (2n,) highest action.
        """
        self._limits, self._low, self._high = experiment.motion, low, high
        self._bounds = observation_bounds(experiment.n, GROUPS)
        level = experiment.sticking.parameters.stiction_at(experiment.start_load())
        self.stiction: Array = level.max(axis=-1)
        """(n,) unit of the observed torque: the nominal stiction at the load of the start, the
        larger of both directions [N·m]."""
        self._stiffness_unit = _UNIT
        usual = MotionLimits()  # those in use may be infinite
        self.tolerance = usual.position_tolerance, usual.rotation_tolerance
        """Unit of the observed error [m], [rad]."""

    def observe(
        self, rig: GTERig, ids: Index, *, action: Array, stiffness: Array, goals: Index
    ) -> NDArray[np.float32]:
        """Return the observations (M, observations) of arms ``ids``: a fresh array.

        Args:
            rig: its end effector was read, as the controllers have it.
            ids: (M,) arms.
            action: (N, 2n) last action of every arm [N·m, Hz].
            stiffness: (N, 3) translational [N/m], rotational, nullspace [N·m/rad].
            goals: (N,) goals of each arm's path.
        """
        sequencer, limits = rig.sequencer, self._limits
        t = np.multiply(rig.step, CONTROL_DT, dtype=np.float64)
        x, quaternion, velocity, turning = sequencer.reference(t)
        hand = rig.seen_end_effector
        pose = np.concatenate([hand.position, to_rpy(hand.quaternion)], axis=1)
        error = pose_error(pose, np.concatenate([x, to_rpy(quaternion)], axis=1))
        at = np.minimum(sequencer.index, goals - 1)
        since = t - sequencer.accepted_at[np.arange(rig.nsim), at]
        amplitude, frequency = observed_action(action[ids], self._low, self._high)
        share = stiffness[ids, :2] / self._stiffness_unit
        values = {
            "displacement": rig.seen_position[ids] - rig.start,
            "velocity": rig.seen_velocity[ids],
            "torque": rig.undithered_torque[ids] / self.stiction,
            "error": error[ids] / np.repeat(self.tolerance, 3),
            "reference": velocity[ids] / limits.translational_speed,
            "turning": turning[ids] / limits.rotational_speed,
            "remaining": np.nan_to_num(sequencer.movement.duration - since)[ids],
            "goal": (sequencer.goal[0] - hand.position)[ids],
            "onward": sequencer.onward[ids],
            "goals_left": sequencer.goals_left[ids],
            "translational": share[:, 0],
            "rotational": share[:, 1],
            "amplitude": amplitude,
            "frequency": frequency,
        }
        return pack(GROUPS, values, len(ids), *self._bounds)


def check_gte_options(options: Mapping[str, object] | None) -> Checked:
    """Return valid reset options: trajectory, path, stiffness, iteration.

    Raises:
        StictionError: an option or a value that does not exist.
    """
    out = named_options(options, OPTIONS)
    if "trajectory" in out and (
        not isinstance(out["trajectory"], str) or out["trajectory"] not in (*TRAJECTORIES, RANDOM)
    ):
        raise unknown("trajectory", out["trajectory"], [*TRAJECTORIES, RANDOM])
    for name in ("path", "iteration"):
        if name in out:
            out[name] = _number(name, out[name])
    if "path" in out and out.setdefault("trajectory", RANDOM) != RANDOM:
        raise StictionError(
            f"path {out['path']} of trajectory {out['trajectory']!r}: expected {RANDOM!r}"
        )
    if "stiffness" in out:
        value = out["stiffness"]
        try:
            numbers = [float(k) for k in value]
        except (TypeError, ValueError):
            raise StictionError(f"stiffness {value!r}: expected three numbers") from None
        out["stiffness"] = tuple(numbers)
        Case(trajectory=TRAJECTORIES[0], stiffness=out["stiffness"])
    return out


def _number(name: str, value: object) -> int:
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 0:
        raise StictionError(f"{name} {value!r}: expected a whole number from 0")
    return int(value)
