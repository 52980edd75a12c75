"""Predicts one joint's dithered breakaway torques, with any set of effects, thousands at once."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.experiments.sje.poses import find_poses
from stiction_envs.experiments.sje.protocol import Configuration, Protocol, load_protocol
from stiction_envs.friction.lone_joint import LoneJoints, breakaway
from stiction_envs.friction.model import link_inertia
from stiction_envs.friction.parameters import FrictionParameters, bristle_damping
from stiction_envs.gap.tables.cells import Cell
from stiction_envs.measured import BaseTable
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
STIFF_BRISTLE = 1e4
"""What stands for no presliding [N·m/rad]: at 1 N·m it yields 0.1 mrad; the bound of 3.4."""
DUPONT_RATIO = 0.7169
"""Breakaway over steady deflection of the elasto-plastic example (Dupont et al. 2002, Table I)."""
STUCK = 3.0
"""Ramps end at this multiple of the largest friction [-]."""


@dataclass(frozen=True, kw_only=True)
class Effects:
    """Which physical statements a model makes."""

    presliding: bool = True
    """Bristles and Stribeck; without, a stiff band of one level."""
    path: bool = True
    """Low-pass, rate limit and hold of the robot's torque interface."""
    elasticity: bool = True
    """Springs where the nominal model has them."""
    load: bool = True
    """Friction of its own in each pose; without, the mean of both."""
    offset: bool = True
    """Half-sum of the base torques kept apart from friction; without, each direction's base
    torque is its friction."""
    drift: bool = True
    """One factor per configuration on its base between measuring days."""
    elasto_plastic: bool = False
    """No drift inside the band (Dupont et al. 2002), instead of LuGre."""

    def free(self, elastic: bool) -> tuple[str, ...]:
        """Return the parameters of a joint that these effects leave to be fitted."""
        names = ["rotor_inertia"]
        if self.presliding:
            names += ["bristle_stiffness", "coulomb_ratio", "stribeck_velocity"]
        if self.elasticity and elastic:
            names.append("joint_stiffness")
        return tuple(names)


@dataclass(frozen=True, kw_only=True)
class Bench:
    """All that a table was measured with, and the nominal model."""

    base: BaseTable
    friction: FrictionParameters
    """Nominal, of one arm; its levels are those that reproduce the base table."""
    level: Array
    """(n, 2) stiction in the load and the no-load pose [N·m]."""
    link: Array
    """(n, 2) link inertia in both poses [kg·m²]."""
    interface: TorqueInterface
    protocol: Protocol

    @classmethod
    def of(cls, arm: Arm, base: BaseTable, friction: FrictionParameters) -> Bench:
        """Return the bench of an arm with the poses of the experiment."""
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
            protocol=load_protocol(arm.name),
        )

    def replace(self, **changes: object) -> Bench:
        """Return a copy with some of it changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


class JointTables:
    """The cells of one joint, and how parameters predict their change of torque."""

    def __init__(
        self, joint: int, cells: Sequence[Cell], bench: Bench, effects: Effects | None = None
    ) -> None:
        """Set up; ``cells`` must be of ``joint`` (from 1)."""
        self.joint, self.cells, self.bench = joint, list(cells), bench
        self.effects = Effects() if effects is None else effects
        self.elastic = bool(bench.friction.elastic[joint - 1])
        self.names = self.effects.free(self.elastic)
        wheres = list(dict.fromkeys(c.configuration for c in self.cells))
        self._level = {w: self._of(w) for w in wheres}
        keys = {(*self._level[w], 0.0, 0.0) for w in wheres}
        keys |= {self._key(c) for c in self.cells}
        # joints that differ in nothing are simulated once
        self._columns = sorted(keys)
        self._at = {key: i for i, key in enumerate(self._columns)}

    def _of(self, where: Configuration) -> tuple[float, float]:
        """Return (stiction [N·m], link inertia [kg·m²]) of a configuration."""
        j, k, d = where.index
        b, e = self.bench, self.effects
        poses = slice(k, k + 1) if e.load else slice(None)
        level = float(b.level[j, poses].mean())
        if not e.offset:
            table = np.abs(b.base.tau[j, poses, d]).mean()
            level *= float(table / b.base.friction[j, poses].mean())
        return level, float(b.link[j, k])

    def _key(self, c: Cell) -> tuple[float, float, float, float]:
        return (*self._level[c.configuration], c.row.frequency_hz, c.row.amplitude_nm)

    def nominal(self, name: str) -> float:
        """Return the nominal value of a parameter."""
        b, j = self.bench, self.joint - 1
        if name == "ramp_rate":
            return b.protocol.ramp_rate
        if name == "lowpass_hz":
            return b.interface.lowpass_hz or np.inf
        return float(np.mean(getattr(b.friction, name)[j]))

    def torques(self, population: Sequence[Mapping[str, float]]) -> Array:
        """Return (population, columns) breakaway torque without offset [N·m].

        Args:
            population: parameters by name; what is not named is nominal.
        """
        b, e, j = self.bench, self.effects, self.joint - 1
        m = len(self._columns)
        level, link, frequency, amplitude = (
            np.tile(x, len(population)) for x in np.array(self._columns).T
        )

        def of(name: str) -> Array:
            return np.repeat([p.get(name, self.nominal(name)) for p in population], m)

        one = np.ones(len(level))
        rotor, bristle = of("rotor_inertia"), of("bristle_stiffness")
        ratio, spring = of("coulomb_ratio"), of("joint_stiffness")
        if not e.presliding:
            bristle, ratio = STIFF_BRISTLE * one, one
        if not e.elasticity:
            spring = np.inf * one
        elastic = np.isfinite(spring)
        carried = np.where(elastic, rotor, rotor + link)
        zeta = float(b.friction.bristle_damping_ratio[j])
        damped = np.where(elastic, spring, 0.0) * rotor
        lone = LoneJoints(
            stiction=level,
            coulomb_ratio=ratio,
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
            lowpass_hz=of("lowpass_hz") if e.path else np.inf * one,
            torque_rate=(b.interface.torque_rate[j] if e.path else np.inf) * one,
            breakaway_ratio=(DUPONT_RATIO if e.elasto_plastic else 0.0) * one,
        )
        tau = breakaway(
            lone,
            threshold=b.protocol.threshold,
            longest=STUCK * float(level.max()) / float(lone.ramp_rate.min()),
            hold=b.interface.hold_steps if e.path else 1,
        )
        return tau.reshape(len(population), m)

    def predict(self, population: Sequence[Mapping[str, float]]) -> Array:
        """Return (population, cells) predicted change |τ_SJE|/|τ_base| − 1 [-]; NaN: stuck."""
        tau = self.torques(population)
        out = np.empty((len(population), len(self.cells)))
        for i, c in enumerate(self.cells):
            j, k, d = c.configuration.index
            dithered, base = tau[:, self._at[self._key(c)]], None
            undithered = tau[:, self._at[(*self._level[c.configuration], 0.0, 0.0)]]
            if self.effects.offset:
                base = abs(self.bench.base.tau[j, k, d])
                out[:, i] = (dithered - undithered) / base
            else:
                out[:, i] = dithered / undithered - 1.0
        return out


def drift_factors(
    cells: Sequence[Cell], predicted: Array, used: Sequence[bool]
) -> dict[Configuration, float]:
    """Return one factor per configuration on its base between measuring days.

    The median over its cells of measured over predicted torque: a base that has moved shifts all
    its dithered torques alike, a single bad reading does not.

    Args:
        cells: measured.
        predicted: (cells,) change [-].
        used: which cells may be looked at.
    """
    ratio: dict[Configuration, list[float]] = {}
    for c, p, u in zip(cells, predicted, used, strict=True):
        if u:
            ratio.setdefault(c.configuration, []).append((1.0 + c.change) / (1.0 + p))
    return {k: float(np.median(v)) for k, v in ratio.items()}


def with_drift(cells: Sequence[Cell], predicted: Array) -> Array:
    """Return predictions (cells,) with the drift that the fitted cells show."""
    factor = drift_factors(cells, predicted, [not c.held_out for c in cells])
    return np.array(
        [factor[c.configuration] * (1 + p) - 1 for c, p in zip(cells, predicted, strict=True)]
    )
