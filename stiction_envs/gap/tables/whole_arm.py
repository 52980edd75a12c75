"""The Single Joint Experiment with the whole arm, in states that differ from the nominal arm."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.poses import find_poses
from stiction_envs.experiments.sje.protocol import Job, Protocol, load_protocol
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.robots import Arm

Array = NDArray[np.float64]


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
    name="friction_level",
    fields=("stiction", "load_coefficient"),
    low=0.5,
    high=2.0,
)
"""Its range is assumed."""
State = frozenset[tuple[Quantity, float]]
"""The values of a joint that are not nominal."""
NOMINAL: State = frozenset()


def without(state: State, quantity: Quantity) -> State:
    """Return the state with the nominal value of a quantity."""
    return frozenset(x for x in state if x[0] != quantity)


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

    def value(self, state: State, quantity: Quantity) -> float:
        """Return a factor, or a value of the torque interface; inf for a filter that is off."""
        nominal = getattr(self.interface, quantity.fields[0]) if quantity.of_interface else 1.0
        return dict(state).get(quantity, nominal or np.inf)

    def changed(self, state: State, quantity: Quantity, value: float) -> State:
        """Return the state with another value of a quantity."""
        rest = without(state, quantity)
        return rest if value == self.value(rest, quantity) else rest | {(quantity, value)}

    def torques(self, state: State, jobs: Sequence[Job]) -> Array:
        """Return (jobs,) simulated readings [N·m]."""
        return np.array([self._known[state, job] for job in jobs])

    def simulate(self, wanted: Sequence[tuple[State, Sequence[Job]]]) -> None:
        """Simulate joints, each in one state; those with the same torque interface run together.

        Args:
            wanted: state and jobs of each joint.
        """
        groups: dict[frozenset[tuple[str, float]], list[tuple[State, list[Job]]]] = {}
        for state, jobs in wanted:
            new = [x for x in dict.fromkeys(jobs) if (state, x) not in self._known]
            shared = frozenset((q.fields[0], v) for q, v in state if q.of_interface)
            if new:
                groups.setdefault(shared, []).append((state, new))
        for shared, some in groups.items():
            self._simulate(dict(shared), some)

    def _simulate(
        self, shared: dict[str, float], wanted: Sequence[tuple[State, Sequence[Job]]]
    ) -> None:
        fields: dict[str, Array] = {}
        for state, jobs in wanted:
            for quantity, value in state:
                for field in () if quantity.of_interface else quantity.fields:
                    array = fields.setdefault(field, np.array(getattr(self.friction, field)))
                    array[jobs[0].configuration.joint - 1] *= value
        off = {k: v if np.isfinite(v) else 0.0 for k, v in shared.items()}
        experiment = SingleJointExperiment(
            self.arm,
            friction=self.friction.replace(**fields),
            protocol=self.protocol,
            interface=dataclasses.replace(self.interface, **off),  # type: ignore[arg-type]
            scatter=False,
            threads=self.threads,
        )
        # the first ramp starts with the arm as it was placed, the others after the move back
        repeats = min(2, int(self.protocol.iterations))
        share = 1.0 / self.protocol.iterations if repeats == 2 else 1.0
        states = {job: state for state, jobs in wanted for job in jobs}
        for m in experiment.run(list(states), iterations=repeats):
            tau = m.job.configuration.sign * (share * m.tau[0] + (1 - share) * m.tau[-1])
            stuck = self.protocol.give_up_factor * experiment.expected(m.job)
            self._known[states[m.job], m.job] = float(tau) if np.isfinite(tau) else stuck
