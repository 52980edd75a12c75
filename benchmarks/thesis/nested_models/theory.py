"""`averaging` applied to the Panda's joints: what theory says of a fitted simulation."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.thesis.nested_models import averaging
from benchmarks.thesis.nested_models.averaging import Array, Complex, Value
from benchmarks.thesis.nested_models.fit import ROBOT
from stiction_envs.experiments.sje.protocol import Configuration
from stiction_envs.friction.parameters import bristle_damping, load_friction
from stiction_envs.gap.tables.lone_joint import Bench
from stiction_envs.measured import thesis_base
from stiction_envs.robots import load_arm

SCAN_HZ = (5.0, 120.0)
"""Where resonances are looked for [Hz]: a third of the thesis's lowest to 1.5 of its highest."""
THEORIES = ("sliding", "free", "creep", "slip")
"""Averaging with the speed reduced by friction, and not reduced; shaken bristles; bristles as a
spring."""


@functools.cache
def _bench() -> Bench:
    return Bench.of(load_arm(ROBOT), thesis_base(ROBOT), load_friction(ROBOT))


@dataclass(frozen=True, kw_only=True)
class JointTheory:
    """One joint of the Panda with the parameters of a model; a pose is 0 (load) or 1 (no load)."""

    joint: int
    """From 1."""
    parameters: Mapping[str, float]
    """By name; a joint without stiffness is rigid."""

    def parameter(self, name: str) -> float:
        """Return a parameter, SI units; the stiffness of a rigid joint is inf."""
        if name == "ramp_rate" and name not in self.parameters:
            return _bench().protocol.ramp_rate
        return float(self.parameters.get(name, np.inf))

    @property
    def elastic(self) -> bool:
        """Whether there is a spring between rotor and link."""
        return bool(np.isfinite(self.parameter("joint_stiffness")))

    def link(self, pose: int) -> float:
        """Return the link's inertia [kg·m²]."""
        return float(_bench().link[self.joint - 1, pose])

    def friction(self, pose: int) -> float:
        """Return half the difference of the two base torques, dry friction [N·m]."""
        return float(_bench().base.friction[self.joint - 1, pose])

    def impedance(self, frequency: Value, pose: int) -> Complex:
        """Return the impedance at the rotor [N·m·s/rad]."""
        ratio = float(_bench().friction.joint_damping_ratio[self.joint - 1])
        rotor, stiffness = self.parameter("rotor_inertia"), self.parameter("joint_stiffness")
        return averaging.impedance(
            frequency,
            rotor_inertia=rotor,
            link_inertia=self.link(pose),
            joint_stiffness=stiffness,
            joint_damping=2 * ratio * np.sqrt(stiffness * rotor) if self.elastic else 0.0,
        )

    def lowpass(self, frequency: Value) -> Array:
        """Return the gain of the robot's low-pass [-]."""
        return np.abs(averaging.lowpass(frequency, _bench().interface.lowpass_hz or np.inf))

    def bristle_gain(self, frequency: Value, pose: int) -> Array:
        """Return the bristles' torque over the dither commanded, while the joint sticks [-].

        On the bristles hangs the rotor, with the link if the joint is rigid.
        """
        friction = _bench().friction
        sigma0 = np.array([self.parameter("bristle_stiffness")])
        zeta = np.array([friction.bristle_damping_ratio[self.joint - 1]])
        inertia = self.parameter("rotor_inertia") + (0.0 if self.elastic else self.link(pose))
        sigma1 = bristle_damping(sigma0, zeta, np.array([inertia]), 1e-3)
        gain = averaging.presliding_gain(
            frequency,
            bristle_stiffness=float(sigma0[0]),
            bristle_damping=float(sigma1[0] + friction.viscous[self.joint - 1, 0]),
            impedance=self.impedance(frequency, pose),
        )
        return gain * self.lowpass(frequency)

    def resonances(self, pose: int) -> Array:
        """Return the frequencies [Hz] of the peaks of `bristle_gain` in `SCAN_HZ`."""
        f = np.geomspace(*SCAN_HZ, 800)
        g = self.bristle_gain(f, pose)
        return f[1:-1][(g[1:-1] > g[:-2]) & (g[1:-1] > g[2:])]

    def sticks(self, frequency: Value, amplitude: Value, pose: int) -> NDArray[np.bool_]:
        """Return whether the bristles' share of the dither is less than the friction."""
        return np.asarray(amplitude * self.bristle_gain(frequency, pose) < self.friction(pose))

    def change(
        self,
        kind: str,
        where: Configuration,
        frequency: Value,
        amplitude: Value,
    ) -> Array:
        """Return the change of torque over |τ_base| that a theory predicts [-].

        Friction is the half-difference of the base torques; what is left of them stays.

        Args:
            kind: of `THEORIES`.
            where: pose and direction.
            frequency: f [Hz].
            amplitude: A [N·m].
        """
        j, pose, d = where.index
        base, level = float(abs(_bench().base.tau[j, pose, d])), self.friction(pose)
        rate, threshold = self.parameter("ramp_rate"), _bench().protocol.threshold
        peak, drop = level, 0.0
        inertia = self.parameter("rotor_inertia") + self.link(pose)
        gain = self.bristle_gain(frequency, pose)
        if kind == "slip":
            return -np.minimum(amplitude * gain, level) / base
        if kind == "creep":
            sigma0, v_s = self.parameter("bristle_stiffness"), self.parameter("stribeck_velocity")
            coulomb = level * self.parameter("coulomb_ratio")
            speed = averaging.bristle_speed(amplitude, frequency, gain, sigma0)
            peak = averaging.ramp_peak(level, coulomb, v_s, sigma0, rate)
            drop = peak - coulomb
            # shaken or not, it lets go at the peak at the latest
            g = np.minimum(averaging.shaken_level(level, coulomb, v_s, speed), peak)
            torque = averaging.creep_breakaway(g, speed, rate, threshold, inertia, g - coulomb)
        else:
            drive, z = amplitude * self.lowpass(frequency), self.impedance(frequency, pose)
            speed = averaging.speed_amplitude(drive, z, level if kind == "sliding" else 0.0)
            torque = averaging.averaged_breakaway(level, speed, rate, threshold, inertia)
        undithered = peak + averaging.slide(inertia, rate, threshold, excess=drop)
        return (torque - undithered) / base
