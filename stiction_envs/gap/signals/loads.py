"""Logged torques against gravity and inertia: factor and sign of each joint, gravity's direction.

With everything free that a log may have wrong, the torque of a joint is

    τ = c I + r q̈ + Σ_k γ_k g_k(q) + offset + d sign(q̇) + v q̇,

I being the rest of inverse dynamics and g_k gravity's torque along x, y or z. Three things follow:

- The sign. Friction and inertia resist: where γ is opposite to the gravity that is assumed, and
  they are, too, the torque has the opposite sign, whatever the masses are.
- The direction u of gravity, one for all joints: γ_j = k_j u with k_j > 0.
- The factor between torque and load along u, with offset, friction and rotor free: 1; another
  number, the same on all joints, in another unit; 0 with nothing else where nothing is measured.

Offsets have a prior, so that a load that is only held shows its sign too. The error of the fit is
correlated: rows within `APART` count as one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from stiction_envs.arrays import Array, Bools, Index, rms
from stiction_envs.gap.signals.angles import AngleError, angle_error, least_load, others_of
from stiction_envs.gap.signals.prepare import Signals
from stiction_envs.gap.signals.rigid_body import gravity_by_axis, inverse_dynamics, passive_torque
from stiction_envs.measured.motion_thresholds import REVERSAL_SPEED, TRAVEL_SPAN
from stiction_envs.reporting.markdown import joints as joint_list
from stiction_envs.robots import Arm

MOST_ROWS = 2000
"""Rows of a log that are used, evenly spaced [-]; assumed, to limit the time."""
APART = 0.25
"""Time between independent rows [s]; assumed."""
OFFSET = 0.05
"""Usual offset of a torque, or friction of a joint that holds, over its limit [-]; assumed."""
ROUNDING = 1e-10
"""Part of a column's information that is added to it, against rounding [-]."""
LEAST_NOISE = 2e-5
"""Least error of a fit, over the usual offset [-]; assumed."""
FREE = 1e6
"""Prior standard deviation of what is free, over its column's size and the usual offset [-];
assumed."""
CLEAR = 5.0
"""Standard deviations from zero at which a coefficient has a sign [-]; assumed."""
CORRELATED = 0.9
"""Least correlation of what shows a sign with the torque, all else taken off [-]; assumed."""
OTHER_UNIT = 2.0
"""Factor, or one over it, from which on torques have another unit, if all joints have the same;
times the ratio by which they differ [-]; assumed: a mass that is missing makes factors of 2 to
3."""
ROUNDS = 20
"""Rounds in which gravity's direction and the joints' factors are found in turn [-]."""
SURE = 0.25
"""Largest half width of a factor's interval, over the factor, for another unit [-]; assumed."""
LEFT = 0.5
"""Part of a joint's residual that another direction of gravity leaves at most [-]; assumed: a
spring, too, is explained by another mounting, but leaves more."""
MOUNTED = 0.7
"""Angle between assumed and found gravity from which on the arm is mounted in another way [rad];
assumed: a smaller one is a base that leans."""
SILENT = 0.1
"""Part of a torque's variance that motion and load explain in noise alone [-]; assumed."""
RIGHT_ANGLE = 0.1
"""Distance from a multiple of 90° below which a mounting angle is that [rad]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Loads:
    """Findings about the torques of n joints in one log."""

    arm: Arm
    factor: Array
    """(n,) logged torque over what gravity and inertia need [-]; NaN where they need nothing."""
    width: Array
    """(n,) half width of its 95 % interval [-]."""
    needed: Array
    """(n,) what gravity and inertia need, root mean square [N·m]."""
    logged: Array
    """(n,) logged torque, the same [N·m]."""
    sign: Index
    """(n,) 1 where the torque drives the joint, -1 where it is opposite, 0 where nothing shows."""
    by_load: Bools
    """(n,) whether a load that changes shows the sign."""
    lacks_gravity: bool
    """Whether gravity does not show, where friction or inertia does."""
    measured: Bools
    """(n,) False where the torque is noise, although motion and load need some."""
    held: Bools
    """(n,) whether a joint rests, and its friction can hold what is due."""
    gravity: Array
    """(3,) direction of gravity in the world that the torques fit best."""
    angle: AngleError | None = None
    """A joint whose angle is not the model's; the rest is as if it were."""
    elsewhere: bool
    """Whether that is far from the assumed one, and all joints that carry a load agree on it."""

    @property
    def unit(self) -> float | None:
        """The factor that all joints share, where it is another unit's, else 1 [-].

        None where no two joints show one, or all differ.
        """
        sure = self.by_load & (self.needed > least_load(self.arm.pinocchio()))
        sure &= self.width < SURE * np.abs(self.factor)
        some = np.abs(self.factor[sure])
        if len(some) < 2:
            return None
        usual, spread = float(np.median(some)), float(some.max() / some.min())
        off = max(usual, 1 / usual)
        if off > OTHER_UNIT * spread:
            return usual
        return 1.0 if max(off, spread) < OTHER_UNIT else None

    @property
    def findings(self) -> list[str]:
        """Defects of the torques or of the mounting, a sentence each."""
        out = []
        if (unit := self.unit or 1.0) != 1:
            what = "amperes of motor current?" if unit < 1 else "or masses that the model lacks?"
            out.append(
                f"the torques are {unit:.3g} times what gravity and inertia need, on all joints: "
                f"another unit, {what} torque_scale says the factor"
            )
        if self.lacks_gravity:
            out.append(
                "the torques lack gravity, but not friction: does the controller compensate "
                "gravity, and log the torque without it?"
            )
        dead = np.flatnonzero(~self.measured & ~self.held)
        if dead.size:
            which = joint_list([int(j) + 1 for j in dead])
            out.append(
                f"the torque of {which} is not measured: {self.logged[dead].max():.2g} N·m, "
                f"without a trace of up to {self.needed[dead].max():.2g} N·m that are due; left out"
            )
        if self.elsewhere:
            out.append(self.mounting)
        if self.angle is not None:
            out.append(str(self.angle))
        return out

    @property
    def mounting(self) -> str:
        """A sentence on gravity's direction, and the option that sets it."""
        base = Rotation.from_euler("xy", self.arm.tilt).inv().apply(self.gravity)
        axis = int(np.argmax(np.abs(base)))
        sign = "+" if base[axis] > 0 else "-"
        pitch = np.arcsin(np.clip(base[0], -1, 1))
        roll = np.arctan2(-base[1], -base[2]) if abs(base[0]) < np.cos(RIGHT_ANGLE) else 0.0
        angles = []
        for angle in (roll, pitch):
            right = np.round(2 * angle / np.pi) * np.pi / 2
            angles.append(right if abs(angle - right) < RIGHT_ANGLE else angle)
        tilt = " ".join(f"{abs(x) if abs(x) > 3.14 else x + 0.0:.6g}" for x in angles)
        near = np.abs(base[axis]) > np.cos(2 * RIGHT_ANGLE)
        where = f"along {sign}{'xyz'[axis]}" if near else f"along {np.round(base, 2).tolist()}"
        how = "on a ceiling" if base[2] > 0.9 else "on a wall or a slope"
        return f"gravity points {where} of the base: mounted {how}? `--tilt {tilt}`"


class _Fit:
    """Least squares with a prior for the last column, of an error that is correlated in time."""

    def __init__(self, x: Array, y: Array, offset: float, apart: float) -> None:
        size = np.maximum(rms(x), 1e-9)
        prior = np.r_[np.full(x.shape[1] - 1, FREE * offset), offset]
        z, self.rows = x / size, max(len(y) * min(1.0, apart / APART), 2.0)
        self.left = max(float(y.std()), LEAST_NOISE * offset)
        for _ in range(3):
            weight = self.rows / (len(y) * self.left**2)
            least = 1 / prior**2 + ROUNDING * weight * len(y)
            cov = np.linalg.inv(weight * z.T @ z + np.diag(least))
            c = cov @ (weight * z.T @ y)
            self.left = max(float(rms(y - z @ c)), LEAST_NOISE * offset)
        self.c, self.cov = c / size, cov / np.outer(size, size)

    def clear(self, weights: Array) -> float:
        """Return a weighted sum of the coefficients over its standard deviation [-]."""
        return float(weights @ self.c / np.sqrt(max(float(weights @ self.cov @ weights), 1e-30)))

    def resistance(self, side: Array, dq: Array, ddq: Array, rest: Array) -> float:
        """Return the resistance of inertia and friction over its standard deviation [-]."""
        heavy = float(ddq @ rest) / max(float(ddq @ ddq), 1e-12)
        inertia = np.array([0, 0, 0, heavy, 1, 0, 0, 0])
        rubbing = np.array([0, 0, 0, 0, 0, np.abs(side).mean(), np.abs(dq).mean(), 0])
        torques = rest * self.c[3] + ddq * self.c[4], side * self.c[5] + dq * self.c[6]
        a, b = (float(rms(x)) for x in torques)
        return (a * self.clear(inertia) + b * self.clear(rubbing)) / max(a + b, 1e-12)


def loads(signals: Signals, log: int, arm: Arm) -> Loads:
    """Return the findings about the torques of a log, by its number in the signals."""
    rows = _rows(signals, log)
    found = _loads(rows, arm)
    if found.elsewhere:
        return found
    q, dq, ddq, tau, apart = rows
    error = angle_error((q, dq, ddq), tau, arm, len(tau) * min(1.0, apart / APART))
    if error is None:
        return found
    sign, shift = np.ones(arm.n), np.zeros(arm.n)
    if error.offset is None:
        sign[error.joint - 1] = -1
    else:
        shift[error.joint - 1] = error.offset
    found = _loads((sign * q - shift, sign * dq, sign * ddq, tau, apart), arm)
    if error.offset is None:  # a joint whose axis is the other way has both signs opposite
        found.sign[error.joint - 1] = abs(found.sign[error.joint - 1])
    return replace(found, angle=error)


def _loads(rows: tuple[Array, Array, Array, Array, float], arm: Arm) -> Loads:
    """Return the findings about rows (`_rows`), if their angles are the model's."""
    q, dq, ddq, tau, apart = rows
    model, n = arm.pinocchio(), arm.n
    pulls, down = gravity_by_axis(model, q), np.asarray(model.gravity.linear)
    down = down / np.linalg.norm(down)
    rest = inverse_dynamics(model, q, dq, ddq) + passive_torque(arm, q) - pulls @ down
    offset = OFFSET * np.maximum(arm.limits.torque, rms(rest + pulls @ down))
    sides = np.tanh(dq / REVERSAL_SPEED)
    others = others_of(dq, ddq)

    def fit(columns: Array, j: int) -> _Fit:
        return _Fit(np.column_stack([columns, others[j]]), tau[:, j], float(offset[j]), apart)

    def along(direction: Array) -> list[_Fit]:
        return [fit(rest[:, j] + pulls[:, j] @ direction, j) for j in range(n)]

    free = [fit(np.column_stack([pulls[:, j], rest[:, j]]), j) for j in range(n)]
    usual, load = along(down), rest + pulls @ down
    silent = np.array(
        [f.left**2 > (1 - SILENT) * x.var() for f, x in zip(free, tau.T, strict=True)]
    )
    factor, width = _factors(usual)
    large = load.std(axis=0) > least_load(model)
    moves = np.ptp(q, axis=0) > TRAVEL_SPAN
    measured = ~(silent & large & (np.abs(factor) + width < SURE))
    if not measured.all():
        measured &= ~(silent & moves)
    measured |= ~measured.any()  # noise alone is no log of which a part is missing
    shown = measured & large
    pulled = np.array([f.clear(np.r_[down, np.zeros(5)]) for f in free])
    loaded = np.array([f.clear(np.eye(5)[0]) for f in usual])
    loaded = np.where(_sure(pulled, free), pulled, loaded)
    resisting = np.array(
        [f.resistance(sides[:, j], dq[:, j], ddq[:, j], rest[:, j]) for j, f in enumerate(free)]
    )
    changing = shown & _sure(loaded, free)
    sign, by_load = _signs(loaded, changing, resisting, ~shown & measured, free)
    side = np.where(np.abs(resisting) > CLEAR, np.sign(resisting), np.where(sign, sign, 1))
    found = _direction([f for f, x in zip(free, shown, strict=True) if x], side[shown], down)
    there = along(found)
    before, after = (np.array([f.left for f in x]) for x in (usual, there))
    elsewhere = bool(
        np.arccos(np.clip(found @ down, -1, 1)) > MOUNTED
        and (after[shown] < LEFT * before[shown]).any()
        and shown.any()
        and (ks := np.array([f.c[0] for f in there])[shown] * side[shown]).min() > 0
        and ks.max() < OTHER_UNIT * ks.min()
    )
    heavy = shown & ((pulls @ down).std(axis=0) > least_load(model))
    weighs = np.array([float(down @ f.c[:3]) for f in free])
    lacks_gravity = bool(
        heavy.any()
        and not (shown & _sure(pulled, free)).any()
        and np.median(np.abs(weighs[heavy])) < SURE
        and np.abs(resisting).max() > CLEAR
        and not elsewhere
    )
    if elsewhere:
        clear = np.array([f.clear(np.eye(5)[0]) for f in there])
        by_load = shown & _sure(clear, there)
        sign = np.where(by_load, np.sign(clear), 0).astype(np.int64)
        load = rest + pulls @ found
        factor, width = _factors(there)
    return Loads(
        arm=arm,
        factor=factor,
        width=width,
        needed=rms(load),
        logged=rms(tau),
        sign=sign,
        by_load=by_load,
        lacks_gravity=lacks_gravity,
        measured=measured,
        held=~moves & (load.std(axis=0) < OFFSET * arm.limits.torque),
        gravity=found if elsewhere else down,
        elsewhere=elsewhere,
    )


def _factors(fits: Sequence[_Fit]) -> tuple[Array, Array]:
    """Return (n,) first coefficients, and half widths of their 95 % intervals."""
    c, variance = (np.array(x) for x in ([f.c[0] for f in fits], [f.cov[0, 0] for f in fits]))
    return c, 1.96 * np.sqrt(variance)


def _sure(clear: Array, fits: Sequence[_Fit]) -> Bools:
    """Return whether values over their deviations (n,) are certain, and most of what is left."""
    rows = np.array([f.rows for f in fits])
    return (np.abs(clear) > CLEAR) & (clear**2 > CORRELATED**2 * (clear**2 + rows))


def _signs(
    loaded: Array, changing: Bools, resisting: Array, held: Bools, fits: Sequence[_Fit]
) -> tuple[Index, Bools]:
    """Return (n,) signs, and where a load that changes shows them.

    ``loaded`` and ``resisting`` are the factor of the load and the resistance of friction and
    inertia over their standard deviations; a joint's load is ``changing``, so that it shows a sign,
    or ``held``.
    """
    sign = np.zeros(len(loaded), dtype=np.int64)
    wrong = changing & (loaded < 0)
    if wrong.any():
        # gravity alone is opposite where the arm is mounted in another way
        alone = wrong[changing].all()
        against = resisting.sum() < CLEAR if alone else resisting < CLEAR
        sign[changing] = 1
        if alone and against:
            sign[:] = -1
        elif not alone:
            sign[wrong & against] = -1
        return sign, changing
    moving = _sure(resisting, fits)
    if changing.any():
        sign[changing] = 1
        sign[~changing & moving & (resisting < 0) & (loaded < CLEAR)] = -1
        return sign, changing
    squares = float((np.sign(loaded) * loaded**2)[held].sum())
    if abs(squares) > CLEAR**2:
        sign[:] = int(np.sign(squares))
        return sign, changing
    if moving.any() and (np.sign(resisting[moving]) == np.sign(resisting[moving][0])).all():
        sign[moving] = np.sign(resisting[moving])
    return sign, changing


def _direction(fits: Sequence[_Fit], sign: Index, down: Array) -> Array:
    """Return (3,) the direction of gravity that fits the free torques of all joints best."""
    if not fits:
        return down
    pulls = [s * f.c[:3] for f, s in zip(fits, sign, strict=True)]
    weights = [np.linalg.inv(f.cov[:3, :3]) for f in fits]
    factors = np.ones(len(fits))
    direction = down
    for _ in range(ROUNDS):
        each = list(zip(pulls, weights, factors, strict=True))
        full = sum(k * k * w for _, w, k in each)
        found = np.linalg.lstsq(full, sum(k * w @ p for p, w, k in each), rcond=None)[0]
        direction = found / max(float(np.linalg.norm(found)), 1e-12)
        factors = np.array(
            [
                max(direction @ w @ p, 0.0) / (direction @ w @ direction)
                for p, w in zip(pulls, weights, strict=True)
            ]
        )
        if not factors.any():
            break
    return np.asarray(direction)


def _rows(signals: Signals, log: int) -> tuple[Array, Array, Array, Array, float]:
    """Return angles, speeds, accelerations and torques of evenly spaced rows, and their time."""
    rows = np.flatnonzero(signals.log == log)
    step = max(1, -(-len(rows) // MOST_ROWS))
    ends = np.flatnonzero(np.diff(signals.segment[rows])) + 1
    poses = len(ends) == len(rows) - 1  # each is a segment
    parts = [rows] if poses else np.split(rows, ends)
    rows = np.concatenate([part[::step] for part in parts])
    still = signals.static[rows].all() or not np.isfinite(signals.dt)
    motion = signals.q[rows], signals.dq[rows], signals.ddq[rows]
    return *motion, signals.tau[rows], APART if still else signals.dt * step
