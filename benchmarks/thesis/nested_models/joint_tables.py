"""Predicts one joint's dithered breakaway torques, with any set of effects, thousands at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.thesis.nested_models.cells import Cell
from stiction_envs.experiments.sje.protocol import Configuration
from stiction_envs.gap.tables.lone_joint import Bench, LoneJointTorques

Array = NDArray[np.float64]
STIFF_BRISTLE = 1e4
"""What stands for no presliding [N·m/rad]: at 1 N·m it yields 0.1 mrad; the bound of 3.4."""
DUPONT_RATIO = 0.7169
"""Breakaway over steady deflection of the elasto-plastic example (Dupont et al. 2002, Table I)."""


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

    def fixed(self) -> dict[str, float]:
        """Return the parameters of the lone joint that they set, whatever is fitted."""
        out = {"breakaway_ratio": DUPONT_RATIO} if self.elasto_plastic else {}
        if not self.presliding:
            out |= {"bristle_stiffness": STIFF_BRISTLE, "coulomb_ratio": 1.0}
        if not self.elasticity:
            out |= {"joint_stiffness": np.inf}
        return out if self.path else out | {"lowpass_hz": np.inf, "torque_rate": np.inf}


class JointTables(LoneJointTorques):
    """The cells of one joint, and how parameters predict their change of torque."""

    def __init__(
        self, joint: int, cells: Sequence[Cell], bench: Bench, effects: Effects | None = None
    ) -> None:
        """Set up; ``cells`` must be of ``joint`` (from 1)."""
        super().__init__(joint, bench)
        self.cells = list(cells)
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

    def torques(self, population: Sequence[Mapping[str, float]]) -> Array:
        """Return (population, columns) breakaway torque without offset [N·m].

        Args:
            population: parameters by name; what is not named is nominal.
        """
        fixed, hold = self.effects.fixed(), None if self.effects.path else 1
        return self.breakaway(self._columns, [{**p, **fixed} for p in population], hold)

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
