"""Compiled functions of `trajectory`: straight movements at trapezoidal speed, goal after goal.

Arms are computed one after the other in plain arithmetic: the same bits in any batch.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.control.rotation import angle_one, slerp_one

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Reference = tuple[Array, Array, Array, Array]
"""Position (N, 3) [m], quaternion (N, 4), velocity (N, 3) [m/s], angular speed (N,) [rad/s]."""
Profile = tuple[Array, Array, Array, bool]
"""Of translation and rotation (2,): accelerations, decelerations, largest speeds; synchronised."""
Trapezoid = tuple[Array, ...]
"""Start (N, 3) [m], its quaternion (N, 4), goal, its quaternion; of translation and rotation
(N, 2) distance [m, rad], times of rise, flat and fall [s], pace [-]; direction of the translation
(N, 3), pace that was asked for (N,) [-], duration (N,) [s]."""
_TINY = np.finfo(np.float64).tiny


@compiled
def plan(
    rows: Index,
    position: Array,
    quaternion: Array,
    goal_position: Array,
    goal_quaternion: Array,
    profile: Profile,
    trapezoid: Trapezoid,
) -> None:
    """Write the movements of arms ``rows`` (M,) of a `Segment`; arguments as of its `start`."""
    for m in range(len(rows)):
        _plan_one(
            rows[m],
            position[m],
            quaternion[m],
            goal_position[m],
            goal_quaternion[m],
            profile,
            trapezoid,
        )


@compiled
def _plan_one(
    i: int,
    position: Array,
    quaternion: Array,
    goal_position: Array,
    goal_quaternion: Array,
    profile: Profile,
    trapezoid: Trapezoid,
) -> None:
    """`plan` of one arm."""
    accelerations, decelerations, speeds, synchronised = profile
    start, start_q, goal, goal_q, distance, rise, flat, fall, pace, direction = trapezoid[:10]
    asked, duration = trapezoid[10:]
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
        a, b, v, d = accelerations[k], decelerations[k], speeds[k], distance[i, k]
        up = min(v / a, np.sqrt(2.0 * d * b / (a * (a + b))))
        peak = a * up
        down = peak / b
        level = max(d - 0.5 * peak * (up + down), 0.0) / v
        # where v_max is not reached a triangle, but for rounding
        rise[i, k], flat[i, k], fall[i, k] = up, 0.0 if up < v / a else level, down
        duration[i] = max(duration[i], up + flat[i, k] + down)
    for k in range(2):
        time = rise[i, k] + flat[i, k] + fall[i, k]
        pace[i, k] = time / duration[i] if synchronised and duration[i] > 0.0 else 1.0
        pace[i, k] *= asked[i]
    duration[i] /= asked[i]


@compiled
def sample(clock: Array, profile: Profile, trapezoid: Trapezoid) -> Reference:
    """Return the reference at times ``clock`` (N,) [s] of the arms of a `Segment`."""
    n = len(clock)
    position, quaternion = np.empty((n, 3)), np.empty((n, 4))
    velocity, speed = np.empty((n, 3)), np.empty((n, 2))
    write_sample(clock, profile, trapezoid, position, quaternion, velocity, speed)
    return position, quaternion, velocity, speed[:, 1].copy()


@compiled
def write_sample(
    clock: Array,
    profile: Profile,
    trapezoid: Trapezoid,
    position: Array,
    quaternion: Array,
    velocity: Array,
    speed: Array,
) -> None:
    """Write `sample`, and the speed of translation and rotation (N, 2) [m/s, rad/s]."""
    accelerations, decelerations, _, _ = profile
    start, start_q, goal, goal_q, distance, rise, flat, fall, pace, direction = trapezoid[:10]
    duration = trapezoid[11]
    share = np.empty(2)
    for i in range(len(clock)):
        for k in range(2):
            share[k], speed[i, k] = _profile_at(
                clock[i],
                accelerations[k],
                decelerations[k],
                distance[i, k],
                rise[i, k],
                flat[i, k],
                fall[i, k],
                pace[i, k],
                duration[i],
            )
        for k in range(3):
            between = start[i, k] + share[0] * (goal[i, k] - start[i, k])
            position[i, k] = goal[i, k] if share[0] == 1.0 else between
            velocity[i, k] = speed[i, 0] * direction[i, k]
        slerp_one(start_q[i], goal_q[i], share[1], quaternion[i])


@compiled
def _profile_at(
    t: float,
    acceleration: float,
    deceleration: float,
    distance: float,
    rise: float,
    flat: float,
    fall: float,
    pace: float,
    duration: float,
) -> tuple[float, float]:
    """Return the share of the distance covered after time t [s], and the speed."""
    local_time = max(t, 0.0) * pace
    rising = min(local_time, rise)
    local_time -= rise
    level = min(max(local_time, 0.0), flat)
    local_time -= flat
    falling = min(max(local_time, 0.0), fall)
    peak = acceleration * rise
    covered = 0.5 * acceleration * rising * rising + peak * level
    covered += (peak - 0.5 * deceleration * falling) * falling
    share = covered / distance
    speed = max(acceleration * rising - deceleration * falling, 0.0) * pace
    if t >= duration or distance <= _TINY or share > 1.0:
        share = 1.0
    if t >= duration or t <= 0.0:
        speed = 0.0
    return share, speed


@compiled
def accept(
    position: Array,
    quaternion: Array,
    now: Array,
    tolerances: tuple[float, float, float],
    goals: tuple[Array, Array, Index, Index],
    times: tuple[Array, Array, Array, Array],
    profile: Profile,
    trapezoid: Trapezoid,
    out: NDArray[np.bool_],
) -> None:
    """`GoalSequencer.accept` at times ``now`` (N,), with its arrays in its order; ``out`` (N,) is
    written."""
    near_position, near_rotation, patience = tolerances
    goal, goal_q, count, index = goals
    accepted, reached, begun, due = times
    for i in range(len(now)):
        out[i] = False
        if not now[i] >= due[i]:
            continue
        at = index[i]
        square = 0.0
        for k in range(3):
            square += (position[i, k] - goal[i, at, k]) ** 2
        near = np.sqrt(square) <= near_position
        near &= angle_one(quaternion[i], goal_q[i, at]) <= near_rotation
        if near or now[i] >= due[i] + patience:
            reached[i, at] = now[i]
            at += 1
            index[i], due[i] = at, np.inf
            if at < count[i]:
                out[i] = True
                _plan_one(
                    i, position[i], quaternion[i], goal[i, at], goal_q[i, at], profile, trapezoid
                )
                accepted[i, at] = begun[i] = now[i]
                due[i] = now[i] + trapezoid[11][i]
