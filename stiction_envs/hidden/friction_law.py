"""The friction law in plain numpy: the reference for tests of the engine.

LuGre (Canudas de Wit, Olsson, Åström, Lischinsky 1995): a bristle of deflection z [rad] with

    g(v)  = F_c + (F_s − F_c) exp(−(v/v_s)²)                       [N·m]
    dz/dt = v − σ0 |v| z / g(v)                                    [rad/s]
    τ_f   = σ0 z + σ1 dz/dt + σ2 v                                 [N·m], opposes v

Levels may grow with the transmitted torque L: F_s(L) = F_s + k L, and F_c in the same ratio.
Nothing in this file imports MuJoCo.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array


@dataclass(frozen=True, kw_only=True)
class LuGre:
    """One law, or many at once: all fields broadcast against the velocity."""

    stiction: ArrayLike
    """F_s, stiction level [N·m]."""
    coulomb: ArrayLike
    """F_c, Coulomb level [N·m]."""
    stribeck_velocity: ArrayLike
    """v_s [rad/s]."""
    bristle_stiffness: ArrayLike
    """σ0 [N·m/rad]."""
    bristle_damping: ArrayLike
    """σ1 [N·m·s/rad]."""
    viscous: ArrayLike = 0.0
    """σ2 [N·m·s/rad]."""
    load_coefficient: ArrayLike = 0.0
    """Growth of F_s per N·m of transmitted torque [-]; F_c grows in the same ratio."""
    load: ArrayLike = 0.0
    """Transmitted torque L ≥ 0 [N·m]."""

    def level(self, v: ArrayLike) -> Array:
        """Return g(v), the friction level of steady sliding without viscous part [N·m]."""
        v = np.asarray(v, float)
        f_s, f_c = np.asarray(self.stiction, float), np.asarray(self.coulomb, float)
        growth = 1.0 + np.asarray(self.load_coefficient) * np.asarray(self.load) / f_s
        stribeck = np.exp(-((v / np.asarray(self.stribeck_velocity)) ** 2))
        return growth * (f_c + (f_s - f_c) * stribeck)

    def steady(self, v: ArrayLike) -> Array:
        """Return the torque of steady sliding at v, g(v) sign(v) + σ2 v [N·m]."""
        v = np.asarray(v, float)
        return self.level(v) * np.sign(v) + np.asarray(self.viscous) * v

    def bristle_rate(self, z: ArrayLike, v: ArrayLike) -> Array:
        """Return dz/dt [rad/s] at bristle deflection z [rad] and velocity v [rad/s]."""
        v = np.asarray(v, float)
        return v - np.asarray(self.bristle_stiffness) * np.abs(v) * z / self.level(v)

    def torque(self, z: ArrayLike, v: ArrayLike) -> Array:
        """Return the friction torque [N·m] that opposes v, at deflection z [rad]."""
        return (
            np.asarray(self.bristle_stiffness) * np.asarray(z)
            + np.asarray(self.bristle_damping) * self.bristle_rate(z, v)
            + np.asarray(self.viscous) * np.asarray(v)
        )

    def advance(self, z: ArrayLike, v: ArrayLike, dt: float) -> Array:
        """Return z after dt [s] at constant v: the exact solution of the bristle equation."""
        z, v = np.asarray(z, float), np.asarray(v, float)
        a = -np.asarray(self.bristle_stiffness) * np.abs(v) / self.level(v)
        gain = np.where(np.abs(a) > 1e-12, np.expm1(a * dt) / np.where(a == 0, 1.0, a), dt)
        return np.exp(a * dt) * z + gain * v
