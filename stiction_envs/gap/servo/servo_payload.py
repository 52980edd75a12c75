"""A mass at the tip that the model lacks: proposed by a regression, judged by the joints' evidence.

A body at the flange sags all joints under gravity, each as a softer servo would. One regression
over all joints of the servos' torques K (q_cmd − q) on the torques of such a body proposes its mass
and centre; friction, lag, and links a little off are small errors of each joint. It is named where
it adds more to the evidence of the joints than its own four numbers cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.gap.causes.body.bodies import from_flange, sphere
from stiction_envs.gap.causes.body.payload import Payload
from stiction_envs.gap.causes.draft import Part
from stiction_envs.gap.judge.judgement import Estimate
from stiction_envs.gap.judge.problem import ARM, Channel, Problem, Term
from stiction_envs.gap.judge.search import NAMED
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.motion import CUTOFF_HZ
from stiction_envs.gap.servo.servo_parameters import INDEX
from stiction_envs.gap.signals.filters import lowpass
from stiction_envs.robots import Arm
from stiction_envs.robots.regressor import torque_regressor

ROW_SECONDS, BLOCK = 0.1, 4.0
"""Time between rows of the regression, and of blocks that give the interval [s]; assumed."""
SLOW = 0.02
"""Speed at which dry friction is nearly its level [rad/s]; assumed."""
CARRIES = 1 / 3
"""Usual gravity of a body at the flange over the arm's own largest [-]; assumed."""
LOOKS_LIKE = 0.03
"""Gravity of the body that small errors of links look like, over the same [-]; assumed."""
REACH = 0.1
"""Usual distance of its centre from the flange [m]; assumed."""
LINKS_OFF, ZERO_OFF = 0.08, 0.02
"""Usual error of a joint's gravity by small errors of links [-], and of its zero [rad]; assumed."""
ROUNDS = 4
"""Rounds of weighing the joints by their error; assumed."""
FREE = 10.0
"""Usual torque of what is not known at all, over the size of the servo's [-]; assumed."""


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
    kept = np.flatnonzero(rows)[:: motions[0].rows_in(ROW_SECONDS)]
    body = gravity_of_tip(arm, np.stack([m.q[kept] for m in motions], axis=1))
    block = (motions[0].t[kept] // BLOCK).astype(int)
    _, block = np.unique(block, return_inverse=True)
    own = np.array([np.sqrt(np.mean(m.gravity[kept] ** 2)) for m in motions])
    of_mass = np.sqrt(np.mean(body[..., 0] ** 2, axis=0)).max()
    usual = CARRIES * own.max() / max(of_mass, 1e-12) * np.array([1.0, REACH, REACH, REACH])
    everywhere = np.zeros(len(kept), dtype=np.int64)
    problem, free = Problem([], np.ones(arm.n)), np.full(6, np.inf)
    for j, (m, p) in enumerate(zip(motions, nominal, strict=True)):
        torque, columns = _residual(m, p, kept)
        size = np.sqrt(np.mean(columns**2, axis=0))
        sd = FREE * float(np.std(torque)) / np.maximum(size, 1e-9)
        sd[4] = LINKS_OFF
        sd[5] = sd[5] if j in shifted else ZERO_OFF
        problem.channels.append(Channel(torque, everywhere, 1))
        off = Term("friction, lag and links", j, small=True)
        problem.add(off, {j: columns.T}, sd, (-free, free), 0.0)
    tip = Term(Payload.name, ARM)
    bounds = -free[:4], free[:4]
    problem.add(tip, {j: body[:, j].T for j in range(arm.n)}, usual, bounds, 0.0)
    little = usual * [LOOKS_LIKE / CARRIES, 1.0, 1.0, 1.0]
    problem.share(tip._replace(small=True), tip, little)
    terms = problem.model([tip])
    for _ in range(ROUNDS):  # joints weigh by what the body leaves on them
        found = problem.fit(terms)
        left = [x.residual - x.columns.T @ found[x.at] for x in problem.channels]
        by_block = np.stack([np.bincount(block, weights=x) for x in left])
        each = np.maximum(np.square(left).sum(axis=1), np.square(by_block).sum(axis=1))
        problem.given(np.maximum(each / len(kept), 1e-12))
    found, covariance = problem.fit(terms)[-4:], problem.covariance(terms)[-4:, -4:]
    mass, nats = float(found[0]), problem.score([tip]) - problem.score([])
    if mass <= 0 or nats < NAMED:
        return None
    z, narrowed = found / usual, covariance / np.outer(usual, usual)
    wide = float(student.ppf(0.975, max(1, by_block.shape[1] - 4)))
    com, half = found[1:] / mass, wide * np.sqrt(np.diag(covariance))
    axes = np.stack([com - half[1:] / mass, com + half[1:] / mass], axis=1).tolist()
    interval = mass - float(half[0]), mass + float(half[0])
    return Tip(
        mass=mass,
        com=com,
        parameters={
            "mass_kg": Estimate(value=mass, ci95=interval, on_bound=False),
            "com_m": Estimate(value=com.tolist(), ci95=axes, on_bound=False),
        },
        torque=np.sqrt(np.mean((body @ found) ** 2, axis=0)),
        cost=0.5 * float(z @ z - np.linalg.slogdet(narrowed)[1]),
        nats=nats,
    )


def _residual(motion: JointMotion, p: Array, kept: Index) -> tuple[Array, Array]:
    """Return (R,) residual of the servo's torque [N·m], and (R, 6) torques of what may be off."""
    rate = 1.0 / motion.step
    speed = np.gradient(lowpass(motion.q, rate, CUTOFF_HZ), motion.t)
    acceleration = np.gradient(lowpass(speed, rate, CUTOFF_HZ), motion.t)
    torque = p[INDEX["stiffness"]] * (motion.command - motion.q) - p[INDEX["damping"]] * speed
    torque = torque - motion.gravity - motion.coupling - motion.inertia * acceleration
    direction = np.tanh(speed / SLOW)
    of_load = direction * np.abs(motion.gravity)
    columns = (direction, of_load, speed, acceleration, motion.gravity, motion.slope)
    return torque[kept], np.stack(columns, axis=1)[kept]


def gravity_of_tip(arm: Arm, q: Array) -> Array:
    """Return (R, n, 4) gravity torques at poses (R, n): per kg at the tip, per kg·m of moment."""
    model = arm.pinocchio()
    rest = np.zeros_like(q)
    last = torque_regressor(model, q, rest, rest)[..., -10:]
    return np.asarray(last @ from_flange(model, arm)[:, :4])
