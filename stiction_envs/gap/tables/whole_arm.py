"""The experiment with the whole arm, in states that differ from the nominal arm."""

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
    """A number that a joint can be simulated with other values of."""

    name: str
    fields: tuple[str, ...]
    """Friction parameters of the joint that it multiplies, or one field of the torque interface."""
    of_interface: bool = False
    """Whether its values are those of the torque interface, one for all joints."""
    low: float
    high: float
    """Range of its values."""
    anchors: tuple[float, ...] = ()
    """Factors at which joints are simulated with the whole arm that the lone joint does not
    explain."""


FRICTION_LEVEL = Quantity(
    name="friction_level",
    fields=("stiction", "load_coefficient"),
    low=0.5,
    high=2.0,
    anchors=(0.87, 1.15),
)


@dataclass(frozen=True)
class State:
    """What a joint is simulated with where that is not nominal."""

    values: frozenset[tuple[Quantity, float]] = frozenset()

    def without(self, quantity: Quantity) -> State:
        """Return the state with the nominal value of a quantity."""
        return State(frozenset(x for x in self.values if x[0] != quantity))


class WholeArm:
    """The nominal arm; what was simulated once is kept, for other tables of it too."""

    nominal = State()

    def __init__(
        self,
        arm: Arm,
        friction: FrictionParameters,
        *,
        interface: TorqueInterface | None = None,
        protocol: Protocol | None = None,
        threads: int = 0,
    ) -> None:
        """Set the arm up.

        Args:
            arm: the arm.
            friction: nominal parameters of one arm.
            interface: nominal torque interface; None for the arm's.
            protocol: of the measurement; None for the robot's.
            threads: threads, 0 for all processors.
        """
        self.arm, self.friction, self.threads = arm, friction, threads
        self.interface = TorqueInterface.of(arm) if interface is None else interface
        self.protocol = load_protocol(arm.registered_name) if protocol is None else protocol
        self.poses = find_poses(arm)
        self._known: dict[tuple[State, Job], float] = {}

    def value(self, state: State, quantity: Quantity) -> float:
        """Return a factor, or a value of the torque interface; inf is a filter that is off."""
        nominal = getattr(self.interface, quantity.fields[0]) if quantity.of_interface else 1.0
        return dict(state.values).get(quantity, nominal or np.inf)

    def changed(self, state: State, quantity: Quantity, value: float) -> State:
        """Return the state with another value of a quantity."""
        rest = state.without(quantity)
        if value == self.value(rest, quantity):
            return rest
        return State(rest.values | {(quantity, value)})

    def torques(self, state: State, jobs: Sequence[Job]) -> Array:
        """Return (jobs,) readings [N·m] that were simulated."""
        return np.array([self._known[state, job] for job in jobs])

    def simulate(self, wanted: Sequence[tuple[State, Sequence[Job]]]) -> None:
        """Simulate joints, each in one state; those with the same torque interface run at once.

        Args:
            wanted: state and jobs of each joint.
        """
        groups: dict[frozenset[tuple[str, float]], list[tuple[State, list[Job]]]] = {}
        for state, jobs in wanted:
            new = [x for x in dict.fromkeys(jobs) if (state, x) not in self._known]
            shared = frozenset((q.fields[0], v) for q, v in state.values if q.of_interface)
            if new:
                groups.setdefault(shared, []).append((state, new))
        for shared, some in groups.items():
            self._simulate(dict(shared), some)

    def _simulate(
        self, shared: dict[str, float], wanted: Sequence[tuple[State, Sequence[Job]]]
    ) -> None:
        fields: dict[str, Array] = {}
        for state, jobs in wanted:
            for quantity, value in state.values:
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
        # the first ramp finds the arm as it was placed, all others as the move back leaves it
        repeats = min(2, int(self.protocol.iterations))
        share = 1.0 / self.protocol.iterations if repeats == 2 else 1.0
        states = {job: state for state, jobs in wanted for job in jobs}
        for m in experiment.run(list(states), iterations=repeats):
            tau = m.job.configuration.sign * (share * m.tau[0] + (1 - share) * m.tau[-1])
            stuck = self.protocol.give_up_factor * experiment.expected(m.job)
            self._known[states[m.job], m.job] = float(tau) if np.isfinite(tau) else stuck
