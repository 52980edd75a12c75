"""`friction.averaging` applied to the Panda's joints: what theory says of a fitted simulation."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.thesis.nested_models import averaging
from benchmarks.thesis.nested_models.fit import ROBOT, prior
from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.errors import unknown
from stiction_envs.experiments.sje.poses import find_poses
from stiction_envs.experiments.sje.protocol import Configuration, load_protocol
from stiction_envs.friction.model import link_inertia
from stiction_envs.friction.parameters import FrictionParameters, bristle_damping, load_friction
from stiction_envs.measured import thesis_base
from stiction_envs.robots import load_arm

Array = NDArray[np.float64]
SCAN_HZ = (5.0, 120.0)
"""Where resonances are looked for [Hz]: a third of the thesis's lowest to 1.5 of its highest."""
THEORIES = ("sliding", "free", "creep", "slip", "band")
"""Averaging with the speed reduced by friction, and not reduced; shaken bristles; bristles as a
spring; a band."""


@functools.lru_cache
def _nominal() -> FrictionParameters:
    """Return the arm's friction; damping ratios and viscous friction are taken from it."""
    return load_friction(ROBOT)


@functools.lru_cache
def _cutoff() -> float:
    """Return the cut-off of the robot's low-pass [Hz], inf if it has none."""
    return TorqueInterface.of(load_arm(ROBOT)).lowpass_hz or np.inf


@functools.lru_cache
def poses_of(robot: str) -> tuple[Array, Array]:
    """Return (signed load [N·m], link inertia [kg·m²]) of every joint in both poses, (n, 2)."""
    arm = load_arm(robot)
    poses = find_poses(arm)
    one = np.arange(arm.n)
    link = [link_inertia(arm, poses.q[:, k])[one, one] for k in range(2)]
    return poses.signed, np.stack(link, axis=1)


@dataclass(frozen=True, kw_only=True)
class JointTheory:
    """One joint of the Panda with the parameters of a model; a pose is 0 (load) or 1 (no load)."""

    joint: int
    """From 1."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """By name; what is not named is the prior's centre, a joint without stiffness rigid."""

    def parameter(self, name: str) -> float:
        """Return a parameter, SI units; the stiffness of a rigid joint is inf."""
        if name in self.parameters:
            return float(self.parameters[name])
        if name == "joint_stiffness":
            return np.inf
        return load_protocol(ROBOT).ramp_rate if name == "ramp_rate" else prior(name, self.joint)

    @property
    def rotor(self) -> float:
        """Rotor inertia [kg·m²]."""
        return self.parameter("rotor_inertia")

    @property
    def elastic(self) -> bool:
        """Whether there is a spring between rotor and link."""
        return bool(np.isfinite(self.parameter("joint_stiffness")))

    def link(self, pose: int) -> float:
        """Return the link's inertia [kg·m²]."""
        return float(poses_of(ROBOT)[1][self.joint - 1, pose])

    def friction(self, pose: int) -> float:
        """Return half the difference of the two base torques, dry friction [N·m]."""
        return float(thesis_base(ROBOT).friction[self.joint - 1, pose])

    def on_bristles(self, pose: int) -> float:
        """Return the inertia that hangs on the bristles: the rotor, with the link if rigid."""
        return self.rotor + (0.0 if self.elastic else self.link(pose))

    def impedance(self, frequency: ArrayLike, pose: int) -> averaging.Complex:
        """Return the impedance at the rotor [N·m·s/rad]."""
        ratio = float(_nominal().joint_damping_ratio[self.joint - 1])
        stiffness = self.parameter("joint_stiffness")
        damping = 2 * ratio * np.sqrt(stiffness * self.rotor) if self.elastic else 0.0
        return averaging.impedance(
            frequency,
            rotor_inertia=self.rotor,
            link_inertia=self.link(pose),
            joint_stiffness=stiffness,
            joint_damping=damping,
        )

    def drive(self, frequency: ArrayLike, amplitude: ArrayLike) -> Array:
        """Return what the robot's low-pass leaves of a sine's amplitude [N·m]."""
        return np.asarray(amplitude, float) * np.abs(averaging.lowpass(frequency, _cutoff()))

    def bristle_gain(self, frequency: ArrayLike, pose: int) -> Array:
        """Return the bristles' torque over the dither commanded, while the joint sticks [-]."""
        friction = _nominal()
        sigma0 = np.array([self.parameter("bristle_stiffness")])
        zeta = np.array([friction.bristle_damping_ratio[self.joint - 1]])
        inertia = np.array([self.on_bristles(pose)])
        sigma1 = float(bristle_damping(sigma0, zeta, inertia, 1e-3)[0])
        gain = averaging.presliding_gain(
            frequency,
            bristle_stiffness=sigma0[0],
            bristle_damping=sigma1 + friction.viscous[self.joint - 1, 0],
            impedance=self.impedance(frequency, pose),
        )
        return np.asarray(gain * np.abs(averaging.lowpass(frequency, _cutoff())))

    def resonances(self, pose: int) -> list[tuple[float, float]]:
        """Return (f [Hz], gain [-]) of the peaks of `bristle_gain` between 5 and 120 Hz."""
        f = np.geomspace(*SCAN_HZ, 800)
        g = self.bristle_gain(f, pose)
        peak = np.flatnonzero((g[1:-1] > g[:-2]) & (g[1:-1] > g[2:])) + 1
        return [(float(f[k]), float(g[k])) for k in peak]

    def stroke(self, frequency: ArrayLike, amplitude: ArrayLike, pose: int) -> Array:
        """Return the rotor's peak-to-peak motion if nothing held it, 2A/(ω|Z|) [rad]."""
        drive = self.drive(frequency, amplitude)
        speed = averaging.speed_amplitude(drive, self.impedance(frequency, pose))
        return 2 * speed / (2 * np.pi * np.asarray(frequency, float))

    def peak(self, level: float) -> float:
        """Return the torque at which a joint of F_s = level [N·m] lets go without dither [N·m]."""
        ratio, v_s = self.parameter("coulomb_ratio"), self.parameter("stribeck_velocity")
        sigma0, rate = self.parameter("bristle_stiffness"), self.parameter("ramp_rate")
        return float(averaging.ramp_peak(level, ratio * level, v_s, sigma0, rate))

    def step(self) -> float:
        """Return kinetic friction over the peak without dither, less 1 [-].

        What shaking faster than the Stribeck velocity takes, at any frequency; of the load pose.
        """
        level = self.friction(0)
        return self.parameter("coulomb_ratio") * level / self.peak(level) - 1.0

    def shaking(self, frequency: ArrayLike, amplitude: ArrayLike, pose: int) -> Array:
        """Return the rotor's peak speed while it sticks and is shaken [rad/s]."""
        gain = self.bristle_gain(frequency, pose)
        stiffness = self.parameter("bristle_stiffness")
        return averaging.bristle_speed(amplitude, frequency, gain, stiffness)

    def sticks(self, frequency: ArrayLike, amplitude: ArrayLike, pose: int) -> NDArray[np.bool_]:
        """Return whether the bristles' share of the dither is less than the friction."""
        reach = np.asarray(amplitude, float) * self.bristle_gain(frequency, pose)
        return np.asarray(reach < self.friction(pose))

    def change(
        self,
        kind: str,
        where: Configuration,
        frequency: ArrayLike,
        amplitude: ArrayLike,
        *,
        bias: bool = True,
    ) -> Array:
        """Return the change of torque over |τ_base| that a theory predicts [-].

        Args:
            kind: of `THEORIES`.
            where: pose and direction.
            frequency: f [Hz].
            amplitude: A [N·m].
            bias: whether friction is the half-difference of the base torques, and what is left of
                them stays; else each direction's base torque, mean of both poses, is friction.

        Raises:
            StictionError: an unknown theory.
        """
        j, pose, d = where.index
        table = np.abs(thesis_base(ROBOT).tau[j, :, d])
        base, level = float(table[pose]), self.friction(pose)
        if not bias:
            base = level = float(table.mean())
        rate, threshold = self.parameter("ramp_rate"), load_protocol(ROBOT).threshold
        inertia = self.rotor + self.link(pose)
        peak, drop = level, 0.0
        if kind in ("sliding", "free"):
            load = level if kind == "sliding" else 0.0
            impedance = self.impedance(frequency, pose)
            speed = averaging.speed_amplitude(self.drive(frequency, amplitude), impedance, load)
            torque = averaging.averaged_breakaway(level, speed, rate, threshold, inertia)
        elif kind == "creep":
            speed = self.shaking(frequency, amplitude, pose)
            coulomb = level * self.parameter("coulomb_ratio")
            peak = self.peak(level)
            drop = peak - coulomb
            # shaken or not, it lets go at the peak at the latest
            v_s = self.parameter("stribeck_velocity")
            g = np.minimum(averaging.shaken_level(level, coulomb, v_s, speed), peak)
            torque = averaging.creep_breakaway(g, speed, rate, threshold, inertia, g - coulomb)
        elif kind == "slip":
            gain = self.bristle_gain(frequency, pose)
            return np.asarray((averaging.bristle_breakaway(level, amplitude, gain) - level) / base)
        elif kind == "band":
            drive = np.add(amplitude, 0 * np.asarray(frequency))
            return np.asarray((averaging.band_breakaway(level, drive) - level) / base)
        else:
            raise unknown("theory", kind, THEORIES)
        undithered = peak + averaging.slide(inertia, rate, threshold, excess=drop)
        return np.asarray((torque - undithered) / base, dtype=np.float64)
