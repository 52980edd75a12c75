"""The GTE environment for N slots: what the single and the vector environment share.

One episode is one run along one path. The plant steps all slots together: the episodes that `step`
is not asked about go on as well, which is only seen where they are stepped later.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import lcm
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.rotation import to_rpy
from stiction_envs.control.settings import ImpedanceSettings
from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.envs.batch_core import (
    Array,
    Index,
    Outcome,
    Slots,
    check_arguments,
    count_blocks,
)
from stiction_envs.envs.gte_base import Key, Undithered, undithered
from stiction_envs.envs.gte_layout import (
    CAPACITY,
    GROUPS,
    check_gte_options,
    default,
    drawn_stiffness,
    stiffness_units,
)
from stiction_envs.envs.gte_log import Recorder
from stiction_envs.envs.sje_layout import action_bounds
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import TRAJECTORIES, pose_error
from stiction_envs.experiments.sje.poses import find_poses
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import Arm, load_arm

TERMS = ("tracking", "power", "torque_rate", "shaking")
"""Terms of the reward, in the order in which they are summed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Step(Outcome):
    """What one step of M slots gave; arrays (M,) or (M, 6)."""

    time: Array
    """Time since the first goal was accepted [s]."""
    goals_reached: Index
    """Goals reached so far."""
    vibration: Array
    """Flange position above 8 Hz within this step, root mean square [m]."""
    error: Array
    """(M, 6) absolute error summed over the window of Table 4.11 [m, rad]; NaN while it is not
    complete."""
    undithered_error: Array
    """(M, 6) the same without dither, mean over iterations."""
    tracking_error: Array
    """Error over the episode so far, over that of a whole undithered one [-]."""
    shaking: Array
    """Vibration, root mean square over the motion so far [m]."""
    undithered_shaking: Array
    """The same without dither, whole motion, mean over iterations [m]."""
    duration: Array
    """When the last goal was reached [s]; NaN while it is not."""


class GTECore(Slots):
    """N slots of the GTE environment."""

    terms = TERMS
    each = ("time", "goals_reached", "vibration")
    final = (
        "error",
        "undithered_error",
        "tracking_error",
        "shaking",
        "undithered_shaking",
        "duration",
    )

    def __init__(
        self,
        num_envs: int,
        *,
        robot: str | Path = "panda",
        payload: Sequence[float] | None = None,
        tilt: Sequence[float] = (0.0, 0.0),
        scatter: bool = True,
        scatter_seed: int = 0,
        friction: str | Path | FrictionParameters | None = None,
        settings: ImpedanceSettings | None = None,
        motion: MotionLimits | None = None,
        belief: Arm | None = None,
        control_interval_s: float = 0.1,
        power_weight: float = 0.01,
        torque_rate_weight: float = 0.01,
        shaking_weight: float = 0.01,
        max_episode_steps: int = 400,
        fixed_options: Mapping[str, Any] | None = None,
        nthread: int = 0,
        record: bool = False,
    ) -> None:
        """Make the slots; `GTEEnv` explains the arguments. ``record`` keeps traces to draw."""
        arm = load_arm(robot, payload=payload, tilt=tilt)
        if isinstance(friction, (str, Path)):
            friction = load_friction(Path(friction), arm.n)
        check_arguments(
            max_episode_steps,
            power_weight=power_weight,
            torque_rate_weight=torque_rate_weight,
            shaking_weight=shaking_weight,
        )
        self.experiment = e = GeneratedTrajectoryExperiment.of(
            arm,
            friction=friction,
            settings=settings,
            motion=motion,
            belief=belief,
            scatter=scatter,
            seed=scatter_seed,
            nthread=nthread,
        )
        # slots start at different times: only between such blocks are all their cycles in step
        block = self.block_steps(e)
        blocks = count_blocks(control_interval_s, block * CONTROL_DT)
        low, high = action_bounds(e.sticking.parameters, find_poses(arm), e.interface)
        super().__init__(
            num_envs,
            arm,
            groups=GROUPS,
            low=low,
            high=high,
            interval=blocks * block * CONTROL_DT,
            max_episode_steps=max_episode_steps,
        )
        self.power_weight, self.torque_rate_weight = power_weight, torque_rate_weight
        self.shaking_weight = shaking_weight
        self.fixed_options = check_gte_options(fixed_options)
        self.rig = e.rig(num_envs, CAPACITY)
        self.recorder = Recorder(
            self.rig, e.protocol, steps=blocks * block, record=record, capacity=CAPACITY
        )
        self.case: list[Key] = [(TRAJECTORIES[0], drawn_stiffness()[0])] * num_envs
        self.goals = np.ones(num_envs, dtype=np.int64)
        self._trajectory = np.array([t for t, _ in self.case], dtype=object)
        self._stiffness = np.array([k for _, k in self.case])
        self._unit = np.ones((num_envs, 6))
        self._base_error, self._base_shaking = np.zeros((num_envs, 6)), np.zeros(num_envs)
        self._base_duration = np.ones(num_envs)
        usual = MotionLimits()  # those in use may be infinite
        self.tolerance = usual.position_tolerance, usual.rotation_tolerance
        """Unit of the observed error [m], [rad]."""

    @staticmethod
    def block_steps(experiment: GeneratedTrajectoryExperiment) -> int:
        """Return of how many control steps a control interval must be a multiple."""
        e = experiment
        return lcm(
            e.interface.hold_steps,
            e.protocol.model_steps,
            round(1.0 / (e.motion.publish_rate_hz * CONTROL_DT)),
            round(1.0 / (e.protocol.sample_rate * CONTROL_DT)),
        )

    # ---- reset -------------------------------------------------------------------------------

    def reset(
        self,
        ids: Index,
        rngs: Sequence[np.random.Generator],
        options: Sequence[Mapping[str, Any] | None],
    ) -> None:
        """Start an episode in slots ``ids``, each drawn from its own generator.

        A generator gives the same number of draws whatever the options say.

        Raises:
            StictionError: an option that does not exist.
        """
        checked = [{**self.fixed_options, **check_gte_options(o)} for o in options]
        drawn = [self._draw(rng, o) for rng, o in zip(rngs, checked, strict=True)]
        cases, keys = [c for c, _ in drawn], [k for _, k in drawn]
        wanted = set(cases)
        if any(not {"trajectory", "stiffness"} <= set(o) for o in checked):
            # further episodes will draw as well: one batch for all is the fastest
            wanted |= self._possible()
        base = undithered(self.experiment, sorted(wanted))
        rig = self.rig
        paths = [self.experiment.path(t) for t, _ in cases]
        rig.begin(ids, paths, np.array([k for _, k in cases]), keys)
        rig.set_dither(ids, amplitude=0.0, frequency=1.0)
        self.action[ids] = self._low
        for i, case, path in zip(ids, cases, paths, strict=True):
            self.case[i], self.goals[i] = case, len(path.position)
            self._trajectory[i], self._stiffness[i] = case
            self._set_base(int(i), base[case])
        self.steps[ids], self.alive[ids] = 0, True
        self.recorder.start(ids, self.goals[ids])

    def _draw(
        self, rng: np.random.Generator, options: Mapping[str, Any]
    ) -> tuple[Key, tuple[int, ...]]:
        trajectory = TRAJECTORIES[int(rng.integers(len(TRAJECTORIES)))]
        stiffness = drawn_stiffness()[int(rng.integers(len(drawn_stiffness())))]
        key = tuple(int(k) for k in rng.integers(2**32, size=2))
        if "iteration" in options:
            key = (options["iteration"],)
        case = options.get("trajectory", trajectory), options.get("stiffness", stiffness)
        return case, key

    def _possible(self) -> set[Key]:
        fixed = self.fixed_options
        trajectories = [fixed["trajectory"]] if "trajectory" in fixed else TRAJECTORIES
        stiffness = [fixed["stiffness"]] if "stiffness" in fixed else drawn_stiffness()
        return {(t, k) for t in trajectories for k in stiffness}

    def _set_base(self, i: int, base: Undithered) -> None:
        self._unit[i], self._base_error[i] = base.total, base.window
        self._base_duration[i], self._base_shaking[i] = base.duration, base.shaking

    # ---- step --------------------------------------------------------------------------------

    def step(self, ids: Index, action: Any) -> Step:
        """Dither slots ``ids`` with ``action`` (M, 2n) [N·m, Hz] for one control interval.

        Raises:
            StictionError: an action outside the space, or a slot whose episode is over.
        """
        self._need_alive(ids)
        action = self._check_action(action, len(ids))
        rig, recorder = self.rig, self.recorder
        self.action[ids] = action
        rig.retune(self.action[:, : self.n], self.action[:, self.n :])
        recorder.advance()
        rig.flange.read()
        self.steps[ids] += 1
        if recorder.trace is not None:
            recorder.keep(ids, self.action[:, : self.n])
        return self._outcome(ids, action)

    def _outcome(self, ids: Index, action: Array) -> Step:
        r, rig = self.recorder, self.rig
        unit = self._unit[ids]
        terminated = r.over[ids]
        truncated = ~terminated & (self.steps[ids] >= self.max_episode_steps)
        share = self.interval / self._base_duration[ids]
        power, rate = self._loads(action)
        shaking = r.step_vibration[ids] / default("reward.shaking_unit")
        terms = {
            "tracking": -np.mean(r.step_error[ids] / unit, axis=1),
            "power": -self.power_weight * share * power,
            "torque_rate": -self.torque_rate_weight * share * rate,
            "shaking": -self.shaking_weight * share * shaking,
        }
        self.alive[ids] = ~(terminated | truncated)
        return Step(
            reward=self._sum(terms),
            terms=terms,
            terminated=terminated,
            truncated=truncated,
            time=rig.step[ids].astype(float) * CONTROL_DT,
            goals_reached=rig.sequencer.index[ids],
            vibration=r.step_vibration[ids],
            error=r.window.sum[ids],
            undithered_error=self._base_error[ids],
            tracking_error=self.tracking_error(ids),
            shaking=r.shaking[ids],
            undithered_shaking=self._base_shaking[ids],
            duration=rig.sequencer.reached_at[ids, self.goals[ids] - 1],
        )

    def tracking_error(self, ids: Index) -> Array:
        """Return (M,) error over the episode so far over that of a whole undithered one [-]."""
        return np.mean(self.recorder.total_error[ids] / self._unit[ids], axis=1)

    # ---- what is seen ------------------------------------------------------------------------

    def observe(self, ids: Index) -> NDArray[np.float32]:
        """Return the observations (M, observations) of slots ``ids``: a fresh array."""
        rig, m = self.rig, len(ids)
        sequencer, limits = rig.sequencer, self.experiment.motion
        t = np.multiply(rig.step, CONTROL_DT, dtype=np.float64)
        x, quaternion, velocity, turning = sequencer.reference(t)
        pose = np.concatenate([rig.flange.position, to_rpy(rig.flange.quaternion)], axis=1)
        error = pose_error(pose, np.concatenate([x, to_rpy(quaternion)], axis=1))
        index = sequencer.index
        at = np.minimum(index, self.goals - 1)
        since = t - sequencer.accepted_at[np.arange(self.num_envs), at]
        amplitude, frequency = self._scaled(ids)
        stiffness = self._stiffness[ids, :2] / stiffness_units()
        values = {
            "displacement": rig.plant.position[ids] - rig.start,
            "velocity": rig.plant.velocity[ids],
            "error": error[ids] / np.repeat(self.tolerance, 3),
            "reference": velocity[ids] / limits.translational_speed,
            "turning": turning[ids] / limits.rotational_speed,
            "remaining": np.nan_to_num(sequencer.segment.duration - since)[ids],
            "goal": (index[ids, None] == np.arange(CAPACITY)) & (index < self.goals)[ids, None],
            "pentagon": self._trajectory[ids] == "pentagon",
            "translational": stiffness[:, 0],
            "rotational": stiffness[:, 1],
            "amplitude": amplitude,
            "frequency": frequency,
        }
        return self._pack({k: np.asarray(v, dtype=float) for k, v in values.items()}, m)

    def path_points(self, i: int) -> Array:
        """Return (goals + 1, 3) the nominal start and the goals of slot ``i`` [m]."""
        path, rig = self.experiment.path(self.case[i][0]), self.rig
        goals, _ = path.goals(rig.start_position[None], rig.start_quaternion[None])
        return np.concatenate([rig.start_position[None], goals[0]])

    def undithered_duration(self, i: int) -> float:
        """Return how long the episode of slot ``i`` lasts without dither [s]."""
        return float(self._base_duration[i])

    def describe(self, ids: Index) -> dict[str, NDArray[Any]]:
        """Return trajectory and stiffness (M, 3) of the episodes of slots ``ids``."""
        return {
            "trajectory": self._trajectory[ids],
            "stiffness": self._stiffness[ids],
        }
