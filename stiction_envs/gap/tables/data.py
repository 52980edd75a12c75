"""Torque tables read and as arrays, the whole arm that is simulated, and what causes change."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.errors import StictionError
from stiction_envs.experiments.poses import find_poses
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import (
    Configuration,
    Job,
    Protocol,
    configurations,
    load_protocol,
)
from stiction_envs.friction.inertia import link_inertia
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.measured.tables import SJERow, our_name, read_sje
from stiction_envs.robots import Arm

STEP = 0.1
"""Step of a quantity's logarithm between states [-]; assumed."""


@dataclass(frozen=True, kw_only=True)
class SimulatedQuantity:
    """A parameter of a joint that can be simulated with other values."""

    fields: tuple[str, ...]
    """Friction parameters of the joint that it multiplies, or one field of the torque interface."""
    of_interface: bool = False
    """Whether it is a value of the torque interface, common to all joints, and not a factor."""
    low: float
    """Least value [-], or in units of the interface."""
    high: float
    """Largest value."""


FRICTION_LEVEL = SimulatedQuantity(fields=("stiction", "load_coefficient"), low=0.5, high=2.0)
"""Factor of a joint's friction; the range is assumed."""
State = frozenset[tuple[SimulatedQuantity, int]]
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
        """Set the arm up, with the protocol of the measurement; None for the robot's.

        ``threads`` 0 is all processors.
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

    def value(self, state: State, q: SimulatedQuantity) -> float:
        """Return a factor, or a value of the torque interface; inf for a filter that is off."""
        if steps := dict(state).get(q):
            return self.neutral(q) * float(np.exp(STEP * steps))
        return (getattr(self.interface, q.fields[0]) or np.inf) if q.of_interface else 1.0

    def neutral(self, q: SimulatedQuantity) -> float:
        """Return the nominal value of a quantity; a filter that is off has its largest."""
        return float(np.clip(self.value(NOMINAL, q), q.low, q.high))

    def torques(self, state: State, jobs: Sequence[Job]) -> Array:
        """Return (jobs,) simulated readings [N·m]."""
        return np.array([self._known[state, job] for job in jobs])

    def simulate(self, wanted: Sequence[tuple[State, Sequence[Job]]]) -> None:
        """Simulate the jobs of each joint in one state; equal torque interfaces run together."""
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


class TableData:
    """The readings of all joints that have dithered torques, as arrays of length N."""

    def __init__(self, rows: Sequence[SJERow], whole: WholeArm) -> None:
        """Take the rows of one arm that `read_tables` returns."""
        self.whole = whole
        places = [place_of(x) for x in rows]
        self.joints = tuple(sorted({x.joint for x in rows}))
        pairs = list(zip(places, rows, strict=True))
        self.jobs = [Job(w, x.frequency_hz, x.amplitude_nm) for w, x in pairs]
        """(N) simulated experiments that predict the readings."""
        self.joint = np.array([w.joint for w in places])
        self.pose = np.array([w.index[1] for w in places])
        self.sign = np.array([w.sign for w in places])
        self.torque = self.sign * [x.tau_nm for x in rows]
        """Measured, along the ramp: negative if the joint moved against it [N·m]."""
        self.base = np.array([x.is_base for x in rows])
        base = {w: abs(x.tau_nm) for w, x in pairs if x.is_base}
        keys = [(x.frequency_hz, round(x.amplitude_nm / base[w], 1)) for w, x in pairs]
        self.blocks = len(set(keys))
        """Number of parts that are left out together: base torques, each frequency and scale."""
        self.block = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
        """Number of a reading's block; 0: base torques."""
        self.of_joint = {j: np.flatnonzero(self.joint == j) for j in self.joints}
        """The readings of each joint (from 1)."""

    @cached_property
    def unit(self) -> Array:
        """(N,) friction of the nominal arm in the pose of each reading [N·m]."""
        each = {j: [self.jobs[i] for i in rows] for j, rows in self.of_joint.items()}
        self.whole.simulate([(NOMINAL, jobs) for jobs in each.values()])
        tau = self.whole.torques(NOMINAL, self.jobs)
        level = 2 * self.joint + self.pose
        mean = {k: tau[self.base & (level == k)].mean() for k in np.unique(level).tolist()}
        return np.array([mean[k] for k in level.tolist()])

    def dithered(self, joint: int) -> dict[Configuration, Index]:
        """Return the dithered torques of each configuration of a joint."""
        out: dict[Configuration, list[int]] = {}
        for i in self.of_joint[joint].tolist():
            if not self.base[i]:
                out.setdefault(self.jobs[i].configuration, []).append(i)
        return {where: np.array(rows) for where, rows in out.items()}

    def place(self, i: int) -> str:
        """Return joint, pose, direction and dither of a reading, as ``joint 7 load +, 30 Hz``."""
        job, where = self.jobs[i], self.jobs[i].configuration
        dither = f"{job.frequency_hz:g} Hz, {job.amplitude_nm:.4g} N·m"
        place = f"joint {where.joint} {where.load} {where.direction}"
        return f"{place}, {'no dither' if self.base[i] else dither}"


@dataclass(frozen=True, eq=False)
class Effect:
    """The change of some readings by a cause with one unknown x, 0 in the nominal model.

    x is the logarithm of a `quantity` of the simulation over its nominal value, the size of an
    added `torque`, or the number from which `level` makes a factor on friction.
    """

    cause: str
    joints: tuple[int, ...]
    """From 1; several only for a quantity that they have in common."""
    rows: Index
    """The readings."""
    _: KW_ONLY
    scope: str = ""
    """Which of the effects of this cause on a joint it is."""
    size: float
    """Standard deviation of the Gaussian prior of x."""
    most: float = np.inf
    """Largest |x|; ends of a quantity follow from what can be simulated."""
    trials: tuple[float, ...] = (-0.7, 0.7)
    """Values of x over its prior size to which the effect is a straight line [-]; assumed."""
    odds: float = 0.0
    """Log odds against it, beside those of one among the effects of its kind [nats]."""
    quantity: SimulatedQuantity | None = None
    """Parameter that the simulation varies."""
    torque: Array | None = None
    """(rows,) torque that is added to the readings per unit of x."""
    level: Callable[[float], Array | float] | None = None
    """Returns the logarithm of the factor on friction, one or (rows,)."""
    parameters: Mapping[str, float]
    """The parameters of ``diagnosis.json`` per unit of x; a longer key names a part."""
    log: bool = False
    """Whether they are those per unit of exp(x)."""
    bad: bool = False
    """Whether it is a bad reading, and not a property of the arm."""

    def values(self, x: float) -> dict[str, float]:
        """Return the parameters of ``diagnosis.json`` for x."""
        each = float(np.exp(x)) if self.log else x
        return {name: scale * each for name, scale in self.parameters.items()}


def place_of(row: SJERow) -> Configuration:
    """Return joint, pose and direction of a row."""
    return Configuration(row.joint, row.load, row.direction)


def read_tables(paths: Sequence[str | Path], arm: Arm) -> list[SJERow]:
    """Read the torques of joints with dither from SJE tables: base torques first, each once.

    Args:
        paths: files in the form of ``sje.csv``; a base torque in several files must be the same.
        arm: the arm; rows of other robots are left out.

    Raises:
        StictionError: a file that cannot be read, no row of the arm, or a joint with dithered
            torques that lacks one of its four base torques.
    """
    rows = [(str(path), row) for path in paths for row in read_sje(path)]
    robots = list(dict.fromkeys(our_name(row.robot) for _, row in rows))
    if arm.name in robots or arm.registered:
        rows = [(path, row) for path, row in rows if our_name(row.robot) == arm.name]
    if not rows or (arm.name not in robots and len(robots) > 1):
        raise StictionError(
            f"{paths[0]}: torques of {', '.join(robots)}: expected robot {arm.name}"
        )
    base: dict[Configuration, SJERow] = {}
    for path, row in rows:
        known = base.setdefault(place_of(row), row) if row.is_base else row
        if known.tau_nm != row.tau_nm:
            raise StictionError(
                f"{path}: base torque of joint {row.joint}, {row.load} {row.direction} is "
                f"{row.tau_nm:g} N·m and {known.tau_nm:g} N·m: expected one"
            )
    dithered = [row for _, row in rows if row.amplitude_nm > 0]
    if not dithered:
        raise StictionError(f"{paths[0]}: base torques alone: expected rows with dither too")
    joints = sorted({x.joint for x in dithered})
    if joints[-1] > arm.n:
        raise StictionError(f"{paths[0]}: joint {joints[-1]}: {arm.name} has {arm.n}")
    wanted = configurations(arm.n, joints)
    for where in wanted:
        if where not in base or not base[where].tau_nm:
            raise StictionError(
                f"{paths[0]}: joint {where.joint} has dithered torques, but no base torque in "
                f"{where.load} {where.direction}: expected all four, not 0 (rows with frequency "
                "and amplitude 0)"
            )
    return [*(base[where] for where in wanted), *dithered]
