"""An agent in the Generated Trajectory Experiment, without an environment around it.

    runner = PathRunner(GeneratedTrajectoryExperiment("panda"), Policy.load("policy.zip"))
    runs = runner.run([Case(trajectory="triangle", stiffness=(200, 20, 0))])
    print(measure(runs[0], experiment.protocol))

It is what a robot's controller would do: at the policy's own rate look at what is measured, set
amplitudes and frequencies, go on. What is seen is put together by the environment's own code, so
that both do the same, bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.gte_core import GTECore
from stiction_envs.envs.gte_layout import CAPACITY
from stiction_envs.envs.gte_observation import GTEObserver
from stiction_envs.envs.layout import action_bounds
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import Case, Run
from stiction_envs.experiments.gte.run_log import RunLog
from stiction_envs.experiments.sje.poses import find_poses
from stiction_envs.plant import CONTROL_DT
from tuning.policies.policy import Policy

Array = NDArray[np.float64]


class PathRunner:
    """Runs cases of an experiment with an agent as the source of the dither."""

    def __init__(
        self,
        experiment: GeneratedTrajectoryExperiment,
        agent: Any,
        *,
        interval: float | None = None,
    ) -> None:
        """Prepare.

        Args:
            experiment: arm, friction, controller.
            agent: with Stable-Baselines3's `predict`, actions in N·m and Hz.
            interval: time between two actions [s]; None for a `Policy`'s own.

        Raises:
            StictionError: an interval that the controller's cycles do not fit into, or a policy for
                another arm, or for other observations.
        """
        self._experiment, self._agent = experiment, agent
        arm = experiment.sticking.arm
        low, high = action_bounds(
            experiment.sticking.parameters, find_poses(arm), experiment.interface
        )
        # a space has single precision
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
        block = GTECore.block_steps(experiment)
        self._steps = round(interval / (block * CONTROL_DT)) * block
        if self._steps < 1 or abs(self._steps * CONTROL_DT - interval) > 1e-9:
            raise StictionError(
                f"interval {interval}: expected one of the multiples of {block * CONTROL_DT:g} s"
            )

    def run(self, cases: Sequence[Case], *, iterations: int | None = None) -> list[Run]:
        """Run all iterations of all cases in one batch; dither of the cases is not looked at.

        Args:
            cases: paths and stiffnesses, and their compensation.
            iterations: None for the protocol's; they start as those of the experiment.

        Returns:
            One run per case, as `GeneratedTrajectoryExperiment.run` has them.

        Raises:
            StictionError: a case of an unknown path.
        """
        e = self._experiment
        repeats = e.protocol.iterations if iterations is None else iterations
        paths = [e.path(c.trajectory) for c in cases for _ in range(repeats)]
        of = np.repeat(np.arange(len(cases)), repeats)
        goals = np.array([len(p.position) for p in paths])
        mine = [c for c in cases for _ in range(repeats)]
        stiffness = np.array([c.stiffness for c in mine])
        ids = np.arange(len(of))
        rig = e.rig(len(ids), max(CAPACITY, int(goals.max())))
        rig.begin(ids, paths, stiffness, [(int(i % repeats),) for i in ids])
        rig.set_dither(ids, amplitude=0.0, frequency=1.0)
        rig.compensator.set_rows(ids, [c.compensation for c in mine])
        log = RunLog(rig, e.protocol, self._steps)
        horizon = np.array([e.horizon(p) for p in paths])
        action = np.tile(self._low, (len(ids), 1))
        while log.time < np.max(log.end(horizon)):
            rig.end_effector.read()
            seen = self._observer.observe(rig, ids, action=action, stiffness=stiffness, goals=goals)
            chosen, _ = self._agent.predict(seen)
            action = np.clip(np.asarray(chosen, dtype=float), self._low, self._high)
            rig.retune(action[:, : rig.n], action[:, rig.n :])
            log.advance()
        return [
            log.run(c, of == i, len(e.path(c.trajectory).position), horizon)
            for i, c in enumerate(cases)
        ]
