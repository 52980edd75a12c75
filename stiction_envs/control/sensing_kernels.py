"""Compiled functions of `sensing`: measurements of a controller, delay of its commands.

Random numbers are hashed from (seed of the simulation, control step, channel) by SplitMix64
(sources.md 8.1), as if that generator could be read anywhere: no bit depends on what else is
simulated.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Array, Index
from stiction_envs.compiled import compiled
from stiction_envs.dither.waveforms import GOLDEN, mix

_ONE, _HIGH = np.uint64(1), np.uint64(11)
_STRIDE, _OWN = 64, 48
"""Channels of a control step: four of each joint, and those of the whole arm from `_OWN` on."""
MISSED = _OWN + 1  # Channel of an arm
_mix = compiled(mix)


class Measured(NamedTuple):
    """Senses of N arms of n joints; numbers of a joint are (n,)."""

    speed_by_difference: bool
    cycle: float  # Time between two readings [s]
    speed_gain: float  # Gain of the low-pass behind the difference of angles [-]; 1 is none
    delay: float  # [control steps]
    lag_gain: Array  # Gain per control step of the filter of the logged speed [-]; 1 is none
    angle_noise: Array
    angle_resolution: Array
    speed_noise: Array
    seed: NDArray[np.uint64]  # (N,)
    past: Array  # (N, R, 2, n) q, dq of the last R control steps [rad, rad/s]
    q: Array  # (N, n) what was read last [rad]
    dq: Array  # (N, n) [rad/s]


class Sent(NamedTuple):
    """Commands of N arms on their way to C joints."""

    missed: float  # Probability that a command does not arrive [-]
    delay: float  # [control steps]
    seed: NDArray[np.uint64]  # (N,)
    held: Array  # (N, C) the last command that arrived [N·m]
    past: Array  # (N, R, C) commands of the last R control steps [N·m]
    arrived: Array  # (N, C) what acts now, written [N·m]


@compiled
def uniform(seed: np.uint64, step: int, channel: int) -> float:
    """Return a number in (0, 1], uniform, of a seed, a control step and a channel."""
    z = _mix(seed + np.uint64(step * _STRIDE + channel + _STRIDE - 1) * GOLDEN)
    return np.float64((z >> _HIGH) + _ONE) * 2.0**-53


@compiled
def normals(seed: np.uint64, step: int, channel: int) -> tuple[float, float]:
    """Return two independent normal numbers of two channels (Box & Muller 1958)."""
    radius = np.sqrt(-2.0 * np.log(uniform(seed, step, channel)))
    angle = 2.0 * np.pi * uniform(seed, step, channel + 1)
    return radius * np.cos(angle), radius * np.sin(angle)


@compiled
def _at(past: Array, i: int, step: int, delay: float, kind: int, j: int) -> float:
    """Return a value of ``delay`` control steps before ``step``, straight lines between steps."""
    size = past.shape[1]
    whole = int(np.floor(delay))
    part = delay - whole
    value = past[i, (step - whole) % size, kind, j]
    if part > 0.0:
        value = (1.0 - part) * value + part * past[i, (step - whole - 1) % size, kind, j]
    return value


@compiled
def _rounded(value: float, resolution: float) -> float:
    """Return the nearest multiple of a resolution; 0 is none."""
    return np.rint(value / resolution) * resolution if resolution > 0.0 else value


@compiled
def begin_arm(i: int, q: Array, m: Measured) -> None:
    """Let arm ``i`` have rested at q (n,) [rad] for long."""
    for j in range(len(q)):
        for k in range(m.past.shape[1]):
            m.past[i, k, 0, j], m.past[i, k, 1, j] = q[j], 0.0
        m.q[i, j], m.dq[i, j] = _rounded(q[j], m.angle_resolution[j]), 0.0


@compiled
def sense_arm(due: bool, i: int, step: int, q: Array, dq: Array, m: Measured) -> None:
    """Note the state of arm ``i`` at a control step; where ``due``, read the sensors.

    True angles [rad] and speeds [rad/s] are (n,); steps count from the arm's start.
    """
    size = m.past.shape[1]
    now, before = step % size, (step - 1) % size
    for j in range(len(q)):
        gain = m.lag_gain[j]
        speed = dq[j]
        if gain < 1.0:
            last = m.past[i, before, 1, j]
            speed = last + gain * (dq[j] - last)
        m.past[i, now, 0, j], m.past[i, now, 1, j] = q[j], speed
    if not due:
        return
    for j in range(len(q)):
        angle, speed = _at(m.past, i, step, m.delay, 0, j), _at(m.past, i, step, m.delay, 1, j)
        if m.angle_noise[j] > 0.0 or m.speed_noise[j] > 0.0:
            one, two = normals(m.seed[i], step, 4 * j)
            angle += m.angle_noise[j] * one
            speed += m.speed_noise[j] * two
        angle = _rounded(angle, m.angle_resolution[j])
        if m.speed_by_difference:
            slope = (angle - m.q[i, j]) / m.cycle
            speed = m.dq[i, j] + m.speed_gain * (slope - m.dq[i, j])
        m.q[i, j], m.dq[i, j] = angle, speed


@compiled
def sense_block(
    ids: Index, step: Index, hold: int, dt: float, q: Array, m: Measured, seen: Array
) -> None:
    """Run `sense_arm` for arms ``ids`` (M,) in K control steps, from their angles alone.

    The speed of a control step is the mean within it. Steps are (M, K), of ``dt`` [s], with
    ``hold`` between two readings; angles q and those ``seen``, written, are (M, K, n) [rad].
    """
    size, n = m.past.shape[1], q.shape[2]
    speed = np.empty(n)
    for row in range(len(ids)):
        i = ids[row]
        for k in range(q.shape[1]):
            now = step[row, k]
            for j in range(n):
                last = m.past[i, (now - 1) % size, 0, j]
                speed[j] = (q[row, k, j] - last) / dt
            sense_arm(now % hold == 0, i, now, q[row, k], speed, m)
            for j in range(n):
                seen[row, k, j] = m.q[i, j]


@compiled
def send_arm(due: bool, i: int, step: int, command: Array, s: Sent) -> None:
    """Send a command (C,) of arm ``i``; write what arrives in this control step."""
    size = s.past.shape[1]
    lost = due and s.missed > 0.0 and uniform(s.seed[i], step, MISSED) <= s.missed
    whole = int(np.floor(s.delay))
    part = s.delay - whole
    for c in range(len(command)):
        if due and not lost:
            s.held[i, c] = command[c]
        s.past[i, step % size, c] = s.held[i, c]
        value = s.past[i, (step - whole) % size, c]
        if part > 0.0:
            value = (1.0 - part) * value + part * s.past[i, (step - whole - 1) % size, c]
        s.arrived[i, c] = value


@compiled
def send_block(ids: Index, step: Index, hold: int, command: Array, s: Sent) -> None:
    """Send commands (M, K, C) [N·m] of arms ``ids`` at steps (M, K); they become what arrives."""
    for row in range(len(ids)):
        i = ids[row]
        for k in range(command.shape[1]):
            send_arm(step[row, k] % hold == 0, i, step[row, k], command[row, k], s)
            for c in range(command.shape[2]):
                command[row, k, c] = s.arrived[i, c]
