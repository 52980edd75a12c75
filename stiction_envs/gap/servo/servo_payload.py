"""A mass at the tip that the model lacks: proposed by a regression, judged by the joints' evidence.

A body at the flange sags all joints under gravity, each as a softer servo would. One regression
over all joints of the servos' torques K (q_cmd − q) on the torques of such a body, with friction,
lag, and links a little off as nuisances, proposes its mass and centre. It is named where it adds
more to the evidence of the joints than its own four numbers cost.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.filters import lowpass
from stiction_envs.gap.causes.body.bodies import from_flange, sphere
from stiction_envs.gap.causes.body.payload import Payload
from stiction_envs.gap.causes.draft import Part
from stiction_envs.gap.judge.judgement import Estimate
from stiction_envs.gap.servo.joint import CUTOFF_HZ, JointMotion
from stiction_envs.gap.servo.servo_parameters import INDEX
from stiction_envs.robots import Arm
from stiction_envs.robots.regressor import torque_regressor

ROW_SECONDS, BLOCK = 0.1, 4.0
"""Time between rows of the regression, and of blocks that give the interval [s]; assumed."""
LINKS_OFF, ZERO_OFF = 0.08, 0.02
"""Usual error of a joint's gravity by small errors of links [-], and of its zero [rad]; assumed."""
CARRIES = 1 / 3
"""Usual gravity of a body at the flange over the arm's own largest [-]; assumed."""
LOOKS_LIKE = 0.03
"""Gravity of the body that small errors of links look like, over the same [-]; assumed."""
REACH = 0.1
"""Usual distance of its centre from the flange [m]; assumed."""
ROUNDS = 4
"""Rounds of weighing the joints by their error; assumed."""
PROMISING = 3.0
"""Least mass over its standard error for the joints to be judged anew with it [-]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tip:
    """A body at the flange."""

    mass: float
    """[kg]."""
    com: Array
    """(3,) centre of mass in the flange's frame [m]."""
    parameters: dict[str, Estimate]
    """Mass and centre with their intervals, as in ``diagnosis.json``."""
    torque: Array
    """(n,) root mean square of its gravity on each joint [N·m]."""
    cost: float
    """Log evidence that it costs against no body: by how much it narrows its prior [nats]."""
    nats: float
    """Log evidence for a usual body against links that are a little off [nats]."""

    def part(self, level: int) -> Part:
        """Return the cause of ``model.toml``, found by a diagnosis of this number."""
        phi = tuple(float(x) for x in sphere(self.mass, self.com))
        return Part(cause=Payload.name, joint=0, shape=(), coefficients=phi, level=level)


def proposed(
    arm: Arm,
    motions: Sequence[JointMotion],
    nominal: Array,
    rows: Bools,
    *,
    shifted: Sequence[int] = (),
) -> Tip | None:
    """Return the body at the flange that the servos' torques suggest; None if there is none.

    ``nominal`` are (n, P) parameters of the simulation that is judged, in which the servos'
    stiffness is known. ``rows`` (T,) are those without contact; ``shifted`` are joints (from 0)
    whose zero seems to be off.
    """
    every = motions[0].rows_in(ROW_SECONDS)
    kept = np.flatnonzero(rows)[::every]
    q = np.stack([m.q[kept] for m in motions], axis=1)
    body = gravity_of_tip(arm, q)
    blocks = (motions[0].t[kept] // BLOCK).astype(int)
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
    own = np.array([np.sqrt(np.mean(m.gravity[kept] ** 2)) for m in motions])
    of_mass = np.sqrt(np.mean(body[..., 0] ** 2, axis=0)).max()
    usual = CARRIES * own.max() / max(of_mass, 1e-12) * np.array([1.0, REACH, REACH, REACH])
    unit = np.diag(1.0 / usual**2)
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
    if not 0 < mass >= PROMISING * deviation[0]:  # nuisances may leave nothing of it
        return None
    little = usual * np.array([LOOKS_LIKE / CARRIES, 1.0, 1.0, 1.0])
    cost = _cost(found / usual, covariance / np.outer(usual, usual))
    quantile = float(stdtrit(max(1, by_block.shape[1] - 4), 0.975))  # Student's t
    com, wide = moment / mass, quantile * deviation[1:] / mass
    half = quantile * float(deviation[0])
    axes = np.stack([com - wide, com + wide], axis=1).tolist()
    return Tip(
        mass=mass,
        com=com,
        parameters={
            "mass_kg": Estimate(value=mass, ci95=(mass - half, mass + half), on_bound=False),
            "com_m": Estimate(value=com.tolist(), ci95=axes, on_bound=False),
        },
        torque=np.sqrt(np.mean((body @ found) ** 2, axis=0)),
        cost=cost,
        nats=_cost(found / little, covariance / np.outer(little, little)) - cost,
    )


def _cost(found: Array, covariance: Array) -> float:
    """Return nats that four numbers in units of their priors cost by Laplace's approximation."""
    narrowed = np.clip(np.linalg.eigvalsh(covariance), 1e-9, 1.0)
    return 0.5 * float(found @ found - np.log(narrowed).sum())


def _residual(motion: JointMotion, p: Array, kept: Index) -> tuple[Array, Array, Array]:
    """Return the residual of the servo's torque [N·m], (R, N) nuisances, and their (N,) priors.

    A prior is a standard deviation of the coefficient; inf where nothing is known.
    """
    speed, direction = motion.smooth_speed()
    acceleration = np.gradient(lowpass(speed, 1.0 / motion.step, CUTOFF_HZ), motion.t)
    torque = p[INDEX["stiffness"]] * (motion.command - motion.q) - p[INDEX["damping"]] * speed
    torque = torque - motion.gravity - motion.coupling - motion.inertia * acceleration
    of_load = direction * np.abs(motion.gravity)
    columns = (direction, of_load, speed, acceleration, motion.gravity, motion.slope)
    nuisance = np.stack(columns, axis=1)
    prior = np.array([np.inf] * 4 + [LINKS_OFF, ZERO_OFF])
    return torque[kept], nuisance[kept], prior


def _without(
    torque: Array, nuisance: Array, prior: Array, own: Array
) -> tuple[Array, Array, Array]:
    """Return a joint's torque and the body's columns less what nuisances explain.

    The torques of nuisances with a prior follow, likewise reduced, each of its usual size.
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
