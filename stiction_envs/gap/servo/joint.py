"""Compiled simulation of one joint under a position servo, along the measured motion of the others.

It has the friction law and the integration of the plant (LuGre, semi-implicit Euler,
bristle torque from the old deflection). It is used for *searches* only: every reported error is
simulated again by the plant with the whole arm.
"""

from dataclasses import dataclass

import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled
from stiction_envs.filters import lowpass
from stiction_envs.friction.lone_joint import bristle_after

CUTOFF_HZ = 5.0
"""Least bandwidth of speeds and accelerations of logged angles [Hz]; assumed."""
SLOW = 0.02
"""Speed at which dry friction is nearly its level [rad/s]; assumed."""
STEP = 2e-3
"""Longest step [s]; twice the plant's, for speed: rows are 5 to 33 ms apart."""
BRISTLE_DAMPING_RATIO = 0.4
"""ζ of the bristle [-], the plant's default."""
STIFFEST = 0.1
"""Largest bristle stiffness over inertia/step² [-]; a twentieth of the chattering limit."""
SLOWEST = 25.0
"""Least inertia over servo stiffness·step² [-]: oscillations of under 30 ms are not resolved, and
no position log shows them; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointMotion:
    """One joint in S segments of T rows in all; what acts on it besides its own servo."""

    t: Array
    """(T,) time [s], rising within a segment."""
    q: Array
    """(T,) measured angle [rad]."""
    bounds: Index
    """(S + 1,) first row of each segment, and T."""
    command: Array
    """(T,) commanded angle, held until the next row [rad]."""
    nodes: Array
    """(2, T + 2 S) `command_nodes` of the segments, one after the other [s, rad·s]."""
    gravity: Array
    """(T,) gravity torque at the measured pose [N·m]."""
    slope: Array
    """(T,) its derivative by the joint's own angle [N·m/rad]."""
    inertia: Array
    """(T,) diagonal of the mass matrix [kg·m²]."""
    coupling: Array
    """(T,) torque of Coriolis, centrifugal and the other joints' accelerations [N·m]."""

    @property
    def step(self) -> float:
        """Usual time between rows [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def segment(self) -> Index:
        """(T,) number of the segment of each row."""
        return np.repeat(np.arange(len(self.bounds) - 1), np.diff(self.bounds))

    @property
    def since(self) -> Array:
        """(T,) time since the segment began [s]."""
        return self.t - self.t[self.bounds[self.segment]]

    def smooth_speed(self) -> tuple[Array, Array]:
        """Return (T,) speed below `CUTOFF_HZ` [rad/s], and the part of dry friction that acts."""
        speed = np.gradient(lowpass(self.q, 1.0 / self.step, CUTOFF_HZ), self.t)
        return speed, np.tanh(speed / SLOW)

    def rows_in(self, seconds: float) -> int:
        """Return how many rows a time lasts, at least one."""
        return max(1, round(seconds / self.step))

    def simulate(self, parameters: Array) -> Array:
        """Return (C, T) simulated angles of C sets of parameters (C, P) [rad].

        Each segment starts at rest at its first measured angle. NaN or inf where a joint diverges.
        """
        out = np.empty((len(parameters), len(self.t)))
        _simulate(
            np.ascontiguousarray(parameters, dtype=np.float64),
            self.bounds,
            np.stack([self.t, self.q, self.gravity, self.slope, self.inertia, self.coupling]),
            self.nodes,
            float(np.abs(self.gravity).mean()),
            float(self.inertia.min()),
            max(1, int(np.ceil(self.step / STEP - 1e-6))),
            out,
        )
        return out

    def heads(self, lengths: Index) -> tuple["JointMotion", Bools]:
        """Return the first rows of each segment, and whether each row (T,) is one of them.

        ``lengths`` (S,) of 0 leave a segment out.
        """
        counts, kept = np.diff(self.bounds), np.flatnonzero(lengths)
        since = np.arange(len(self.t)) - np.repeat(self.bounds[:-1], counts)
        rows: Bools = since < np.repeat(lengths, counts)
        at = [self.bounds[s] + 2 * s + np.arange(lengths[s] + 2) for s in kept]
        names = ("t", "q", "command", "gravity", "slope", "inertia", "coupling")
        motion = JointMotion(
            bounds=np.concatenate([[0], np.cumsum(lengths[kept])]),
            nodes=np.take(self.nodes, np.concatenate(at), axis=1),
            **{name: getattr(self, name)[rows] for name in names},
        )
        return motion, rows


def command_nodes(t: Array, command: Array, before: float, after: float) -> Array:
    """Return (2, R + 2) times [s] and the integral of the command over time [rad·s].

    Each of the R commands is held until the next row; ``before`` the rows the first command is
    held, and the last one until ``after``.
    """
    times = np.concatenate([[before], t, [after]])
    held = np.concatenate([command[:1], command])
    return np.stack([times, np.concatenate([[0.0], np.cumsum(held * np.diff(times))])])


@compiled
def _simulate(parameters, bounds, rows, nodes, usual, lightest, substeps, out):  # type: ignore[no-untyped-def]
    segments = len(bounds) - 1
    for i in range(len(parameters) * segments):
        c, s = i // segments, i % segments
        a, b = bounds[s], bounds[s + 1]
        own, held = rows[:, a:b], nodes[:, a + 2 * s : b + 2 * s + 2]
        _segment(parameters[c], own, held, usual, lightest, substeps, out[c, a:b])


@compiled
def _segment(p, rows, nodes, usual, lightest, substeps, out):  # type: ignore[no-untyped-def]
    """Simulate one segment with one set of parameters, in the order of `servo_parameters.NAMES`.

    The bristle's stiffness is that of the friction at the ``usual`` load, as in the plant, and is
    one number: a stiffness that followed the length of a row or the pose would make a joint that
    sticks creep. It holds for the ``lightest`` inertia [kg·m²].
    """
    t, measured, gravity, slope, inertia, coupling = rows
    times, integral = nodes
    stiffness, viscous, armature, delay, stiction, drop, stribeck, load = p[:8]
    presliding, limit, fastest, dead, offset, compensated = p[8:]
    last = len(times) - 2
    i = 0
    late = t[0] - delay
    while i < last and times[i + 1] <= late:
        i += 1
    rate = (integral[i + 1] - integral[i]) / (times[i + 1] - times[i])
    passed = integral[i] + rate * (late - times[i])
    reference = rate
    angle, speed = measured[0] - offset, 0.0
    weight = gravity[0] - slope[0] * offset
    pull = (1.0 - compensated) * weight + coupling[0]
    level = max(stiction + load * abs(weight), 1e-6)
    push = _servo(reference - angle - offset, stiffness, dead, limit) - pull
    stiffest = max(stiction + load * usual, 1e-6) / presliding
    least = SLOWEST * STEP * STEP * stiffness
    bristle = min(stiffest, STIFFEST * max(lightest + armature, least) / (STEP * STEP))
    # at rest the bristle carries what it can
    deflection = max(-level, min(level, push)) / bristle
    n = len(out)
    for k in range(n - 1):
        out[k] = angle + offset
        h = (t[k + 1] - t[k]) / substeps
        mass = max(inertia[k] + armature, least)
        damping = max(2.0 * BRISTLE_DAMPING_RATIO * np.sqrt(bristle * mass), 3.0 * h * bristle)
        for j in range(substeps):
            part = j / substeps
            # mean of the held command over the step, so that a delay acts smoothly
            late += h
            while i < last and times[i + 1] <= late:
                i += 1
            rate = (integral[i + 1] - integral[i]) / (times[i + 1] - times[i])
            now = integral[i] + rate * (late - times[i])
            change = (now - passed) / h - reference
            passed = now
            reference += max(-fastest * h, min(fastest * h, change))
            u = _servo(reference - angle - offset, stiffness, dead, limit)
            where = measured[k] + part * (measured[k + 1] - measured[k])
            weight = gravity[k] + part * (gravity[k + 1] - gravity[k]) + slope[k] * (angle - where)
            pull = (1.0 - compensated) * weight + coupling[k]
            level = max(stiction + load * abs(weight), 1e-6)
            g = level
            if drop > 0.0:
                g *= 1.0 - drop + drop * np.exp(-((speed / stribeck) ** 2))
            a = max(abs(speed) * bristle * h / g, 1e-15)
            force = u - pull - bristle * deflection + damping * (a / h * deflection - speed)
            deflection = bristle_after(deflection, speed, a, h)
            # joint damping is implicit, as in MuJoCo's Euler
            speed = (speed + h / mass * force) / (1.0 + h / mass * viscous)
            angle += h * speed
    out[n - 1] = angle + offset


@compiled
def _servo(error, stiffness, dead, limit):  # type: ignore[no-untyped-def]
    """Return the servo's torque [N·m]: proportional outside the dead zone, limited."""
    if error > dead:
        error -= dead
    elif error < -dead:
        error += dead
    else:
        error = 0.0
    return max(-limit, min(limit, stiffness * error))
