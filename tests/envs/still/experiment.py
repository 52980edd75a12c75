"""An arm is held at rest by servos and dithered; the reward is how little it moves."""

from dataclasses import dataclass

import numpy as np

from stiction_envs.envs.gym_env import ArmEnv, ArmVectorEnv
from stiction_envs.experiments.episodes import Episodes, Outcome
from stiction_envs.experiments.observation import DITHER, TORQUE, Elements
from stiction_envs.experiments.rig import Experiment, Rig
from stiction_envs.experiments.sje.protocol import load_protocol
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.plant import CONTROL_DT


@dataclass(frozen=True, init=False, repr=False)
class StillExperiment(Experiment):
    """An arm that is held."""

    def __init__(self, robot, *, friction=None, threads=0):
        super().__init__(sticking_model(robot, friction), threads=threads)


class StillRig(Rig):
    """Held arms, and where they were a step ago."""

    def hold(self, ids):
        rest = np.tile(self.plant.sticking.arm.rest, (len(ids), 1))
        self.plant.reset(ids, rest)
        here = self._servos.inertia(rest)
        self.plant.set_servo(ids, *self._servos_of(ids, *here), rest)
        self._path.reset(ids)
        self.step[ids] = 0

    def advance(self, ids, steps):
        for _ in range(steps):
            torque = self.dither.torque(self._command_time(), self._gate_speed())[ids]
            self.plant.run(self._path.run(torque[:, None], ids), ids)
            self.step[ids] += 1


@dataclass(frozen=True)
class Weights:
    """Weights of the penalties."""

    power_weight: float = 0.01
    torque_rate_weight: float = 0.01


class StillEpisodes(Episodes):
    """Episodes of a tenth of a second."""

    terms = ("still", "power", "torque_rate")
    groups = (
        Elements("displacement", -1.0, 1.0, "rad", "from rest", per_joint=True),
        Elements("velocity", -9.0, 9.0, "rad/s", "of the links", per_joint=True),
        TORQUE,
        *DITHER,
    )
    reward_settings = Weights

    def _experiment(self, a, arm, friction):
        return StillExperiment(arm, friction=friction, threads=a.threads)

    @staticmethod
    def block_steps(experiment):
        return experiment.interface.hold_steps

    def _make(self, a):
        e = self.experiment
        self.stiction = e.sticking.parameters.stiction.max(axis=-1)
        self.rig = StillRig(e, self.num_envs, approach=load_protocol(self.arm.registered_name))

    def _check_options(self, options):
        return dict(options or {})

    def _draw(self, rng, options):
        return "rest", (int(rng.integers(2**32)),)

    def _cases(self, options):
        return {"rest"}

    def _undithered(self, cases):
        return dict.fromkeys(cases, 1.0)

    def _begin(self, ids, cases, keys, base):
        self.rig.hold(ids)
        self.rig.set_dither(ids, amplitude=0.0, frequency=1.0)

    def _advance(self, ids):
        self.rig.advance(ids, self.interval_steps)

    def _moved(self, ids):
        return self.rig.plant.position[ids] - self.arm.rest

    def _outcome(self, ids):
        moved = np.sqrt((self._moved(ids) ** 2).sum(axis=1))
        over = self.steps[ids] * self.interval_steps * CONTROL_DT >= 0.1 - 1e-9
        share = np.full(len(ids), 0.1)
        return Outcome(
            terms={"still": -moved, **self._penalties(ids, share)},
            terminated=over,
            truncated=np.zeros(len(ids), dtype=bool),
            measures={"moved": moved},
        )

    def last_measures(self, ids):
        return {}

    def _observed(self, ids):
        return {
            "displacement": self._moved(ids),
            "velocity": self.rig.plant.velocity[ids],
            "torque": np.zeros((len(ids), self.n)),
        }

    def describe(self, ids):
        return {"pose": np.full(len(ids), "rest", dtype=object)}

    @staticmethod
    def columns(measures):
        return {"moved_rad": float(measures["moved"])}


class StillEnv(ArmEnv):
    """Page of the single environment."""

    episodes = StillEpisodes


class StillVectorEnv(ArmVectorEnv):
    """Page of the batch."""

    episodes = StillEpisodes
