"""Compiled functions of `trajectory`: straight movements at trapezoidal speed, goal after goal.

Arms are computed one after the other in plain arithmetic: the same bits in any batch.
"""

from typing import NamedTuple

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.compiled import compiled, inlined
from stiction_envs.control.rotation import angle_one, slerp_one, write_one_error_matrix

Reference = tuple[Array, Array, Array, Array]
"""Position (N, 3) [m], quaternion (N, 4), velocity (N, 3) [m/s], angular speed (N,) [rad/s]."""
_TINY = np.finfo(np.float64).tiny


class Movement(NamedTuple):
    """One straight movement of each of N arms from rest to rest; pairs: translation, rotation.

    Speed rises with the acceleration a, stays at v_max and falls with the deceleration b. Where the
    distance d is too short for v_max, it rises for t_acc = √(2 d b/(a (a + b))), then falls. The
    orientation turns about one axis along the shorter arc. The shorter of both in time is stretched
    to the longer: the same profile, run more slowly, so that it keeps the limits too.
    """

    acceleration: Array  # (2,) [m/s², rad/s²]
    deceleration: Array  # (2,) [m/s², rad/s²]
    speed: Array  # (2,) largest speeds [m/s, rad/s]
    start: Array  # (N, 3) [m]
    start_q: Array  # (N, 4)
    goal: Array  # (N, 3) [m]
    goal_q: Array  # (N, 4)
    distance: Array  # (N, 2) [m, rad]
    rise: Array  # (N, 2) time of rising speed [s]
    flat: Array  # (N, 2) time of constant speed [s]
    fall: Array  # (N, 2) time of falling speed [s]
    pace: Array  # (N, 2) speed over that of the limits [-]
    direction: Array  # (N, 3) of the translation
    asked: Array  # (N,) pace that was asked for [-]
    duration: Array  # (N,) [s]


class Goals(NamedTuple):
    """Goals of N arms, G each at most."""

    near_position: float  # Largest distance from a goal that is reached [m]
    near_rotation: float  # Largest angle from a goal that is reached [rad]
    patience: float  # Time after its movement's end when a goal counts as reached [s]
    goal: Array  # (N, G, 3) [m]
    goal_q: Array  # (N, G, 4)
    total: Index  # (N,) goals of each arm
    current: Index  # (N,) goal that an arm is moving to
    accepted: Array  # (N, G) times at which goals were accepted [s], NaN where not yet
    reached: Array  # (N, G) times at which goals were reached [s], NaN where not yet
    begun: Array  # (N,) when the present movement began [s]
    due: Array  # (N,) when the present movement ends [s], inf for no movement


@compiled
def plan(
    i: int,
    position: Array,
    quaternion: Array,
    goal_position: Array,
    goal_quaternion: Array,
    a: Movement,
) -> None:
    """Write the movement of arm ``i`` from a pose (3,) [m], (4,) to a goal (3,) [m], (4,)."""
    start, start_q, goal, goal_q, distance = a.start, a.start_q, a.goal, a.goal_q, a.distance
    rise, flat, fall, pace, direction = a.rise, a.flat, a.fall, a.pace, a.direction
    asked, duration = a.asked, a.duration
    square = 0.0
    for k in range(3):
        start[i, k], goal[i, k] = position[k], goal_position[k]
        direction[i, k] = goal[i, k] - start[i, k]
        square += direction[i, k] * direction[i, k]
    for k in range(4):
        start_q[i, k], goal_q[i, k] = quaternion[k], goal_quaternion[k]
    distance[i, 0], distance[i, 1] = np.sqrt(square), angle_one(start_q[i], goal_q[i])
    for k in range(3):
        direction[i, k] /= max(distance[i, 0], _TINY)
    duration[i] = 0.0
    for k in range(2):
        up_rate, down_rate, v, d = a.acceleration[k], a.deceleration[k], a.speed[k], distance[i, k]
        up = min(v / up_rate, np.sqrt(2.0 * d * down_rate / (up_rate * (up_rate + down_rate))))
        peak = up_rate * up
        down = peak / down_rate
        level = max(d - 0.5 * peak * (up + down), 0.0) / v
        # where v_max is not reached a triangle, but for rounding
        rise[i, k], flat[i, k], fall[i, k] = up, 0.0 if up < v / up_rate else level, down
        duration[i] = max(duration[i], up + flat[i, k] + down)
    for k in range(2):
        time = rise[i, k] + flat[i, k] + fall[i, k]
        pace[i, k] = time / duration[i] if duration[i] > 0.0 else 1.0
        pace[i, k] *= asked[i]
    duration[i] /= asked[i]


@compiled
def sample(clock: Array, movement: Movement) -> Reference:
    """Return the reference at times ``clock`` (N,) [s] after the movements began.

    Before 0 it rests exactly at the start, from the duration on exactly at the goal. The sign of a
    quaternion continues from the start's.
    """
    n = len(clock)
    position, quaternion = np.empty((n, 3)), np.empty((n, 4))
    velocity, speed = np.empty((n, 3)), np.empty(n)
    for i in range(n):
        moving, speed[i] = write_sample(i, clock[i], movement, position[i], quaternion[i])
        for k in range(3):
            velocity[i, k] = moving * movement.direction[i, k]
    return position, quaternion, velocity, speed


@inlined
def write_sample(
    i: int, clock: float, a: Movement, position: Array, quaternion: Array
) -> tuple[float, float]:
    """Write position (3,) [m] and quaternion (4,) of the reference of arm ``i``; return its speeds.

    ``clock`` [s] counts from the movement's beginning; speeds are in m/s and rad/s.
    """
    moved, speed = _profile_at(i, 0, clock, a)
    turned, turning = _profile_at(i, 1, clock, a)
    for k in range(3):
        between = a.start[i, k] + moved * (a.goal[i, k] - a.start[i, k])
        position[k] = a.goal[i, k] if moved == 1.0 else between
    slerp_one(a.start_q[i], a.goal_q[i], turned, quaternion)
    return speed, turning


@compiled
def write_twist(i: int, clock: float, a: Movement, out: Array) -> None:
    """Write the velocity (6,) of the reference of arm ``i`` a time ``clock`` [s] after its
    movement began: linear [m/s], angular [rad/s]."""
    speed, turning = write_sample(i, clock, a, np.empty(3), np.empty(4))
    for k in range(3):
        out[k] = speed * a.direction[i, k]
    matrix, difference = np.empty((4, 4)), np.empty(4)
    write_one_error_matrix(a.start_q[i], matrix)
    for k in range(4):
        row = matrix[k] * a.goal_q[i]
        difference[k] = (row[0] + row[2]) + (row[1] + row[3])
    w, x, y, z = difference
    length = np.sqrt((x * x + z * z) + y * y)
    factor = np.copysign(np.arctan2(length, abs(w)) * 2.0 / max(length, _TINY), w)
    x, y, z = x * factor, y * factor, z * factor
    angle = max(np.sqrt((x * x + z * z) + y * y), _TINY)
    out[3], out[4], out[5] = turning * (x / angle), turning * (y / angle), turning * (z / angle)


@inlined
def _profile_at(i: int, k: int, t: float, a: Movement) -> tuple[float, float]:
    """Return the share of the distance covered by arm ``i`` after time t [s], and the speed.

    ``k`` is 0 for the translation, 1 for the rotation.
    """
    acceleration, deceleration, pace = a.acceleration[k], a.deceleration[k], a.pace[i, k]
    local_time = max(t, 0.0) * pace
    rising = min(local_time, a.rise[i, k])
    local_time -= a.rise[i, k]
    level = min(max(local_time, 0.0), a.flat[i, k])
    local_time -= a.flat[i, k]
    falling = min(max(local_time, 0.0), a.fall[i, k])
    peak = acceleration * a.rise[i, k]
    covered = 0.5 * acceleration * rising * rising + peak * level
    covered += (peak - 0.5 * deceleration * falling) * falling
    share = covered / a.distance[i, k]
    speed = max(acceleration * rising - deceleration * falling, 0.0) * pace
    if t >= a.duration[i] or a.distance[i, k] <= _TINY or share > 1.0:
        share = 1.0
    if t >= a.duration[i] or t <= 0.0:
        speed = 0.0
    return share, speed


@inlined
def accept(
    i: int, position: Array, quaternion: Array, now: float, goals: Goals, movement: Movement
) -> bool:
    """Let arm ``i`` at a measured pose (3,) [m], (4,) start towards its next goal, if it may.

    Return whether it has accepted a new goal at time ``now`` [s].
    """
    if not now >= goals.due[i]:
        return False
    at = goals.current[i]
    square = 0.0
    for k in range(3):
        square += (position[k] - goals.goal[i, at, k]) ** 2
    near = np.sqrt(square) <= goals.near_position
    near &= angle_one(quaternion, goals.goal_q[i, at]) <= goals.near_rotation
    if not (near or now >= goals.due[i] + goals.patience):
        return False
    goals.reached[i, at] = now
    at += 1
    goals.current[i], goals.due[i] = at, np.inf
    if at >= goals.total[i]:
        return False
    plan(i, position, quaternion, goals.goal[i, at], goals.goal_q[i, at], movement)
    goals.accepted[i, at] = goals.begun[i] = now
    goals.due[i] = now + movement.duration[i]
    return True
