"""Logs beside the nominal model: residual torque, its noise floor, and blocks to hold out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.signal import welch

from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.signals.bristle import bristles, grown
from stiction_envs.gap.signals.poses import scatter, segment_numbers, wander
from stiction_envs.gap.signals.prepare import Signals, lowpass
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
BLOCKS = 12
"""Blocks of time that are held out in turn, over all logs (assumed: enough to see their spread)."""
GUARD = 0.25
"""Time between two blocks that belongs to none [s]; longer than any filter here (assumed)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Data:
    """Everything a cause may look at; T samples of n joints."""

    arm: Arm
    dt: float
    """Sampling time within a segment [s]."""
    cutoff: float
    """Cutoff of the filter that all signals passed [Hz]."""
    t: Array
    """(T,) time since the start of the log [s]."""
    q: Array
    """(T, n) [rad]."""
    dq: Array
    """(T, n) [rad/s]."""
    ddq: Array
    """(T, n) [rad/s²]."""
    tau: Array
    """(T, n) measured [N·m]."""
    nominal: Array
    """(T, n) of the nominal model [N·m]."""
    gravity: Array
    """(T, n) of the nominal model [N·m]."""
    noise: Array
    """(n,) noise floor of the measured torque [N·m]."""
    segment: NDArray[np.int64]
    """(T,) number of the segment: time runs on within one."""
    block: NDArray[np.int64]
    """(T,) number of the block, −1 in a guard."""
    link_side: bool
    """Whether torque was measured behind the gear."""
    has_friction: bool
    """Whether the nominal model has friction, which may then be too much too."""
    rigid: Array
    """(T, n) of the nominal model without its friction: the torque that is transmitted [N·m]."""
    pinocchio: pin.Model
    distance: Array
    """(n,) presliding distance of plain dry friction [rad]."""
    way: Array
    """(T, n) angles without overshoot and noise, for friction's turns [rad]."""
    level: Array
    """(n,) dry friction of the nominal model in motion, mean of the directions [N·m]."""
    lead: Array
    """(n,) σ1/σ0 of plain dry friction, by which damped bristles lead; 0 where not known [s]."""
    rows: dict[str, Array]
    """Extra channels, (T, n) each."""
    carried: Array | None = None
    """(T, n) what ``rigid`` has of causes beyond ``nominal``: a payload, a tilt [N·m]."""
    diagnosed: bool = False
    """Whether causes of an earlier diagnosis are in the nominal model."""
    memory: dict[str, Array] = field(default_factory=dict)
    """What several joints' columns are cut from."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.q.shape[1]

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return int(self.block.max()) + 1

    def biting(self, residual: Array, late: Callable[[Array], Array]) -> Data:
        """Return data whose dry friction bites within the distances of a residual (T, n) [N·m].

        ``late`` makes of a torque (T,) what is logged of it.
        """
        distance = bite(
            residual, self.way, self.dq, self.ddq, self.runs(), self.dt, self.cutoff, late
        )
        return replace(self, distance=distance, memory={})

    def carrying(self, torque: Array) -> Data:
        """Return data whose gears transmit a torque (T, n) that ``nominal`` has not [N·m]."""
        carried = torque if self.carried is None else self.carried + torque
        return replace(self, rigid=self.rigid + torque, carried=carried, memory={})

    @property
    def residual(self) -> Array:
        """(T, n) measured less nominal torque [N·m]."""
        return self.tau - self.nominal

    def cached(self, name: str, make: Callable[[], Array]) -> Array:
        """Return an array made once."""
        if name not in self.memory:
            self.memory[name] = make()
        return self.memory[name]

    def smooth(self, x: Array) -> Array:
        """Return (T, ...) after the filter of the signals, segment by segment.

        What depends on the signals other than linearly must pass it before it is compared.
        """
        return filtered(x, self.runs(), self.dt, self.cutoff)

    def direction(self, joint: int) -> Array:
        """Return (T,) direction of motion in [-1, 1], unfiltered; at rest that of the last motion.

        A joint that stops keeps its friction until it goes back by the `distance`.
        """
        return self.cached(
            "direction", lambda: bristles(self.way, self.runs(), self.distance[:, None])[..., 0]
        )[:, joint]

    def grip(self, joint: int) -> Array:
        """Return (T,) dry friction over its steady level, unfiltered: ζ + (σ1/σ0) dζ/dt [-]."""
        zeta = self.direction(joint)
        if self.lead[joint] == 0:
            return zeta
        return zeta + self.lead[joint] * rate(zeta, self.runs(), self.dt)

    def side(self, joint: int) -> Array:
        """Return (T,) sign of the motion by which each row was reached; at rest of the last."""
        out = np.zeros(len(self.t))
        for run in self.runs():
            step = np.sign(np.diff(self.way[run, joint], prepend=self.way[run.start, joint]))
            last = np.maximum.accumulate(np.where(step != 0, np.arange(len(step)), 0))
            out[run] = step[last]
        return out

    def growth(self, joint: int, weight: Array, ratio: float = 0.0) -> Array:
        """Return (T,) dry friction per unit of a level that grows by ``weight`` (T,), unfiltered.

        In steady sliding it is the weight in the direction of motion. ``ratio`` is the growth per
        unit of weight over the level (`grown`).
        """
        eta = grown(
            self.way[:, joint],
            self.runs(),
            float(self.distance[joint]),
            self.direction(joint),
            weight,
            ratio,
        )
        if self.lead[joint] == 0:
            return eta
        return eta + self.lead[joint] * rate(eta, self.runs(), self.dt)

    def runs(self) -> list[slice]:
        """Return the rows of each segment."""
        return runs_of(self.segment)


def runs_of(segment: NDArray[np.int64]) -> list[slice]:
    """Return the rows of each segment from its number (T,)."""
    edges = np.flatnonzero(np.diff(segment)) + 1
    cuts = [0, *edges.tolist(), len(segment)]
    return [slice(a, b) for a, b in pairwise(cuts)]


def rate(x: Array, runs: list[slice], dt: float) -> Array:
    """Return the time derivative of (T, ...) within each segment, per second."""
    out = np.zeros_like(x)
    for run in runs:
        if run.stop - run.start > 2:
            out[run] = np.gradient(x[run], dt, axis=0)
    return out


def filtered(x: Array, runs: list[slice], dt: float, cutoff: float) -> Array:
    """Return (T, ...) through the filter of the signals, segment by segment; poses as they are."""
    out = np.array(x, dtype=np.float64)
    if np.isfinite(dt) and np.isfinite(cutoff):
        for run in runs:
            out[run] = lowpass(out[run], 1 / dt, cutoff)
    return out


def inverse_dynamics(model: pin.Model, q: Array, dq: Array, ddq: Array) -> Array:
    """Return (T, n) torque of M(q)q̈ + C(q, q̇)q̇ + g(q) [N·m] (pinocchio's RNEA)."""
    data = model.createData()
    out = np.empty_like(q)
    for k in range(len(q)):
        out[k] = pin.rnea(model, data, q[k], dq[k], ddq[k])
    return out


def gravity_torque(model: pin.Model, q: Array) -> Array:
    """Return (T, n) gravity torque g(q) [N·m]."""
    data = model.createData()
    return np.array([pin.computeGeneralizedGravity(model, data, x) for x in q])


def steady_friction(
    friction: FrictionParameters, load: Array, direction: Array, dq: Array, ddq: Array
) -> Array:
    """Return (T, n) torque of our friction in steady sliding, rotor inertia and offset [N·m].

    Args:
        friction: of one arm.
        load: (T, n) signed transmitted torque [N·m].
        direction: (T, n) of motion, in [-1, 1] but for what bristle damping adds.
        dq: (T, n) [rad/s].
        ddq: (T, n) [rad/s²].
    """
    level = friction.stiction_at(np.abs(load))
    side = (dq < 0).astype(int)

    def pick(x: Array) -> Array:
        return np.take_along_axis(np.broadcast_to(x, level.shape), side[..., None], axis=-1)[..., 0]

    stiction, ratio = pick(level), pick(friction.coulomb_ratio)
    stribeck = pick(friction.stribeck_velocity)
    g = stiction * (ratio + (1.0 - ratio) * np.exp(-np.square(dq / stribeck)))
    clipped = np.clip(load, -friction.load_high, friction.load_high)
    return (
        direction * g
        + pick(friction.viscous) * dq
        + friction.rotor_inertia * ddq
        + friction.offset
        + friction.gravity_error * clipped
    )


BITE = 2e-4
"""Presliding distance of dry friction [rad]: 0.5 N·m on 2500 N·m/rad; assumed."""
BITES = (2e-5, 6e-5, BITE, 6e-4)
"""Distances of which each joint takes the one that its torque at reversals asks for [rad]."""
SIGN_SPEED = 2e-3
"""Speed below which the direction of motion is not certain in a filtered log [rad/s]; assumed."""


def assemble(
    arm: Arm,
    signals: Signals,
    *,
    friction: FrictionParameters | None = None,
    link_side: bool = False,
    blocks: int = BLOCKS,
) -> Data:
    """Put signals beside the nominal model.

    Args:
        arm: nominal rigid arm.
        signals: of its logs.
        friction: nominal friction; None for a rigid body without any.
        link_side: whether torque was measured behind the gear.
        blocks: number of blocks; logs are blocks where there are at least as many of them.
    """
    parts = signals.segments
    model = arm.pinocchio()
    q, dq, ddq, tau, way = (
        np.concatenate([getattr(s, x) for s in parts]) for x in ("q", "dq", "ddq", "tau", "way")
    )
    rigid = inverse_dynamics(model, q, dq, ddq)
    nominal = rigid
    gravity = gravity_torque(model, q)
    segment = segment_numbers(parts, signals.dt)
    runs, distance = runs_of(segment), np.full(arm.n, BITE)
    level, lead = np.zeros((2, arm.n))
    if friction is not None:
        level = (friction.stiction * friction.coulomb_ratio).mean(axis=-1)
        distance = friction.stiction.mean(axis=-1) / friction.bristle_stiffness
        direction = bristles(way, runs, distance[:, None])[..., 0]
        rotor, stiffness = friction.rotor_inertia, friction.bristle_stiffness
        # the bristles' own damping, σ1 = 2ζ√(σ0 J) of the rotor, leads at reversals
        lead = 2 * friction.bristle_damping_ratio * np.sqrt(rotor / stiffness)
        if link_side:
            friction = friction.replace(rotor_inertia=0.0 * friction.rotor_inertia)
        grip = direction + lead * rate(direction, runs, signals.dt)
        dry = steady_friction(friction, gravity, grip, dq, ddq)
        nominal = rigid + filtered(dry, runs, signals.dt, signals.cutoff_hz)
    if friction is None:
        distance = bite(tau - rigid, way, dq, ddq, runs, signals.dt, signals.cutoff_hz)
    log = np.concatenate([np.full(len(s.t), s.log) for s in parts])
    t = np.concatenate([s.t for s in parts])
    names = set.intersection(*(set(s.extra) for s in parts)) if parts else set()
    return Data(
        arm=arm,
        dt=signals.dt,
        cutoff=signals.cutoff_hz,
        t=t,
        q=q,
        dq=dq,
        ddq=ddq,
        tau=tau,
        nominal=nominal,
        gravity=gravity,
        noise=np.maximum(
            _floor(signals, runs, q, dq, ddq, tau - nominal, way), wander(q, tau - nominal, rigid)
        ),
        segment=segment,
        block=_blocks(log, segment, signals.dt, blocks),
        link_side=link_side,
        has_friction=friction is not None,
        rigid=rigid,
        pinocchio=model,
        distance=distance,
        way=way,
        level=level,
        lead=lead,
        rows={name: np.concatenate([s.extra[name] for s in parts]) for name in sorted(names)},
    )


def bite(
    residual: Array,
    way: Array,
    dq: Array,
    ddq: Array,
    runs: list[slice],
    dt: float,
    cutoff: float,
    late: Callable[[Array], Array] = lambda x: x,
) -> Array:
    """Return (n,) the distance of `BITES` with which friction explains most of the residual [rad].

    It turns the sign of friction some milliseconds later, which moves what is found beside it.
    ``late`` makes of a torque (T,) what is logged of it.
    """
    zeta = bristles(way, runs, np.tile(BITES, (way.shape[1], 1)))
    zeta = filtered(zeta, runs, dt, cutoff)
    out = np.full(way.shape[1], BITE)
    for j in range(way.shape[1]):
        common = np.stack([dq[:, j], ddq[:, j], np.ones(len(dq))], axis=1)
        left = []
        for k in range(len(BITES)):
            # what friction falls by with speed may tell itself from when it turns
            x = np.column_stack(
                [common, zeta[:, j, k], zeta[:, j, k] * np.exp(-np.abs(dq[:, j]) / 0.1)]
            )
            x = np.stack([late(column) for column in x.T], axis=1)
            r = residual[:, j]
            xx = x.T @ x
            c = np.linalg.lstsq(xx, x.T @ r, rcond=None)[0]
            left.append(float(np.sum(np.square(r - x @ c))))
        out[j] = BITES[int(np.argmin(left))]
    return out


def _floor(
    signals: Signals,
    runs: list[slice],
    q: Array,
    dq: Array,
    ddq: Array,
    residual: Array,
    way: Array,
) -> Array:
    """Return (n,) noise of the residual [N·m]: that of the torque, and of the acceleration.

    The latter grows with frequency: the upper half of the filter's band holds all of it and half
    of the torque's. Medians over windows leave out the few that hold a jump of friction.
    """
    torque = np.asarray(signals.noise_tau)
    if not np.all(np.isfinite(torque)):
        poses = scatter(q, residual)
        return np.full(q.shape[1], LEAST_NOISE) if poses is None else poses + LEAST_NOISE
    torque = np.maximum(torque, LEAST_NOISE)
    direction = filtered(
        bristles(way, runs, np.full((q.shape[1], 1), BITE))[..., 0],
        runs,
        signals.dt,
        signals.cutoff_hz,
    )
    longest = max(runs, key=lambda r: r.stop - r.start)
    window = int(min(longest.stop - longest.start, max(32, 1.0 / signals.dt)))
    out = torque.copy()
    for j in range(q.shape[1]):
        x = np.stack([direction[:, j], dq[:, j], ddq[:, j], np.ones(len(q))], axis=1)
        left = residual[:, j] - x @ np.linalg.lstsq(x, residual[:, j], rcond=None)[0]
        f, power = welch(left[longest], 1 / signals.dt, nperseg=window, average="median")
        high = (f > 0.5 * signals.cutoff_hz) & (f < 1.5 * signals.cutoff_hz)
        upper = float(power[high].sum() * f[1])
        out[j] = np.sqrt(upper + min(0.5 * torque[j] ** 2, upper)) + LEAST_NOISE
    return out


LEAST_NOISE = 1e-4
"""Noise that is assumed at least [N·m], so that perfect data do not divide by zero; assumed."""


def _blocks(
    log: NDArray[np.int64], segment: NDArray[np.int64], dt: float, wanted: int
) -> NDArray[np.int64]:
    """Return (T,) block numbers: by log where there are many, else equal spans of each log's time.

    Never rows at random: neighbours share noise, filter and friction state.
    """
    logs = np.unique(log)
    each = max(1, -(-wanted // len(logs)))
    block = np.empty(len(log), dtype=np.int64)
    guard = round(GUARD / dt) if np.isfinite(dt) else 0
    for i, number in enumerate(logs):
        rows = np.flatnonzero(log == number)
        part = np.minimum(np.arange(len(rows)) * each // len(rows), each - 1)
        block[rows] = i * each + part
        for edge in np.flatnonzero(np.diff(part)) + 1:
            if segment[rows[edge]] != segment[rows[edge - 1]]:
                continue  # another recording, or another pose: no neighbours in time
            near = slice(max(0, edge - guard // 2), edge + guard // 2)
            block[rows[near]] = -1
    return block
