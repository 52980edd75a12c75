"""How the readings of a joint change with its parameters, from fast simulations of a lone joint.

The prediction is the whole arm's (`WholeArm`) in the last simulated state x₀. The lone joint
predicts changes from there:

    W(x) ≈ W(x₀) + lone(x) − lone(x₀)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.experiments.sje.poses import find_poses
from stiction_envs.experiments.sje.protocol import Job, Protocol, load_protocol
from stiction_envs.friction.lone_joint import LoneJoints, breakaway
from stiction_envs.friction.model import link_inertia
from stiction_envs.friction.parameters import FrictionParameters, bristle_damping
from stiction_envs.gap.tables.whole_arm import (
    FRICTION_LEVEL,
    Quantity,
    State,
    WholeArm,
)
from stiction_envs.measured import BaseTable
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Column = tuple[float, float, float, float]
"""(stiction, link inertia, dither frequency, amplitude)."""
KNOTS = 21
"""Number of values of a quantity at which the lone joint is simulated; assumed."""
LEVEL_KNOTS = 9
"""The same of the friction level; assumed."""
STUCK = 3.0
"""Torque at which ramps end, over the largest friction [-]; assumed."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """The conditions under which a table was measured, and the nominal model."""

    base: BaseTable
    friction: FrictionParameters
    """Nominal friction of one arm; its levels reproduce the base table."""
    level: Array
    """(n, 2) stiction in the load and the no-load pose [N·m]."""
    link: Array
    """(n, 2) link inertia in both poses [kg·m²]."""
    interface: TorqueInterface
    protocol: Protocol

    @classmethod
    def of(
        cls,
        arm: Arm,
        base: BaseTable,
        friction: FrictionParameters,
        protocol: Protocol | None = None,
    ) -> Bench:
        """Return the bench of an arm in the poses of the experiment; None for its protocol."""
        poses = find_poses(arm)
        n = arm.n
        level = [friction.stiction_at(poses.load[:, k]).mean(axis=1) for k in range(2)]
        link = [link_inertia(arm, poses.q[:, k])[np.arange(n), np.arange(n)] for k in range(2)]
        return cls(
            base=base,
            friction=friction,
            level=np.stack(level, axis=1),
            link=np.stack(link, axis=1),
            interface=TorqueInterface.of(arm),
            protocol=load_protocol(arm.registered_name) if protocol is None else protocol,
        )


class LoneJointTorques:
    """Breakaway torques of a lone joint at any levels, by fast simulation."""

    def __init__(self, joint: int, bench: Bench) -> None:
        self.joint, self.bench = joint, bench

    def nominal(self, name: str) -> float:
        """Return the nominal value of a parameter."""
        b, j = self.bench, self.joint - 1
        if name == "ramp_rate":
            return b.protocol.ramp_rate
        if name == "torque_rate":
            return float(b.interface.torque_rate[j])
        if name == "breakaway_ratio":
            return 0.0
        if name == "lowpass_hz":
            return b.interface.lowpass_hz or np.inf
        return float(np.mean(getattr(b.friction, name)[j]))

    def breakaway(
        self,
        columns: Sequence[Column],
        population: Sequence[Mapping[str, float]],
        hold: int | None = None,
    ) -> Array:
        """Return (population, columns) breakaway torque without offset [N·m].

        Args:
            columns: what to simulate.
            population: parameters by name; others are nominal.
            hold: number of steps for which a commanded torque is held; None for the torque
                interface's.
        """
        b, j = self.bench, self.joint - 1
        m = len(columns)
        level, link, frequency, amplitude = (
            np.tile(x, len(population)) for x in np.array(columns).T
        )

        def of(name: str) -> Array:
            return np.repeat([p.get(name, self.nominal(name)) for p in population], m)

        one = np.ones(len(level))
        rotor, bristle, spring = (
            of(x) for x in ("rotor_inertia", "bristle_stiffness", "joint_stiffness")
        )
        elastic = np.isfinite(spring)
        carried = np.where(elastic, rotor, rotor + link)
        zeta = float(b.friction.bristle_damping_ratio[j])
        damped = np.where(elastic, spring, 0.0) * rotor
        lone = LoneJoints(
            stiction=level,
            coulomb_ratio=of("coulomb_ratio"),
            stribeck_velocity=of("stribeck_velocity"),
            bristle_stiffness=bristle,
            bristle_damping=bristle_damping(bristle, zeta * one, carried, 1e-3),
            viscous=of("viscous"),
            rotor_inertia=rotor,
            joint_stiffness=spring,
            joint_damping=2 * b.friction.joint_damping_ratio[j] * np.sqrt(damped),
            link_inertia=link,
            amplitude=amplitude,
            frequency=frequency,
            ramp_rate=of("ramp_rate"),
            lowpass_hz=of("lowpass_hz"),
            torque_rate=of("torque_rate"),
            breakaway_ratio=of("breakaway_ratio"),
        )
        tau = breakaway(
            lone,
            threshold=b.protocol.threshold,
            longest=STUCK * float(level.max()) / float(lone.ramp_rate.min()),
            hold=b.interface.hold_steps if hold is None else hold,
        )
        return tau.reshape(len(population), m)

    def readings(self, keys: Sequence[Column], population: Sequence[Mapping[str, float]]) -> Array:
        """Return (population, keys) breakaway torque [N·m]; a stuck joint reads far too much."""
        columns = sorted(set(keys))
        at = {key: i for i, key in enumerate(columns)}
        tau = self.breakaway(columns, population)[:, [at[key] for key in keys]]
        return np.where(np.isfinite(tau), tau, 4.0 * max(key[0] for key in columns))


class LoneJoint:
    """How the readings of a joint change with each quantity, about one state."""

    def __init__(
        self,
        jobs: Sequence[Job],
        bench: Bench,
        whole: WholeArm,
        state: State,
        quantities: Sequence[Quantity],
    ) -> None:
        """Simulate the lone joint.

        Args:
            jobs: jobs of one joint.
            bench: bench of the nominal arm.
            whole: the nominal arm.
            state: state of the joint.
            quantities: what to vary, besides the friction level.
        """
        self.state, self.whole = state, whole
        joint = jobs[0].configuration.joint
        j, poses = joint - 1, [job.configuration.index[1] for job in jobs]
        keys: list[Column] = [
            (float(bench.level[j, k]), float(bench.link[j, k]), job.frequency_hz, job.amplitude_nm)
            for job, k in zip(jobs, poses, strict=True)
        ]
        columns = LoneJointTorques(joint, bench)
        here = {q: whole.value(state, q) for q in quantities}
        link = 0.0 if bench.friction.elastic[j] else min(key[1] for key in keys)
        zeta = float(bench.friction.bristle_damping_ratio[j])
        self.knots: dict[Quantity, Array] = {}
        self.tables: dict[Quantity, Array] = {}
        for q in quantities:
            x = np.linspace(np.log(q.low), np.log(q.high), KNOTS)
            # values with which the bristle chatters are left out
            self.knots[q] = np.array(
                [v for v in x.tolist()
                 if q.of_interface
                 or _holds(_parameters(columns, {**here, q: np.exp(v)}), columns, link, zeta)]
            )  # fmt: skip
        population = [here]
        population += [{**here, q: float(np.exp(x))} for q in quantities for x in self.knots[q]]
        tau = columns.readings(keys, [_parameters(columns, p) for p in population])
        first = 1
        for q, knots in self.knots.items():
            self.tables[q] = tau[first : first + len(knots)]
            first += len(knots)
        levels = np.log(np.geomspace(FRICTION_LEVEL.low, FRICTION_LEVEL.high, LEVEL_KNOTS))
        scaled = [(f * key[0], *key[1:]) for f in np.exp(levels).tolist() for key in keys]
        flat = columns.readings(scaled, [_parameters(columns, here)])
        self.knots[FRICTION_LEVEL] = levels
        self.tables[FRICTION_LEVEL] = flat.reshape(len(levels), -1)

    def _log(self, q: Quantity, state: State) -> float:
        """Return the logarithm of a value of a state, within the simulated range."""
        knots = self.knots[q]
        return float(np.clip(np.log(self.whole.value(state, q)), knots[0], knots[-1]))

    def shift(self, q: Quantity, x: Array | float) -> Array:
        """Return (rows,) change of the readings [N·m] from the state.

        Args:
            q: one of the quantities, or the friction level.
            x: logarithm of its value, one or (rows,).
        """
        there, before = (
            _between(self.knots[q], self.tables[q], v) for v in (x, self._log(q, self.state))
        )
        return there - before


def _parameters(columns: LoneJointTorques, values: Mapping[Quantity, float]) -> dict[str, float]:
    """Return parameters of the lone joint by name."""
    out: dict[str, float] = {}
    for q, x in values.items():
        for f in q.fields:
            out[f] = x if q.of_interface else out.get(f, columns.nominal(f)) * x
    return out


def _holds(p: Mapping[str, float], columns: LoneJointTorques, link: float, zeta: float) -> bool:
    """Whether the bristle of a joint is stable with a step of 1 ms.

    The limit of h·σ1/J is 2 (sources.md 3.5); 1.6 is assumed, because the arm's inertia is not the
    lone joint's.
    """
    rotor, stiffness = (
        np.array([p.get(f, columns.nominal(f))]) for f in ("rotor_inertia", "bristle_stiffness")
    )
    sigma1 = bristle_damping(stiffness, np.array([zeta]), rotor + link, 1e-3)
    return bool(1e-3 * sigma1[0] < 1.6 * (rotor + link)[0])


def _between(knots: Array, table: Array, x: Array | float) -> Array:
    """Return (rows,) of a table (knots, rows), interpolated at x, one or (rows,)."""
    at = np.interp(x, knots, np.arange(len(knots)))
    i = np.minimum(at.astype(int), len(table) - 2)
    t, row = at - i, np.arange(table.shape[1])
    return np.asarray((1 - t) * table[i, row] + t * table[i + 1, row])
