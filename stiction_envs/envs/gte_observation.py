"""What is seen of arms that follow paths: by the environment, and by whoever plays a policy.

Everything comes from what a controller has anyway: its joints' angles and speeds, the torque that
it asks for, the pose of the tool point and the reference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.rotation import to_rpy
from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.envs.gte_layout import GROUPS
from stiction_envs.envs.layout import observation_bounds, observation_names, observed_action, pack
from stiction_envs.envs.settings import gte_settings
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import pose_error
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.plant import CONTROL_DT

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class GTEObserver:
    """Observations of a rig's arms, in the units of the nominal arm."""

    def __init__(self, experiment: GeneratedTrajectoryExperiment, low: Array, high: Array) -> None:
        """Prepare.

        Args:
            experiment: whose arms are looked at.
            low: (2n,) lowest action: amplitudes [N·m], frequencies [Hz].
            high: (2n,) highest action.
        """
        self._limits, self._low, self._high = experiment.motion, low, high
        self.names = observation_names(experiment.n, GROUPS)
        self.bounds = observation_bounds(experiment.n, GROUPS)
        level = experiment.sticking.parameters.stiction_at(experiment.start_load())
        self.stiction: Array = level.max(axis=-1)
        """(n,) unit of the observed torque: the nominal stiction at the load of the start, the
        larger of both directions [N·m]."""
        self._stiffness_unit = gte_settings().episode.unit
        usual = MotionLimits()  # those in use may be infinite
        self.tolerance = usual.position_tolerance, usual.rotation_tolerance
        """Unit of the observed error [m], [rad]."""

    def observe(
        self, rig: GTERig, ids: Index, *, action: Array, stiffness: Array, goals: Index
    ) -> NDArray[np.float32]:
        """Return the observations (M, observations) of arms ``ids``: a fresh array.

        Args:
            rig: its end effector was read.
            ids: (M,) arms.
            action: (N, 2n) last action of every arm [N·m, Hz].
            stiffness: (N, 3) translational [N/m], rotational, nullspace [N·m/rad].
            goals: (N,) goals of each arm's path.
        """
        sequencer, limits = rig.sequencer, self._limits
        t = np.multiply(rig.step, CONTROL_DT, dtype=np.float64)
        x, quaternion, velocity, turning = sequencer.reference(t)
        pose = np.concatenate(
            [rig.end_effector.position, to_rpy(rig.end_effector.quaternion)], axis=1
        )
        error = pose_error(pose, np.concatenate([x, to_rpy(quaternion)], axis=1))
        at = np.minimum(sequencer.index, goals - 1)
        since = t - sequencer.accepted_at[np.arange(rig.nsim), at]
        amplitude, frequency = observed_action(action[ids], self._low, self._high)
        share = stiffness[ids, :2] / self._stiffness_unit
        values = {
            "displacement": rig.plant.position[ids] - rig.start,
            "velocity": rig.plant.velocity[ids],
            "torque": rig.undithered_torque[ids] / self.stiction,
            "error": error[ids] / np.repeat(self.tolerance, 3),
            "reference": velocity[ids] / limits.translational_speed,
            "turning": turning[ids] / limits.rotational_speed,
            "remaining": np.nan_to_num(sequencer.segment.duration - since)[ids],
            "goal": (sequencer.goal[0] - rig.end_effector.position)[ids],
            "onward": sequencer.onward[ids],
            "goals_left": sequencer.goals_left[ids],
            "translational": share[:, 0],
            "rotational": share[:, 1],
            "amplitude": amplitude,
            "frequency": frequency,
        }
        return pack(GROUPS, values, len(ids), *self.bounds)
