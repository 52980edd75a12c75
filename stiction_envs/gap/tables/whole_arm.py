"""The Single Joint Experiment with the whole arm, in states that differ from the nominal arm."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.experiments.poses import find_poses
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Job, Protocol, load_protocol
from stiction_envs.friction.inertia import link_inertia
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
STEP = 0.1
"""Step of a quantity's logarithm between states [-]; assumed."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A parameter of a joint that can be simulated with other values."""

    name: str
    fields: tuple[str, ...]
    """Friction parameters of the joint that it multiplies, or one field of the torque interface."""
    of_interface: bool = False
    """Whether it is a value of the torque interface, common to all joints, and not a factor."""
    low: float
    """Least value [-], or in units of the interface."""
    high: float
    """Largest value."""


FRICTION_LEVEL = Quantity(
    name="friction_level", fields=("stiction", "load_coefficient"), low=0.5, high=2.0
)
"""Factor of a joint's friction; the range is assumed."""
State = frozenset[tuple[Quantity, int]]
"""The quantities of a joint that are not nominal, and by how many steps of the logarithm."""
NOMINAL: State = frozenset()


class WholeArm:
    """The nominal arm; simulated readings are kept, for other tables of it too."""

    def __init__(
        self,
        arm: Arm,
        friction: FrictionParameters,
        *,
        protocol: Protocol | None = None,
        threads: int = 0,
    ) -> None:
        """Set the arm up.

        Args:
            arm: the arm.
            friction: nominal parameters of one arm.
            protocol: protocol of the measurement; None for the robot's.
            threads: threads, 0 for all processors.
        """
        self.arm, self.friction, self.threads = arm, friction, threads
        self.interface = TorqueInterface.of(arm)
        self.protocol = load_protocol(arm.registered_name) if protocol is None else protocol
        self.poses = find_poses(arm)
        self._known: dict[tuple[State, Job], float] = {}

    @cached_property
    def level(self) -> Array:
        """(n, 2) stiction in the load and the no-load pose, mean over directions [N·m]."""
        each = [self.friction.stiction_at(self.poses.load[:, k]).mean(axis=1) for k in range(2)]
        return np.stack(each, axis=1)

    @cached_property
    def link(self) -> Array:
        """(n, 2) link inertia in both poses [kg·m²]."""
        each = [link_inertia(self.arm, self.poses.q[:, k]) for k in range(2)]
        return np.stack([np.einsum("jj->j", x) for x in each], axis=1)

    def value(self, state: State, q: Quantity) -> float:
        """Return a factor, or a value of the torque interface; inf for a filter that is off."""
        if steps := dict(state).get(q):
            return self.neutral(q) * float(np.exp(STEP * steps))
        return (getattr(self.interface, q.fields[0]) or np.inf) if q.of_interface else 1.0

    def neutral(self, q: Quantity) -> float:
        """Return the nominal value of a quantity; a filter that is off has its largest."""
        return float(np.clip(self.value(NOMINAL, q), q.low, q.high))

    def torques(self, state: State, jobs: Sequence[Job]) -> Array:
        """Return (jobs,) simulated readings [N·m]."""
        return np.array([self._known[state, job] for job in jobs])

    def simulate(self, wanted: Sequence[tuple[State, Sequence[Job]]]) -> None:
        """Simulate joints, each in one state; those with the same torque interface run together.

        Args:
            wanted: state and jobs of each joint.
        """
        groups: dict[State, dict[Job, State]] = {}
        for state, jobs in wanted:
            new = {x: state for x in jobs if (state, x) not in self._known}
            groups.setdefault(frozenset(x for x in state if x[0].of_interface), {}).update(new)
        for shared, states in groups.items():
            if states:
                self._simulate(shared, states)

    def _simulate(self, shared: State, states: dict[Job, State]) -> None:
        fields: dict[str, Array] = {}
        of_joint = {job.configuration.joint: state for job, state in states.items()}
        for joint, state in of_joint.items():
            for q, _ in state - shared:
                for field in q.fields:
                    array = fields.setdefault(field, np.array(getattr(self.friction, field)))
                    array[joint - 1] *= self.value(state, q)
        path = {q.fields[0]: self.value(shared, q) for q, _ in shared}
        experiment = SingleJointExperiment(
            self.arm,
            friction=self.friction.replace(**fields),
            protocol=self.protocol,
            interface=dataclasses.replace(self.interface, **path),  # type: ignore[arg-type]
            scatter=False,
            threads=self.threads,
        )
        # the first ramp starts with the arm as it was placed, the others after the move back
        repeats = min(2, int(self.protocol.iterations))
        share = 1.0 / self.protocol.iterations if repeats == 2 else 1.0
        for m in experiment.run(list(states), iterations=repeats):
            tau = m.job.configuration.sign * (share * m.tau[0] + (1 - share) * m.tau[-1])
            stuck = self.protocol.give_up_factor * experiment.expected(m.job)
            self._known[states[m.job], m.job] = float(tau) if np.isfinite(tau) else stuck
