"""Episodes of the Generated Trajectory Experiment: one is one run along one path.

The plant steps all together that are not over: those that `step` is not asked about go on as well,
which is only seen where they are stepped later.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import lcm
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.control.compensation import Compensation
from stiction_envs.control.impedance import ImpedanceSettings, Ratio
from stiction_envs.control.rotation import to_rpy
from stiction_envs.control.trajectory import POSITION, MotionLimits
from stiction_envs.errors import StictionError, unknown
from stiction_envs.experiments.episodes import (
    Arguments,
    Array,
    Episodes,
    Index,
    Options,
    Outcome,
    ScatterKey,
)
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import (
    AXES,
    PATHS,
    TRAJECTORIES,
    Stiffness,
    episode_settings,
    gte_reward_settings,
    pose_error,
)
from stiction_envs.experiments.gte.random_paths import (
    RANDOM,
    path_number,
    random_path_settings,
    random_paths,
)
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.experiments.gte.sampling import Recorder
from stiction_envs.experiments.gte.undithered import Key, Undithered, undithered
from stiction_envs.experiments.observation import DITHER, TORQUE, Checked, Elements, named_options
from stiction_envs.friction.sticking import Friction
from stiction_envs.method_settings import Count, checked
from stiction_envs.method_settings import Index as WholeNumber
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import Arm

OPTIONS = ("trajectory", "path", "stiffness", "iteration")  # Names of the reset options
CAPACITY = max(random_path_settings().most_goals, *(len(p().position) for p in PATHS.values()))
"""Most goals of a path."""
# the largest stiffness [N/m, N·m/rad] is observed as 1
_UNIT = np.max(episode_settings().stiffness, axis=0)[:2]
GROUPS = (
    Elements("displacement", -3.0, 3.0, "rad", "link angle minus the start's", per_joint=True),
    Elements("velocity", -3.0, 3.0, "rad/s", "link speed", per_joint=True),
    TORQUE,
    Elements("error", -20.0, 20.0, "tolerance", "pose minus reference", labels=AXES),
    Elements("reference", -1.0, 1.0, "v_max", "velocity of the reference", labels=POSITION),
    Elements("turning", 0.0, 1.0, "ω_max", "angular speed of the reference"),
    Elements("remaining", -20.0, 20.0, "s", "time until the reference comes to rest, < 0 since"),
    Elements("goal", -2.0, 2.0, "m", "goal on the way to, minus the tool point", labels=POSITION),
    Elements(
        *("onward", -2.0, 2.0, "m", "goal behind it, minus that goal; 0 at the last"),
        labels=POSITION,
    ),
    Elements("goals_left", 0.0, float(CAPACITY), "1", "goals not reached yet"),
    Elements("translational", 0.0, 20.0, f"{_UNIT[0]:g} N/m", "translational stiffness"),
    Elements("rotational", 0.0, 20.0, f"{_UNIT[1]:g} N·m/rad", "rotational stiffness"),
    *DITHER,
)
"""The observation, in order; bounds are assumed: wider than what occurs."""


@dataclass(frozen=True, kw_only=True)
class GTEArguments(Arguments):
    """Arguments of the environment; `envs.gte.GTEEnv` explains them."""

    scatter_seed: int = 0
    settings: ImpedanceSettings | None = None
    motion: MotionLimits | None = None
    start: ArrayLike | None = None
    tool: ArrayLike | None = None
    compensation: str | Path | Compensation | None = None
    controller_model: Arm | None = None
    random_paths: int | None = None
    settling_weight: float | None = None
    max_episode_steps: int = 400


class GTEEpisodes(Episodes[Key, Undithered]):
    """N episodes of the Generated Trajectory Experiment."""

    experiment: GeneratedTrajectoryExperiment
    rig: GTERig
    arguments = GTEArguments
    terms = ("settling", "tracking", "power", "torque_rate", "shaking")
    groups = GROUPS

    reward_settings = staticmethod(gte_reward_settings)

    def _check_options(self, options: Options | None) -> Checked:
        out = named_options(options, OPTIONS)
        if "trajectory" in out:
            trajectory, expected = out["trajectory"], [*TRAJECTORIES, RANDOM]
            if not isinstance(trajectory, str) or trajectory not in expected:
                raise unknown("trajectory", trajectory, expected)
        for name in ("path", "iteration"):
            if name in out:
                out[name] = checked(out[name], WholeNumber, name)
        if "path" in out and out.setdefault("trajectory", RANDOM) != RANDOM:
            raise StictionError(
                f"path {out['path']} of trajectory {out['trajectory']!r}: expected {RANDOM!r}"
            )
        if "stiffness" in out:
            out["stiffness"] = checked(out["stiffness"], Stiffness, "stiffness")
        return out

    def _experiment(
        self, a: GTEArguments, arm: Arm, friction: Friction | None
    ) -> GeneratedTrajectoryExperiment:
        given = a.random_paths
        usual = episode_settings().random_paths
        self.random_paths = checked(usual if given is None else given, Count, "random_paths")
        checked(self.weights["settling_weight"], Ratio, "settling_weight")
        return GeneratedTrajectoryExperiment(
            arm,
            friction=friction,
            settings=a.settings,
            motion=a.motion,
            start=a.start,
            tool=a.tool,
            controller_model=a.controller_model,
            scatter=a.scatter,
            seed=a.scatter_seed,
            threads=a.threads,
        )

    @staticmethod
    def block_steps(experiment: GeneratedTrajectoryExperiment) -> int:
        """Return of how many control steps a control interval must be a multiple.

        Episodes start at different times: only between such blocks are all their cycles in step.
        """
        e = experiment
        return lcm(
            e.interface.hold_steps,
            e.protocol.model_steps,
            round(1.0 / (e.motion.publish_rate_hz * CONTROL_DT)),
            round(1.0 / (e.protocol.sample_rate * CONTROL_DT)),
        )

    def _make(self, a: GTEArguments) -> None:
        e, count, given = self.experiment, self.num_envs, a.compensation
        self.compensation = e.compensation(given) if isinstance(given, str | Path) else given
        self._random: dict[int, Key] = {}
        self._units: dict[Key, Undithered] = {}
        self._shaking_unit = self.reward_settings().shaking_unit
        self.rig = e.replace(threads=self._engine_threads).rig(count, CAPACITY)
        self.rig.compensator.set_rows(np.arange(count), [self.compensation] * count)
        self.recorder = Recorder(self.rig, e.protocol, steps=self.interval_steps, capacity=CAPACITY)
        self.case: list[Key] = [(TRAJECTORIES[0], episode_settings().stiffness[0])] * count
        self.goals = np.ones(count, dtype=np.int64)
        self._stiffness = np.array([k for _, k in self.case])
        self._base: dict[int, Undithered] = {}
        self._unit = np.ones((count, 6))
        self._unit_left = np.ones((count, CAPACITY, 2))
        self._left = np.zeros(count)
        self._base_duration = np.ones(count)
        # the larger of both directions at the load of the start
        self.stiction = e.sticking.parameters.stiction_at(e.start_load()).max(axis=-1)
        usual = MotionLimits()  # those in use may be infinite
        self._tolerance = np.repeat([usual.position_tolerance, usual.rotation_tolerance], 3)

    def check_reset(self, options: Sequence[Options | None]) -> list[Checked]:
        """Check options as `Episodes.check_reset`; a trajectory also replaces a fixed path."""
        checked = super().check_reset(options)
        for o, own in zip(checked, options, strict=True):
            if own and "trajectory" in own and "path" not in own:
                o.pop("path", None)
        return checked

    def _draw(self, rng: np.random.Generator, options: Checked) -> tuple[Key, ScatterKey]:
        trajectory = TRAJECTORIES[int(rng.integers(len(TRAJECTORIES)))]
        listed = episode_settings().stiffness
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
            found = random_paths(e.sticking, e.start, e.tool, new)
            self._random |= {k: (p.path.name, p.stiffness) for k, p in found.items()}
        return [self._random[k] for k in numbers]

    def _cases(self, options: Checked) -> set[Key]:
        if "path" in options or options.get("trajectory") == RANDOM:
            drawn = [options["path"]] if "path" in options else range(self.random_paths)
            return {(t, options.get("stiffness", k)) for t, k in self._random_cases(drawn)}
        trajectories = [options["trajectory"]] if "trajectory" in options else TRAJECTORIES
        listed = episode_settings().stiffness
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
        rig.set_dither(ids, amplitude=0.0, frequency=1.0, waveform=self.waveform)
        for i, case, path, b in zip(ids, cases, paths, base, strict=True):
            self.case[i], self.goals[i] = case, len(path.position)
            self._stiffness[i], self._base[int(i)] = case[1], b
            self._unit[i], self._base_duration[i] = b.total, b.duration
            self._unit_left[i, : len(b.left)], self._left[i] = b.left, 0.0
        self.recorder.start(ids, self.goals[ids])

    def _advance(self, ids: Index) -> None:
        self.rig.plant.loop_batch.step_only(self.alive)
        self.recorder.advance()
        self.rig.end_effector.read()
        if self.rig.senses is not None:
            self.rig.seen_end_effector.read()

    def _outcome(self, ids: Index) -> Outcome:
        r = self.recorder
        terminated = r.over[ids]
        truncated = ~terminated & (self.steps[ids] >= self.max_episode_steps)
        share = self.interval / self._base_duration[ids]
        shaking = r.step_vibration[ids] / self._shaking_unit
        left = (r.step_left[ids] / self._unit_left[ids]).sum(axis=(1, 2)) / (2 * self.goals[ids])
        self._left[ids] += left
        tracking = (r.step_error[ids] / self._unit[ids]).mean(axis=1)
        settling_weight = self.weights["settling_weight"]
        terms = {
            "settling": -settling_weight * left,
            "tracking": -(1.0 - settling_weight) * tracking,
            **self._penalties(ids, share),
            "shaking": -self.weights["shaking_weight"] * share * shaking,
        }
        return Outcome(
            terms=terms,
            terminated=terminated,
            truncated=truncated,
            measures={
                "time": self._time(ids),
                "goals_reached": self.rig.sequencer.arrays.current[ids],
                "vibration": r.step_vibration[ids],
            },
        )

    def last_measures(self, ids: Index) -> dict[str, NDArray[np.generic]]:
        """Return errors, vibration and duration of episodes that are over."""
        r, last = self.recorder, self.goals[ids] - 1
        left, mine = r.left[ids], np.arange(CAPACITY) <= last[:, None]
        base = [self._base[int(i)] for i in ids]
        return {
            "error": r.window_sum[ids],
            "undithered_error": np.array([b.window for b in base]),
            "error_left": np.where(mine[..., None], left, 0.0).sum(axis=1) / (last + 1)[:, None],
            "undithered_error_left": np.array([b.left.mean(axis=0) for b in base]),
            "resting_error": left[np.arange(len(ids)), last],
            "undithered_resting_error": np.array([b.left[-1] for b in base]),
            "settling_error": self._left[ids],
            "tracking_error": (r.total_error[ids] / self._unit[ids]).mean(axis=1),
            "shaking": r.shaking[ids],
            "shaking_at_rest": r.shaking_at_rest[ids],
            "undithered_shaking": np.array([b.shaking for b in base]),
            "duration": self.rig.sequencer.arrays.reached[ids, last],
        }

    @staticmethod
    def columns(measures: Mapping[str, Array]) -> dict[str, float]:
        """Return the columns that an episode's last measures fill in a table of evaluations."""
        out: dict[str, float] = {}
        for name in ("", "undithered_"):
            for what, field in (("left", "error_left"), ("resting", "resting_error")):
                position, orientation = measures[f"{name}{field}"]
                out[f"{name}position_{what}_m"] = float(position)
                out[f"{name}orientation_{what}_rad"] = float(orientation)
        return out | {
            "settling_error": float(measures["settling_error"]),
            "tracking_error": float(measures["tracking_error"]),
            "vibration_moving_mm": 1e3 * float(measures["shaking"]),
            "vibration_at_rest_mm": 1e3 * float(measures["shaking_at_rest"]),
            "undithered_vibration_mm": 1e3 * float(measures["undithered_shaking"]),
            "duration_s": float(measures["duration"]),
        }

    def _observed(self, ids: Index) -> dict[str, Array]:
        rig, sequencer, limits = self.rig, self.rig.sequencer, self.experiment.motion
        t = np.multiply(rig.step, CONTROL_DT, dtype=np.float64)
        x, quaternion, velocity, turning = sequencer.reference(t)
        hand = rig.seen_end_effector
        poses = np.empty((2, rig.nsim, 6))
        poses[0, :, :3], poses[1, :, :3] = hand.position, x
        poses[..., 3:] = to_rpy(np.array([hand.quaternion, quaternion]))
        error = pose_error(poses[0], poses[1])
        goal, onward = sequencer.ahead
        share = self._stiffness[ids, :2] / _UNIT
        return {
            "displacement": rig.seen_position[ids] - rig.start,
            "velocity": rig.seen_velocity[ids],
            "torque": rig.undithered_torque[ids] / self.stiction,
            "error": error[ids] / self._tolerance,
            "reference": velocity[ids] / limits.translational_speed,
            "turning": turning[ids] / limits.rotational_speed,
            "remaining": (sequencer.movement.duration - (t - sequencer.arrays.begun))[ids],
            "goal": (goal - hand.position)[ids],
            "onward": onward[ids],
            "goals_left": sequencer.goals_left[ids],
            "translational": share[:, 0],
            "rotational": share[:, 1],
        }

    def path_points(self, i: int) -> Array:
        """Return (goals + 1, 3) the nominal start and the goals of simulation ``i`` [m]."""
        path, rig = self.experiment.path(self.case[i][0]), self.rig
        goals, _ = path.goals(rig.start_position[None], rig.start_quaternion[None])
        return np.concatenate([rig.start_position[None], goals[0]])

    def describe(self, ids: Index) -> dict[str, NDArray[np.generic]]:
        """Return trajectory, number and stiffness (M, 3) of the episodes of ``ids``."""
        names = [self.case[i][0] for i in ids]
        numbers = [path_number(name) for name in names]
        shown = [t if k is None else RANDOM for t, k in zip(names, numbers, strict=True)]
        return {
            "trajectory": np.array(shown, dtype=object),
            "path": np.array([-1 if k is None else k for k in numbers], dtype=np.int64),
            "stiffness": self._stiffness[ids],
        }
