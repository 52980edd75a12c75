"""A mass at the tip that the model lacks: proposed by a regression, accepted if causes get fewer.

A body at the flange sags all joints under gravity, each as a softer servo would. One regression
over all joints of the servos' torques K (q_cmd − q) on the torques of such a body, with friction,
lag, and links a little off as nuisances, proposes its mass and centre. It is named only where the
joints with it leave less error or need fewer causes than without (`explains_better`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from stiction_envs.gap.causes.body.bodies import from_flange, sphere
from stiction_envs.gap.causes.body.payload import Payload
from stiction_envs.gap.causes.draft import Part
from stiction_envs.gap.judge.judgement import Estimate
from stiction_envs.gap.servo.choose import JointCauses, count_named, criterion
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.motion import CUTOFF_HZ
from stiction_envs.gap.servo.parameters import INDEX
from stiction_envs.gap.signals.prepare import lowpass
from stiction_envs.robots import Arm
from stiction_envs.robots.regressor import torque_regressor

Array = NDArray[np.float64]
ROW_SECONDS = 0.1
"""Time between the rows of the regression [s]; assumed."""
BLOCK_SECONDS = 4.0
"""Blocks of time whose scatter gives the interval [s]; assumed."""
SLOW = 0.02
"""Speed at which dry friction is nearly its level [rad/s]; assumed."""
LINKS_OFF = 0.08
"""Usual error of a joint's gravity because links are a little off [-]; assumed."""
ZERO_OFF = 0.02
"""Usual error of a joint's zero [rad]; assumed."""
USUAL_MASS = 2.0
"""Usual mass that is not in the model [kg]; assumed."""
ROUNDS = 4
"""Rounds of weighing the joints by their error; assumed."""
REACH = 0.1
"""Usual distance of its centre from the flange [m]; assumed."""
LEAST_T = 3.0
"""Least mass over its standard error to be tried [-]; assumed."""
ACTS = 0.1
"""Least gravity of the body on a joint that it is named on, over its largest [-]; assumed."""
LOADED = 0.2
"""Least gravity of a loaded joint over that of the most loaded one [-]; assumed."""
LEAST_SHARE = 0.3
"""Gravity of the body over a loaded joint's own [-] below which it must spare causes; assumed,
twice links_off of the selection."""
BODY_PARAMETERS = 4
"""Parameters of a body, each as dear as a cause [-]; mass and three coordinates."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tip:
    """A body at the flange."""

    mass: float
    """[kg]."""
    com: Array
    """(3,) centre of mass in the flange's frame [m]."""
    mass_ci95: tuple[float, float]
    """[kg]."""
    com_ci95: tuple[Array, Array]
    """Lower and upper ends [m]."""
    torque: Array
    """(n,) root mean square of its gravity on each joint [N·m]."""
    share: float
    """Largest share of it in the own gravity of a loaded joint [-]."""

    @property
    def parameters(self) -> dict[str, Estimate]:
        """As in ``diagnosis.json``."""
        axes = [[float(a), float(b)] for a, b in zip(*self.com_ci95, strict=True)]
        return {
            "mass_kg": Estimate(value=self.mass, ci95=self.mass_ci95, on_bound=False),
            "com_m": Estimate(value=self.com.tolist(), ci95=axes, on_bound=False),
        }

    def part(self, level: int) -> Part:
        """Return the cause of ``model.toml``, found by a diagnosis of this number."""
        phi = tuple(float(x) for x in sphere(self.mass, self.com))
        return Part(cause=Payload.name, joint=0, shape=(), coefficients=phi, level=level)


def proposed(
    arm: Arm,
    motions: Sequence[JointMotion],
    nominal: Array,
    rows: NDArray[np.bool_],
    *,
    shifted: Sequence[int] = (),
) -> Tip | None:
    """Return the body at the flange that the servos' torques suggest; None if there is none.

    Args:
        arm: the rigid arm.
        motions: of its joints.
        nominal: (n, P) parameters of the simulation that is judged; the servos' stiffness is known.
        rows: (T,) without contact.
        shifted: joints (from 0) whose zero seems to be off.
    """
    every = motions[0].rows_in(ROW_SECONDS)
    kept = np.flatnonzero(rows)[::every]
    q = np.stack([m.q[kept] for m in motions], axis=1)
    body = gravity_of_tip(arm, q)
    blocks = (motions[0].t[kept] // BLOCK_SECONDS).astype(int)
    _, block = np.unique(blocks, return_inverse=True)
    parts = []
    for j, (m, p) in enumerate(zip(motions, nominal, strict=True)):
        torque, nuisance, prior = _residual(m, p, kept)
        if j in shifted:
            prior[-1] = np.inf
        parts.append(_without(torque, nuisance, prior, body[:, j]))
    torque = np.concatenate([part[0] for part in parts])
    columns = np.concatenate([part[1] for part in parts])
    joint, block = np.repeat(np.arange(arm.n), len(kept)), np.tile(block, arm.n)
    unit = np.diag(1.0 / np.array([1.0, *[REACH] * 3]) ** 2) / USUAL_MASS**2
    found = np.zeros(4)
    for _ in range(ROUNDS):  # joints weigh by what the body leaves on them
        left = (torque - columns @ found) ** 2
        weight = 1.0 / np.maximum(np.bincount(joint, weights=left) / len(kept), 1e-12)[joint]
        inverse = np.linalg.pinv(columns.T @ (weight[:, None] * columns) + unit)
        found = inverse @ (columns.T @ (weight * torque))
    error = weight * (torque - columns @ found)
    by_block = np.stack([np.bincount(block, weights=x * error) for x in columns.T])
    spread = by_block @ by_block.T
    for j, (_, _, likely) in enumerate(parts):  # links that are off err the same way everywhere
        mine = joint == j
        error = columns[mine].T @ (weight[mine, None] * likely)
        spread += error @ error.T
    covariance = inverse @ spread @ inverse
    variance = np.diag(covariance)  # rounding may leave less than none where nothing is shown
    deviation = np.sqrt(np.where(variance > 0, variance, np.inf))
    mass, moment = float(found[0]), found[1:]
    torque_of_it = np.sqrt(np.mean((body @ found) ** 2, axis=0))
    own = np.array([np.sqrt(np.mean(m.gravity[kept] ** 2)) for m in motions])
    loaded = own > LOADED * own.max()
    if not 0 < mass >= LEAST_T * deviation[0]:  # nuisances may leave nothing of it
        return None
    quantile = float(student.ppf(0.975, max(1, by_block.shape[1] - 4)))
    com, wide = moment / mass, quantile * deviation[1:] / mass
    return Tip(
        mass=mass,
        com=com,
        mass_ci95=(
            mass - quantile * float(deviation[0]),
            mass + quantile * float(deviation[0]),
        ),
        com_ci95=(com - wide, com + wide),
        torque=torque_of_it,
        share=float((torque_of_it / np.maximum(own, 1e-12))[loaded].max()),
    )


def explains_better(
    tip: Tip,
    without: Mapping[int, JointCauses],
    with_it: Mapping[int, JointCauses],
) -> bool:
    """Return whether a body at the flange explains the joints better than their own causes.

    A small body must also save causes: links that are a little off look like one.
    """
    if tip.share < LEAST_SHARE and count_named(with_it) >= count_named(without):
        return False
    return criterion(with_it, BODY_PARAMETERS) < criterion(without)


def _residual(motion: JointMotion, p: Array, kept: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Return what the servo's torque leaves [N·m], (R, N) nuisances, and their (N,) priors.

    A prior is a standard deviation of the coefficient; inf where nothing is known.
    """
    rate = 1.0 / motion.step
    speed = np.gradient(lowpass(motion.q, rate, CUTOFF_HZ), motion.t)
    acceleration = np.gradient(lowpass(speed, rate, CUTOFF_HZ), motion.t)
    torque = p[INDEX["stiffness"]] * (motion.command - motion.q) - p[INDEX["damping"]] * speed
    torque = torque - motion.gravity - motion.coupling - motion.inertia * acceleration
    direction = np.tanh(speed / SLOW)
    of_load = direction * np.abs(motion.gravity)
    columns = (direction, of_load, speed, acceleration, motion.gravity, motion.slope)
    nuisance = np.stack(columns, axis=1)
    prior = np.array([np.inf, np.inf, np.inf, np.inf, LINKS_OFF, ZERO_OFF])
    return torque[kept], nuisance[kept], prior


def _without(
    torque: Array, nuisance: Array, prior: Array, own: Array
) -> tuple[Array, Array, Array]:
    """Return a joint's torque and the body's columns less what its nuisances explain.

    And what is left likewise of the torques of nuisances with a prior, each of its usual size.
    """
    scale = max(1.4826 * float(np.median(np.abs(torque - np.median(torque)))), 1e-6)
    ridge = (scale / prior) ** 2 * np.ones(len(prior))
    square = nuisance.T @ nuisance + np.diag(ridge) + 1e-12 * np.eye(len(prior))
    usual = np.flatnonzero(np.isfinite(prior))
    of = np.column_stack([torque, nuisance[:, usual] * prior[usual], own])
    left = of - nuisance @ np.linalg.lstsq(square, nuisance.T @ of, rcond=None)[0]
    k = 1 + len(usual)
    return left[:, 0], left[:, k:], left[:, 1:k]


def gravity_of_tip(arm: Arm, q: Array) -> Array:
    """Return (R, n, 4) gravity torques at poses (R, n): per kg at the tip, per kg·m of moment."""
    model = arm.pinocchio()
    rest = np.zeros_like(q)
    last = torque_regressor(model, q, rest, rest)[..., -10:]
    return np.asarray(last @ from_flange(model, arm)[:, :4])
