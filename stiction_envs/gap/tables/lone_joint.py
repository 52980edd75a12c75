"""How the readings of a joint change with its parameters, from fast simulations of a lone joint.

The prediction is the whole arm's (`WholeArm`) in the last simulated state x₀. The lone joint
predicts changes from there:

    W(x) ≈ W(x₀) + lone(x) − lone(x₀)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.protocol import Job
from stiction_envs.friction.lone_joint import LoneJoints, breakaway
from stiction_envs.friction.parameters import bristle_damping
from stiction_envs.gap.tables.whole_arm import FRICTION_LEVEL, Quantity, State, WholeArm
from stiction_envs.plant import CONTROL_DT

Array = NDArray[np.float64]
Column = tuple[float, float, float, float]
"""(stiction, link inertia, dither frequency, amplitude)."""
KNOTS = 21
"""Number of values of a quantity at which the lone joint is simulated; assumed."""
LEVEL_KNOTS = 9
"""The same of the friction level; assumed."""
STUCK = 3.0
"""Torque at which ramps end, over the largest friction [-]; assumed."""
FREE = (
    *("coulomb_ratio", "stribeck_velocity", "bristle_stiffness", "viscous", "rotor_inertia"),
    *("joint_stiffness", "ramp_rate", "lowpass_hz", "torque_rate", "breakaway_ratio"),
)
"""Parameters of a lone joint that may have other than nominal values."""
STABLE = 1.6
"""Largest h·σ1/J with which a bristle counts as stable [-]; assumed: the limit is 2 (sources.md
3.5), and the arm's inertia is not the lone joint's."""


class LoneJointTorques:
    """Breakaway torques of a lone joint at any levels, by fast simulation."""

    def __init__(self, joint: int, whole: WholeArm) -> None:
        """Take a joint (from 1) of the nominal arm."""
        self.joint, self.whole = joint, whole
        self._zeta = float(whole.friction.bristle_damping_ratio[joint - 1])

    def nominal(self, name: str) -> float:
        """Return the nominal value of a parameter."""
        w, j = self.whole, self.joint - 1
        of_experiment = {
            "ramp_rate": w.protocol.ramp_rate,
            "torque_rate": float(w.interface.torque_rate[j]),
            "breakaway_ratio": 0.0,
            "lowpass_hz": w.interface.lowpass_hz or np.inf,
        }
        if name in of_experiment:
            return of_experiment[name]
        return float(np.mean(getattr(w.friction, name)[j]))

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
        level, link, frequency, amplitude = np.tile(np.array(columns).T, len(population))
        p = {
            name: np.repeat([x.get(name, self.nominal(name)) for x in population], len(columns))
            for name in FREE
        }
        rotor, spring = p["rotor_inertia"], p["joint_stiffness"]
        elastic = np.isfinite(spring)
        carried = np.where(elastic, rotor, rotor + link)
        damped = np.where(elastic, spring, 0.0) * rotor
        damping = self.whole.friction.joint_damping_ratio[self.joint - 1]
        zeta = np.full(len(level), self._zeta)
        lone = LoneJoints(
            stiction=level,
            bristle_damping=bristle_damping(p["bristle_stiffness"], zeta, carried, CONTROL_DT),
            joint_damping=2 * damping * np.sqrt(damped),
            link_inertia=link,
            amplitude=amplitude,
            frequency=frequency,
            **p,
        )
        tau = breakaway(
            lone,
            threshold=self.whole.protocol.threshold,
            longest=STUCK * float(level.max()) / float(lone.ramp_rate.min()),
            hold=self.whole.interface.hold_steps if hold is None else hold,
        )
        return tau.reshape(len(population), len(columns))

    def readings(self, keys: Sequence[Column], population: Sequence[Mapping[str, float]]) -> Array:
        """Return (population, keys) breakaway torque [N·m]; a stuck joint reads far too much."""
        columns = sorted(set(keys))
        tau = self.breakaway(columns, population)[:, [columns.index(key) for key in keys]]
        return np.where(np.isfinite(tau), tau, 4.0 * max(key[0] for key in columns))

    def of(self, values: Mapping[Quantity, float]) -> dict[str, float]:
        """Return parameters by name for the values of some quantities."""
        out: dict[str, float] = {}
        for q, x in values.items():
            for f in q.fields:
                out[f] = x if q.of_interface else out.get(f, self.nominal(f)) * x
        return out

    def holds(self, p: Mapping[str, float], link: float) -> bool:
        """Return whether the bristle is stable, given parameters and link inertia [kg·m²]."""
        carried = p.get("rotor_inertia", self.nominal("rotor_inertia")) + link
        stiffness = p.get("bristle_stiffness", self.nominal("bristle_stiffness"))
        zeta, one = np.array([self._zeta]), np.ones(1)
        damping = bristle_damping(stiffness * one, zeta, carried * one, CONTROL_DT)
        return bool(CONTROL_DT * damping[0] < STABLE * carried)


class LoneJoint:
    """How the readings of a joint change with each quantity, about one state."""

    def __init__(
        self, jobs: Sequence[Job], whole: WholeArm, state: State, quantities: Sequence[Quantity]
    ) -> None:
        """Simulate the lone joint.

        Args:
            jobs: jobs of one joint.
            whole: the nominal arm.
            state: state of the joint.
            quantities: what to vary, besides the friction level.
        """
        joint = jobs[0].configuration.joint
        torques, places = LoneJointTorques(joint, whole), [x.configuration.index[:2] for x in jobs]
        keys: list[Column] = [
            (float(whole.level[at]), float(whole.link[at]), x.frequency_hz, x.amplitude_nm)
            for x, at in zip(jobs, places, strict=True)
        ]
        here = {q: whole.value(state, q) for q in quantities}
        link = 0.0 if whole.friction.elastic[joint - 1] else min(key[1] for key in keys)
        self._tables: dict[Quantity, tuple[Array, Array]] = {}
        for q in quantities:
            every = np.linspace(np.log(q.low), np.log(q.high), KNOTS).tolist()
            some = {x: torques.of({**here, q: float(np.exp(x))}) for x in every}
            if not q.of_interface:  # values with which the bristle chatters are left out
                some = {x: p for x, p in some.items() if torques.holds(p, link)}
            self._tables[q] = np.array(list(some)), torques.readings(keys, list(some.values()))
        levels = np.linspace(np.log(FRICTION_LEVEL.low), np.log(FRICTION_LEVEL.high), LEVEL_KNOTS)
        scaled = [(f * key[0], *key[1:]) for f in np.exp(levels).tolist() for key in keys]
        flat = torques.readings(scaled, [torques.of(here)])
        self._tables[FRICTION_LEVEL] = levels, flat.reshape(len(levels), -1)
        self._here = {q: self._at(q, np.log(whole.value(state, q))) for q in self._tables}

    def ends(self, q: Quantity) -> tuple[float, float]:
        """Return the logarithms between which a quantity is simulated."""
        return float(self._tables[q][0][0]), float(self._tables[q][0][-1])

    def _at(self, q: Quantity, log: Array | float) -> Array:
        """Return (rows,) readings, interpolated at the logarithm of a value, one or (rows,)."""
        knots, table = self._tables[q]
        at = np.interp(log, knots, np.arange(len(knots)))
        i = np.minimum(at.astype(int), len(table) - 2)
        t, row = at - i, np.arange(table.shape[1])
        return np.asarray((1 - t) * table[i, row] + t * table[i + 1, row])

    def shift(self, q: Quantity, log: Array | float) -> Array:
        """Return (rows,) change of the readings [N·m] from the state.

        Args:
            q: one of the quantities, or the friction level.
            log: logarithm of its value, one or (rows,).
        """
        return self._at(q, log) - self._here[q]
