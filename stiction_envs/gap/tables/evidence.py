"""What torque tables say for and against a statement about the arm, in nats.

A reading is one base torque or one dithered torque, counted along its ramp. Its prediction is the
whole arm's (`WholeArm`), and what a statement changes about it comes from the fast lone joint:

    W(x) ≈ W(x₀) + lone(x) − lone(x₀)

with x₀ the last state that the whole arm was simulated in, and corrected likewise wherever else it
was simulated (space mapping: Bandler et al. 1994).
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.poses import find_poses
from stiction_envs.experiments.sje.protocol import (
    Configuration,
    Job,
    Protocol,
    configurations,
    load_protocol,
)
from stiction_envs.friction.parameters import FrictionParameters, bristle_damping
from stiction_envs.gap.tables.cells import Cell
from stiction_envs.gap.tables.model import Bench, JointTables
from stiction_envs.gap.tables.settings import StatementSettings
from stiction_envs.measured import BaseTable
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]
DYNAMIC = ("low_pass", "rotor_inertia", "presliding")
"""Statements that only a simulation can follow; their ranges are in `StatementSettings`."""
Column = tuple[float, float, float, float]
"""(stiction, link inertia, dither frequency, amplitude)."""
FIELD = {"rotor_inertia": "rotor_inertia", "presliding": "bristle_stiffness"}
SCALED = {**{n: (f,) for n, f in FIELD.items()}, "friction_level": ("stiction", "load_coefficient")}
"""Friction parameters that a state multiplies."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One base torque, or one dithered torque."""

    where: Configuration
    frequency: float
    amplitude: float
    block: tuple[float, float]
    """(frequency [Hz], scale [-]): what is left out together; (0, 0) are the base torques."""
    torque: float
    """Measured, along the ramp: negative if the joint moved against it [N·m]."""
    cell: Cell | None
    """None for a base torque."""

    @property
    def job(self) -> Job:
        """The experiment that predicts it."""
        return Job(self.where, self.frequency, self.amplitude)


class Readings:
    """The readings of all joints that have dithered torques, as arrays of length N."""

    def __init__(self, base: BaseTable, cells: Sequence[Cell]) -> None:
        good = [c for c in cells if np.isfinite(c.row.tau_sje_nm)]
        self.joints = sorted({c.row.joint for c in good})
        self.all = [
            Reading(
                where=w,
                frequency=0.0,
                amplitude=0.0,
                block=(0.0, 0.0),
                torque=float(w.sign * base.tau[w.index]),
                cell=None,
            )
            for w in (configurations(base.n_joints, self.joints) if self.joints else [])
        ]
        self.all += [
            Reading(
                where=c.configuration,
                frequency=c.row.frequency_hz,
                amplitude=c.row.amplitude_nm,
                block=(c.row.frequency_hz, round(c.row.scale, 1)),
                torque=c.configuration.sign * c.row.tau_sje_nm,
                cell=c,
            )
            for c in good
        ]
        index = [r.where.index for r in self.all]
        self.joint = np.array([i[0] + 1 for i in index], dtype=np.int64)
        self.pose = np.array([i[1] for i in index], dtype=np.int64)
        self.sign = np.array([r.where.sign for r in self.all])
        self.torque = np.array([r.torque for r in self.all])
        self.base = np.array([r.cell is None for r in self.all], dtype=bool)
        names = sorted({r.block for r in self.all})
        self.block = np.array([names.index(r.block) for r in self.all], dtype=np.int64)
        self.blocks = names
        self.level = 2 * np.searchsorted(self.joints, self.joint) + self.pose
        """Which friction level a reading has."""

    def of(self, where: Sequence[Configuration]) -> Mask:
        """Return (N,) which readings are of some configurations."""
        return np.array([r.where in where for r in self.all], dtype=bool)

    def jobs(self, joint: int) -> list[Job]:
        """Return the experiments of a joint's readings."""
        return [self.all[i].job for i in self.of_joints([joint])]

    def of_joints(self, joints: Sequence[int]) -> Index:
        """Return which readings are of some joints."""
        return np.flatnonzero(np.isin(self.joint, joints))


@dataclass(frozen=True)
class State:
    """What a joint is simulated with: cut-off [Hz, inf is off], factors on the nominal values."""

    low_pass: float
    rotor_inertia: float = 1.0
    presliding: float = 1.0
    friction_level: float = 1.0

    def on(self, name: str, x: float) -> State:
        """Return the state with the value of one statement, given as its logarithm."""
        return dataclasses.replace(self, **{name: float(np.exp(x))})


class WholeArm:
    """The nominal arm; what was simulated once is kept, for other tables of it too."""

    def __init__(
        self,
        arm: Arm,
        friction: FrictionParameters,
        *,
        interface: TorqueInterface | None = None,
        protocol: Protocol | None = None,
        nthread: int = 0,
    ) -> None:
        """Set the arm up.

        Args:
            arm: the arm.
            friction: nominal parameters of one arm.
            interface: nominal torque interface; None for the arm's.
            protocol: of the measurement; None for the robot's.
            nthread: threads, 0 for all processors.
        """
        self.arm, self.friction, self.nthread = arm, friction, nthread
        self.interface = TorqueInterface.of(arm) if interface is None else interface
        self.protocol = load_protocol(arm.name) if protocol is None else protocol
        self.poses = find_poses(arm)
        self._known: dict[tuple[State, Job], float] = {}
        self._lone: dict[tuple[State, tuple[Job, ...], StatementSettings], LoneJoint] = {}

    @property
    def nominal(self) -> State:
        """The state of a joint of which nothing is said."""
        return State(self.interface.lowpass_hz or np.inf)

    def torques(self, state: State, jobs: Sequence[Job]) -> Array:
        """Return (jobs,) readings [N·m] that were simulated."""
        return np.array([self._known[state, job] for job in jobs])

    def lone(
        self, state: State, jobs: Sequence[Job], bench: Bench, settings: StatementSettings
    ) -> LoneJoint:
        """Return the lone joint of the jobs of a joint, about a state."""
        key = state, tuple(jobs), settings
        if key not in self._lone:
            self._lone[key] = LoneJoint(jobs, bench, state, settings)
        return self._lone[key]

    def simulate(self, wanted: Sequence[tuple[State, Sequence[Job]]]) -> None:
        """Simulate joints, each in one state; what has the same cut-off runs at once.

        Args:
            wanted: state and jobs of each joint.
        """
        missing = [
            (s, [x for x in dict.fromkeys(jobs) if (s, x) not in self._known]) for s, jobs in wanted
        ]
        for cutoff in dict.fromkeys(s.low_pass for s, jobs in missing if jobs):
            self._simulate([(s, jobs) for s, jobs in missing if jobs and s.low_pass == cutoff])

    def _simulate(self, wanted: Sequence[tuple[State, Sequence[Job]]]) -> None:
        fields: dict[str, Array] = {}
        for name, some in SCALED.items():
            for field in some:
                fields[field] = np.array(getattr(self.friction, field))
                for state, jobs in wanted:
                    fields[field][jobs[0].configuration.joint - 1] *= getattr(state, name)
        cutoff = wanted[0][0].low_pass
        experiment = SingleJointExperiment(
            self.arm,
            friction=self.friction.replace(**fields),
            protocol=self.protocol,
            interface=dataclasses.replace(
                self.interface, lowpass_hz=cutoff if np.isfinite(cutoff) else 0.0
            ),
            scatter=False,
            nthread=self.nthread,
        )
        # the first ramp finds the arm as it was placed, all others as the move back leaves it
        repeats = min(2, int(self.protocol.iterations))
        share = 1.0 / self.protocol.iterations if repeats == 2 else 1.0
        states = {job: state for state, jobs in wanted for job in jobs}
        for m in experiment.run(list(states), iterations=repeats):
            tau = m.job.configuration.sign * (share * m.tau[0] + (1 - share) * m.tau[-1])
            stuck = self.protocol.give_up_factor * experiment.expected(m.job)
            self._known[states[m.job], m.job] = float(tau) if np.isfinite(tau) else stuck


class _Columns(JointTables):
    """A joint's lone-joint predictions at any levels."""

    def __init__(self, joint: int, bench: Bench, keys: Sequence[Column]) -> None:
        super().__init__(joint, [], bench)
        self._columns = sorted(set(keys))
        at = {key: i for i, key in enumerate(self._columns)}
        self._order = [at[key] for key in keys]

    def readings(self, population: Sequence[Mapping[str, float]]) -> Array:
        """Return (population, keys) breakaway torque [N·m]; a stuck joint reads far too much."""
        tau = self.torques(population)[:, self._order]
        stuck = 4.0 * max(key[0] for key in self._columns)
        return np.where(np.isfinite(tau), tau, stuck)


class LoneJoint:
    """How the readings of a joint answer to each statement, about one state."""

    def __init__(
        self, jobs: Sequence[Job], bench: Bench, state: State, settings: StatementSettings
    ) -> None:
        """Simulate the lone joint.

        Args:
            jobs: of one joint.
            bench: of the nominal arm.
            state: about which.
            settings: values that are simulated.
        """
        self._settings = settings
        self.state, joint, b = state, jobs[0].configuration.joint, bench
        j, poses = joint - 1, [job.configuration.index[1] for job in jobs]
        link = [float(b.link[j, k]) for k in poses]
        keys: list[Column] = [
            (float(b.level[j, k]), float(b.link[j, k]), job.frequency_hz, job.amplitude_nm)
            for job, k in zip(jobs, poses, strict=True)
        ]
        columns = _Columns(joint, b, keys)
        self.nominal = {n: columns.nominal(f) for n, f in FIELD.items()}
        here = dataclasses.asdict(state)
        self.knots = {n: self._knots(n, here, b, j, min(link)) for n in DYNAMIC}
        population = [self._parameters(here)]
        population += [
            self._parameters({**here, n: float(np.exp(x))}) for n in DYNAMIC for x in self.knots[n]
        ]
        tau = columns.readings(population)
        sizes = np.cumsum([1] + [len(k) for k in self.knots.values()])
        self.tables = {n: tau[a:z] for n, a, z in zip(DYNAMIC, sizes[:-1], sizes[1:], strict=True)}
        low, high = settings.friction_level
        levels = np.log(np.geomspace(low, high, settings.level_knots))
        scaled = [(f * key[0], *key[1:]) for f in np.exp(levels).tolist() for key in keys]
        flat = _Columns(joint, b, scaled).readings([self._parameters(here)])
        self.tables["friction_level"] = flat.reshape(len(levels), -1)
        self.knots["friction_level"] = levels

    def anchored(self, known: Mapping[State, Array]) -> LoneJoint:
        """Return predictions corrected by what the whole arm does, at its states and between.

        Args:
            known: (rows,) readings [N·m] of the whole arm in some states, among them this one.
        """
        new = copy.copy(self)
        new.tables = dict(self.tables)
        for name, knots in self.knots.items():
            here = self._log(name)
            found = {here: np.zeros(self.tables[name].shape[1])}
            for state, tau in known.items():
                if dataclasses.replace(state, **{name: getattr(self.state, name)}) == self.state:
                    x = float(np.clip(np.log(getattr(state, name)), knots[0], knots[-1]))
                    change = self._at(name, x) - self._at(name, here)
                    found.setdefault(x, tau - known[self.state] - change)
            if len(found) > 1:
                values = sorted(found)
                at = np.interp(knots, values, np.arange(len(values)))
                missing = np.array([found[v] for v in values])
                new.tables[name] = self.tables[name] + _between(missing, at)
        return new

    def _at(self, name: str, x: float) -> Array:
        at = np.interp([x], self.knots[name], np.arange(len(self.knots[name])))
        return np.asarray(_between(self.tables[name], at)[0])

    def _log(self, name: str) -> float:
        """Return the logarithm of a value of the state, within what was simulated."""
        knots = self.knots[name]
        return float(np.clip(np.log(getattr(self.state, name)), knots[0], knots[-1]))

    def _parameters(self, state: Mapping[str, float]) -> dict[str, float]:
        factors = {f: self.nominal[n] * state[n] for n, f in FIELD.items()}
        return {"lowpass_hz": state["low_pass"], **factors}

    def _knots(
        self, name: str, here: Mapping[str, float], bench: Bench, j: int, link: float
    ) -> Array:
        """Return the logarithms of the values that are simulated: those that do not chatter."""
        low, high = getattr(self._settings, name)
        x = np.linspace(np.log(low), np.log(high), self._settings.knots)
        if name == "low_pass":
            return x
        value = {n: self.nominal[n] * (np.exp(x) if n == name else here[n]) for n in FIELD}
        one = np.ones(len(x))
        inertia = value["rotor_inertia"] * one + (0.0 if bench.friction.elastic[j] else link)
        zeta = float(bench.friction.bristle_damping_ratio[j]) * one
        sigma1 = bristle_damping(value["presliding"] * one, zeta, inertia, 1e-3)
        # physics.md 3.5 asks for h·σ1/J < 2; less, as the arm's inertia is not the lone joint's
        return x[1e-3 * sigma1 < 1.6 * inertia]

    def shift(self, name: str, x: Array) -> Array:
        """Return (m, rows) change of the readings [N·m] from the state to log values x (m,)."""
        knots, table = self.knots[name], self.tables[name]
        at = np.interp(np.append(x, self._log(name)), knots, np.arange(len(knots)))
        tau = _between(table, at)
        return np.asarray(tau[:-1] - tau[-1])

    def level_shift(self, x: Array) -> Array:
        """Return (m, rows) change of the readings [N·m] for log factors x (m, rows) on friction."""
        levels, table = self.knots["friction_level"], self.tables["friction_level"]
        at = np.interp(x, levels, np.arange(len(levels)))
        i = np.minimum(at.astype(int), len(levels) - 2)
        t, column = at - i, np.arange(x.shape[1])
        tau = (1 - t) * table[i, column] + t * table[i + 1, column]
        return np.asarray(tau - table[len(levels) // 2])


def _between(table: Array, at: Array) -> Array:
    """Return (m, rows) of a table (knots, rows) at fractional knots (m,)."""
    i = np.minimum(at.astype(int), len(table) - 2)
    t = (at - i)[:, None]
    return np.asarray((1 - t) * table[i] + t * table[i + 1])
