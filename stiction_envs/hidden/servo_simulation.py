"""Arms under position servos in stock MuJoCo, for servo logs with hidden causes.

    u = clip(K (r − q), ±limit)   r: the command, late and rate-limited; less a dead zone
    F = F_s + μ |gravity|         level of stiction in the law of `friction_law`, which falls to
                                  (1 − s) F in motion

The fit of servo logs uses no line of this file; both have the names of the parameters in common
(`gap.servo.servo_parameters`).
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.compiled import compiled
from stiction_envs.errors import ExperimentError
from stiction_envs.gap.servo.servo_parameters import INDEX
from stiction_envs.hidden.worlds import STEP, add_to_flange
from stiction_envs.robots import Arm

LIGHTEST = 1e-4
"""Least inertia of a joint over its servo's stiffness [s²]: a rotor makes up for lighter links;
assumed."""
STIFFEST = 2.5e4  # largest stiffness of a bristle over the joint's inertia [1/s²]; assumed
BRISTLE_DAMPING_RATIO = 0.4  # assumed


def weightless(
    arm: Arm, payload: Sequence[float] | None = None
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return an arm whose gravity is compensated, so that ``qfrc_gravcomp`` holds its weight.

    ``payload`` is mass [kg] and centre of mass x, y, z in the flange's frame [m].
    """
    spec = arm.spec()
    if payload is not None:
        add_to_flange(spec, arm.end_effector, payload[0], payload[1:])
    for body in spec.bodies[1:]:
        body.gravcomp = 1.0
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model = spec.compile()
    return model, mujoco.MjData(model)


def weights(model: mujoco.MjModel, data: mujoco.MjData, q: Array) -> Array:
    """Return (T, n) gravity of an arm of `weightless` at angles (T, n) [N·m]."""
    out = np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:] = q[k]
        mujoco.mj_forward(model, data)
        out[k] = data.qfrc_gravcomp
    return out


def simulate(
    arm: Arm,
    parameters: Array,
    t: Array,
    command: Array,
    start: Array,
    payload: Sequence[float] | None = None,
) -> Array:
    """Return (T, n) angles at times t as the encoders show them, from rest [rad].

    Args:
        arm: the rigid arm.
        parameters: (n, P) of its joints, in the order of `gap.servo.servo_parameters`.
        t: (T,) times of the commands [s], each held until the next.
        command: (T, n) [rad].
        start: (n,) first angles as the encoders show them [rad].
        payload: see `weightless`.

    Raises:
        ExperimentError: a simulation that diverged.
    """
    p = {name: np.array(parameters[:, k]) for name, k in INDEX.items()}
    model, data = weightless(arm, payload)
    load = p["load"] * np.abs(weights(model, data, command)).mean(axis=0)
    data.qpos[:] = start - p["offset"]
    mujoco.mj_forward(model, data)
    mass = np.empty((arm.n, arm.n))
    mujoco.mj_fullM(model, data, mass)
    inertia = np.maximum(np.diag(mass) + p["armature"], LIGHTEST * p["stiffness"])
    model.dof_armature[:] = inertia - np.diag(mass)
    q, v, weight, force = data.qpos, data.qvel, data.qfrc_gravcomp, data.qfrc_applied
    usual = np.maximum(p["stiction"] + load, 1e-6)
    bristle = np.minimum(usual / p["bristle"], STIFFEST * inertia)
    damping = 2.0 * BRISTLE_DAMPING_RATIO * np.sqrt(bristle * inertia)
    model.dof_damping[:] = p["damping"] + damping  # MuJoCo's Euler takes damping implicitly
    names = ("stiffness", "torque_limit", "speed_limit", "dead_zone", "compensation")
    friction = ("stiction", "load", "drop", "stribeck_velocity")
    constants = np.stack([*(p[x] for x in (*names, *friction)), bristle, damping], axis=1)
    steps = int(np.ceil((t[-1] - t[0]) / STEP)) + 1
    late = t[0] + STEP * np.arange(steps)[:, None] - p["delay"] + 1e-9
    row = np.maximum(np.searchsorted(t, late, side="right") - 1, 0)
    told = np.take_along_axis(command, row, axis=0) - p["offset"]
    reference, deflection = told[0].copy(), np.zeros(arm.n)
    # at rest the bristles carry what they can
    _advance(told[0], reference, q, v, weight, deflection, constants, force)
    level = np.maximum(p["stiction"] + p["load"] * np.abs(weight), 1e-6)
    deflection[:] = np.clip(force, -level, level) / bristle
    angle = np.empty((steps + 1, arm.n))
    angle[0] = q
    for k in range(steps):
        _advance(told[k], reference, q, v, weight, deflection, constants, force)
        mujoco.mj_step(model, data)
        angle[k + 1] = q
    if data.warning.number.any():
        raise ExperimentError(f"{arm.name}: MuJoCo's simulation of its servos diverged")
    grid = t[0] + STEP * np.arange(steps + 1)
    columns = [np.interp(t, grid, x) for x in angle.T]
    return np.stack(columns, axis=1) + p["offset"]


@compiled
def _advance(  # type: ignore[no-untyped-def]
    command, reference, q, v, weight, deflection, constants, force
):
    """Write the torques at the start of a step; take reference and bristles to its end."""
    for j in range(len(q)):
        stiffness, limit, fastest, dead, compensated = constants[j, :5]
        stiction, load, drop, stribeck, bristle, damping = constants[j, 5:]
        most = fastest * STEP
        reference[j] += max(-most, min(most, command[j] - reference[j]))
        error = reference[j] - q[j]
        error -= max(-dead, min(dead, error))
        servo = max(-limit, min(limit, stiffness * error))
        level = max(stiction + load * abs(weight[j]), 1e-6)
        level *= 1.0 - drop + drop * np.exp(-((v[j] / stribeck) ** 2))
        rate = bristle * abs(v[j]) / level
        friction = (bristle - damping * rate) * deflection[j]  # and damping · v, see above
        force[j] = servo - (1.0 - compensated) * weight[j] - friction
        left = np.exp(-rate * STEP)
        passed = v[j] * STEP if rate < 1e-9 else v[j] * (1.0 - left) / rate
        deflection[j] = left * deflection[j] + passed
