"""An agent in the Generated Trajectory Experiment, without an environment.

    experiment = GeneratedTrajectoryExperiment("panda")
    runner = PathRunner(experiment, Policy.load("policy.zip"))
    runs = runner.run([Case(trajectory="triangle", stiffness=(200, 20, 0))])
    print(measure(runs[0], experiment.protocol))

At the policy's own rate it reads the measurements and sets amplitudes and frequencies, as a robot's
controller would. The environment's own code makes the observations, so both give the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.evaluation import Policy as Agent
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.episodes import GTEEpisodes
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.observation import GTEObserver
from stiction_envs.experiments.gte.protocol import Case, Run
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.experiments.observation import action_bounds
from stiction_envs.experiments.rig import count_blocks
from stiction_envs.experiments.sje.poses import find_poses
from stiction_envs.plant import CONTROL_DT
from tuning.policies.policy import Policy

Array = NDArray[np.float64]


class PathRunner:
    """Runs cases of an experiment with an agent as the source of the dither."""

    def __init__(
        self,
        experiment: GeneratedTrajectoryExperiment,
        agent: Agent,
        *,
        interval: float | None = None,
    ) -> None:
        """Prepare.

        Args:
            experiment: arm, friction, controller.
            agent: agent with Stable-Baselines3's `predict`, actions in N·m and Hz.
            interval: time between two actions [s]; None for a `Policy`'s own.

        Raises:
            StictionError: an interval that is not a multiple of the controller's cycle, or a policy
                for another arm or other observations.
        """
        self._experiment, self._agent = experiment, agent
        arm = experiment.sticking.arm
        low, high = action_bounds(
            experiment.sticking.parameters, find_poses(arm), experiment.interface
        )
        # a space uses single precision
        self._low, self._high = (x.astype(np.float32).astype(float) for x in (low, high))
        self._observer = GTEObserver(experiment, self._low, self._high)
        if isinstance(agent, Policy):
            interval = agent.card.interval if interval is None else interval
            agent.check(
                robot=arm.name,
                environment=agent.card.environment,
                observation_names=self._observer.names,
                interval=interval,
            )
        if interval is None:
            raise StictionError("PathRunner: expected the interval of the agent's actions [s]")
        block = GTEEpisodes.block_steps(experiment)
        count_blocks("interval", interval, block * CONTROL_DT)
        self._interval = interval

    def run(self, cases: Sequence[Case], *, iterations: int | None = None) -> list[Run]:
        """Run all iterations of all cases; the dither of the cases is ignored.

        Args:
            cases: paths and stiffnesses, and their compensation.
            iterations: None for the protocol's; they start as in the experiment.

        Returns:
            One run per case, as `GeneratedTrajectoryExperiment.run` returns them.

        Raises:
            StictionError: a case of an unknown path.
        """
        still = [replace(c, dither=(), gate_velocity=np.inf, phases="random") for c in cases]
        runs = self._experiment.run(
            still, iterations=iterations, steering=self._steering, interval=self._interval
        )
        return [replace(run, case=case) for case, run in zip(cases, runs, strict=True)]

    def _steering(self, rig: GTERig, cases: Sequence[Case]) -> Callable[[], None]:
        """Return a function that lets the agent observe a rig's arms and sets their dither."""
        ids = np.arange(rig.nsim)
        goals, stiffness = rig.sequencer.goals_left, np.array([c.stiffness for c in cases])
        action = np.tile(self._low, (rig.nsim, 1))

        def steer() -> None:
            nonlocal action
            rig.seen_end_effector.read()
            seen = self._observer.observe(rig, ids, action=action, stiffness=stiffness, goals=goals)
            chosen, _ = self._agent.predict(seen)
            action = np.clip(np.asarray(chosen, dtype=float), self._low, self._high)
            rig.retune(action[:, : rig.n], action[:, rig.n :])

        return steer
