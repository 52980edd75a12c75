"""N simulations of the GTE environment. One episode is one run along one path.

The plant steps all of them together: the episodes that `step` is not asked about go on as well,
which is only seen where they are stepped later.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import lcm
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.control.compensation import Compensation
from stiction_envs.control.settings import ImpedanceSettings
from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.envs.batch_core import (
    Array,
    BatchCore,
    Index,
    Outcome,
    ScatterKey,
    check_steps,
    read_friction,
    weights_of,
)
from stiction_envs.envs.gte_base import Key, Undithered, undithered
from stiction_envs.envs.gte_layout import (
    CAPACITY,
    GROUPS,
    check_gte_options,
)
from stiction_envs.envs.gte_log import Recorder
from stiction_envs.envs.gte_observation import GTEObserver
from stiction_envs.envs.settings import gte_settings
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import TRAJECTORIES
from stiction_envs.experiments.gte.random_paths import RANDOM, path_number
from stiction_envs.experiments.gte.random_paths import random_paths as find_random_paths
from stiction_envs.experiments.rig import count_blocks
from stiction_envs.experiments.sje.poses import find_poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import Arm, load_arm

TERMS = ("settling", "tracking", "power", "torque_rate", "shaking")
"""Terms of the reward, in the order in which they are summed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Step(Outcome):
    """What one step of M simulations gave; arrays (M,) or (M, 6)."""

    time: Array
    """Time since the first goal was accepted [s]."""
    goals_reached: Index
    """Goals reached so far."""
    vibration: Array
    """Vibration above 8 Hz within this step, turns included, root mean square [m]."""
    error: Array
    """(M, 6) absolute error summed over the window of Table 4.11 [m, rad]; NaN while it is not
    complete."""
    undithered_error: Array
    """(M, 6) the same without dither, mean over iterations."""
    error_left: Array
    """(M, 2) error left when the arm's time at a goal was over, mean over goals: position [m] and
    orientation [rad]; NaN while one of them is not."""
    undithered_error_left: Array
    """(M, 2) the same without dither, mean over iterations."""
    resting_error: Array
    """(M, 2) error left at the last goal, where the arm rests [m, rad]; NaN while it does not."""
    undithered_resting_error: Array
    """(M, 2) the same without dither, mean over iterations."""
    settling_error: Array
    """Error left at the goals so far over that of undithered runs, mean over goals [-]."""
    tracking_error: Array
    """Error over the episode so far, over that of a whole undithered one [-]."""
    shaking: Array
    """Vibration, root mean square over the motion so far [m]."""
    shaking_at_rest: Array
    """The same after the last goal was reached [m]; NaN before."""
    undithered_shaking: Array
    """The same without dither, whole motion, mean over iterations [m]."""
    duration: Array
    """When the last goal was reached [s]; NaN while it is not."""


class GTECore(BatchCore):
    """N simulations of the GTE environment."""

    terms = TERMS
    each = ("time", "goals_reached", "vibration")
    final = (
        "error",
        "undithered_error",
        "error_left",
        "undithered_error_left",
        "resting_error",
        "undithered_resting_error",
        "settling_error",
        "tracking_error",
        "shaking",
        "shaking_at_rest",
        "undithered_shaking",
        "duration",
    )
    # each keeps its own engine data, and all are visited in every control step
    arms_per_thread = 32

    def __init__(
        self,
        num_envs: int,
        *,
        robot: str | Path = "panda",
        payload: Sequence[float] | None = None,
        tilt: Sequence[float] = (0.0, 0.0),
        chain: Sequence[str] | None = None,
        scatter: bool = True,
        scatter_seed: int = 0,
        friction: str | Path | FrictionParameters | None = None,
        settings: ImpedanceSettings | None = None,
        motion: MotionLimits | None = None,
        start: ArrayLike | None = None,
        tool: ArrayLike | None = None,
        compensation: str | Compensation | None = None,
        controller_model: Arm | None = None,
        random_paths: int | None = None,
        control_interval_s: float = 0.1,
        settling_weight: float | None = None,
        power_weight: float | None = None,
        torque_rate_weight: float | None = None,
        shaking_weight: float | None = None,
        max_episode_steps: int = 400,
        fixed_options: Mapping[str, Any] | None = None,
        randomise: Mapping[str, float] | None = None,
        friction_factor: float = 1.0,
        nthread: int = 0,
        record: bool = False,
    ) -> None:
        """Make them; `GTEEnv` explains the arguments. ``record`` keeps traces to draw."""
        arm = load_arm(robot, payload=payload, tilt=tilt, chain=chain)
        own = gte_settings()
        self.random_paths = own.random.paths if random_paths is None else random_paths
        if not isinstance(self.random_paths, (int, np.integer)) or self.random_paths < 1:
            raise StictionError(f"random_paths {random_paths!r}: expected a whole number from 1")
        if settling_weight is not None and not 0 <= settling_weight <= 1:
            raise StictionError(f"settling_weight {settling_weight}: expected 0 to 1")
        check_steps(max_episode_steps)
        weights = weights_of(
            own.reward,
            settling_weight=settling_weight,
            power_weight=power_weight,
            torque_rate_weight=torque_rate_weight,
            shaking_weight=shaking_weight,
        )
        self.experiment = e = GeneratedTrajectoryExperiment(
            arm,
            friction=read_friction(friction, arm.n),
            settings=settings,
            motion=motion,
            start=start,
            tool=tool,
            controller_model=controller_model,
            scatter=scatter,
            seed=scatter_seed,
            nthread=nthread,
        )
        # episodes start at different times: only between such blocks are all their cycles in step
        block = self.block_steps(e)
        blocks = count_blocks("control_interval_s", control_interval_s, block * CONTROL_DT)
        super().__init__(
            num_envs,
            e,
            poses=find_poses(arm),
            groups=GROUPS,
            interval=blocks * block * CONTROL_DT,
            max_episode_steps=max_episode_steps,
            power_weight=weights["power_weight"],
            torque_rate_weight=weights["torque_rate_weight"],
            fixed_options=fixed_options,
            randomise=randomise,
            friction_factor=friction_factor,
        )
        self._random: dict[int, Key] = {}
        self._units: dict[Key, Undithered] = {}
        self.settling_weight = weights["settling_weight"]
        self.shaking_weight, self._shaking_unit = weights["shaking_weight"], own.reward.shaking_unit
        self.compensation = (
            e.compensation(compensation) if isinstance(compensation, str) else compensation
        )
        self.rig = e.rig(num_envs, CAPACITY)
        self.rig.compensator.set_rows(np.arange(num_envs), [self.compensation] * num_envs)
        self.recorder = Recorder(
            self.rig, e.protocol, steps=blocks * block, record=record, capacity=CAPACITY
        )
        self.case: list[Key] = [(TRAJECTORIES[0], own.episode.stiffness[0])] * num_envs
        self.goals = np.ones(num_envs, dtype=np.int64)
        self._trajectory = np.array([t for t, _ in self.case], dtype=object)
        self._number = np.full(num_envs, -1)
        self._stiffness = np.array([k for _, k in self.case])
        self._unit = np.ones((num_envs, 6))
        self._base_error, self._base_shaking = np.zeros((num_envs, 6)), np.zeros(num_envs)
        self._unit_left = np.ones((num_envs, CAPACITY, 2))
        self._base_left, self._base_resting = np.zeros((2, num_envs, 2))
        self._left = np.zeros(num_envs)
        self._base_duration = np.ones(num_envs)
        self._observer = GTEObserver(e, self._low, self._high)
        self.stiction, self.speed_unit = self._observer.stiction, 1.0
        self.tolerance = self._observer.tolerance
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

    # ---- episodes ----------------------------------------------------------------------------

    def _check_options(self, options: Mapping[str, Any] | None) -> dict[str, Any]:
        return check_gte_options(options)

    def check_reset(self, options: Sequence[Mapping[str, Any] | None]) -> list[dict[str, Any]]:
        """As `BatchCore.check_reset`; a trajectory takes the place of a fixed number, too."""
        checked = super().check_reset(options)
        for o, own in zip(checked, options, strict=True):
            if own and "trajectory" in own and "path" not in own:
                o.pop("path", None)
        return checked

    def _draw(self, rng: np.random.Generator, options: Mapping[str, Any]) -> tuple[Key, ScatterKey]:
        trajectory = TRAJECTORIES[int(rng.integers(len(TRAJECTORIES)))]
        listed = gte_settings().episode.stiffness
        stiffness = listed[int(rng.integers(len(listed)))]
        key = tuple(int(k) for k in rng.integers(2**32, size=2))
        number = int(rng.integers(self.random_paths))
        if "iteration" in options:
            key = (options["iteration"],)
        trajectory = options.get("trajectory", trajectory)
        if "path" in options or trajectory == RANDOM:
            [(trajectory, stiffness)] = self._random_cases([options.get("path", number)])
        return (trajectory, options.get("stiffness", stiffness)), key

    def _random_cases(self, numbers: Sequence[int]) -> list[Key]:
        """Return names and stiffnesses of random paths."""
        e, new = self.experiment, [k for k in numbers if k not in self._random]
        if new:
            found = find_random_paths(e.sticking, e.start, e.tool, new)
            self._random |= {k: (p.path.name, p.stiffness) for k, p in found.items()}
        return [self._random[k] for k in numbers]

    def _cases(self, options: Mapping[str, Any]) -> set[Key]:
        if "path" in options or options.get("trajectory") == RANDOM:
            drawn = [options["path"]] if "path" in options else range(self.random_paths)
            return {(t, options.get("stiffness", k)) for t, k in self._random_cases(drawn)}
        trajectories = [options["trajectory"]] if "trajectory" in options else TRAJECTORIES
        listed = gte_settings().episode.stiffness
        stiffness = [options["stiffness"]] if "stiffness" in options else listed
        return {(t, k) for t in trajectories for k in stiffness}

    def _undithered(self, cases: Sequence[Key]) -> Mapping[Key, Undithered]:
        # looked up once: with many arms, some episode is always over
        new = [case for case in cases if case not in self._units]
        if new:
            self._units |= undithered(self.experiment, new, self.compensation)
        return self._units

    def _begin(
        self,
        ids: Index,
        cases: Sequence[Key],
        keys: Sequence[ScatterKey],
        base: Sequence[Undithered],
    ) -> None:
        rig = self.rig
        paths = [self.experiment.path(t) for t, _ in cases]
        rig.begin(ids, paths, np.array([k for _, k in cases]), keys)
        rig.set_dither(ids, amplitude=0.0, frequency=1.0)
        for i, case, path, b in zip(ids, cases, paths, base, strict=True):
            self.case[i], self.goals[i] = case, len(path.position)
            self._trajectory[i], self._stiffness[i] = case
            if (number := path_number(case[0])) is not None:
                self._trajectory[i], self._number[i] = RANDOM, number
            else:
                self._number[i] = -1
            self._unit[i], self._base_error[i] = b.total, b.window
            self._unit_left[i, : len(b.left)], self._left[i] = b.left, 0.0
            self._base_left[i], self._base_resting[i] = b.left.mean(axis=0), b.left[-1]
            self._base_duration[i], self._base_shaking[i] = b.duration, b.shaking
        self.recorder.start(ids, self.goals[ids])

    def _advance(self, ids: Index) -> None:
        self.recorder.advance()
        self.rig.end_effector.read()
        if self.recorder.trace is not None:
            self.recorder.keep(ids, self.action[:, : self.n])

    def _outcome(self, ids: Index) -> Step:
        r, rig = self.recorder, self.rig
        terminated = r.over[ids]
        truncated = ~terminated & (self.steps[ids] >= self.max_episode_steps)
        share = self.interval / self._base_duration[ids]
        shaking = r.step_vibration[ids] / self._shaking_unit
        left = (r.step_left[ids] / self._unit_left[ids]).sum(axis=(1, 2)) / (2 * self.goals[ids])
        self._left[ids] += left
        tracking = np.mean(r.step_error[ids] / self._unit[ids], axis=1)
        terms = {
            "settling": -self.settling_weight * left,
            "tracking": -(1.0 - self.settling_weight) * tracking,
            **self._penalties(ids, share),
            "shaking": -self.shaking_weight * share * shaking,
        }
        self.alive[ids] = ~(terminated | truncated)
        return Step(
            reward=self._sum(terms),
            terms=terms,
            terminated=terminated,
            truncated=truncated,
            time=self._time(ids),
            goals_reached=rig.sequencer.index[ids],
            vibration=r.step_vibration[ids],
            error=r.window.sum[ids],
            undithered_error=self._base_error[ids],
            error_left=r.mean_left(ids),
            undithered_error_left=self._base_left[ids],
            resting_error=r.left[ids, self.goals[ids] - 1],
            undithered_resting_error=self._base_resting[ids],
            settling_error=self._left[ids],
            tracking_error=self.tracking_error(ids),
            shaking=r.shaking[ids],
            shaking_at_rest=np.sqrt((r.vibration_at_rest[ids] ** 2).sum(axis=1)),
            undithered_shaking=self._base_shaking[ids],
            duration=rig.sequencer.reached_at[ids, self.goals[ids] - 1],
        )

    def tracking_error(self, ids: Index) -> Array:
        """Return (M,) error over the episode so far over that of a whole undithered one [-]."""
        return np.mean(self.recorder.total_error[ids] / self._unit[ids], axis=1)

    # ---- what is seen ------------------------------------------------------------------------

    def observe(self, ids: Index) -> NDArray[np.float32]:
        """Return the observations (M, observations) of simulations ``ids``: a fresh array."""
        return self._observer.observe(
            self.rig, ids, action=self.action, stiffness=self._stiffness, goals=self.goals
        )

    def path_points(self, i: int) -> Array:
        """Return (goals + 1, 3) the nominal start and the goals of simulation ``i`` [m]."""
        path, rig = self.experiment.path(self.case[i][0]), self.rig
        goals, _ = path.goals(rig.start_position[None], rig.start_quaternion[None])
        return np.concatenate([rig.start_position[None], goals[0]])

    def undithered_duration(self, i: int) -> float:
        """Return how long the episode of simulation ``i`` lasts without dither [s]."""
        return float(self._base_duration[i])

    def describe(self, ids: Index) -> dict[str, NDArray[Any]]:
        """Return trajectory, number and stiffness (M, 3) of the episodes of ``ids``."""
        return {
            "trajectory": self._trajectory[ids],
            "path": self._number[ids],
            "stiffness": self._stiffness[ids],
        }
