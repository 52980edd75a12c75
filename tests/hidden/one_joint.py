"""One joint with the friction law of `hidden.friction_law`, integrated in plain numpy."""

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.hidden.friction_law import Array, LuGre


def simulate_joint(
    law: LuGre,
    torque: Array,
    *,
    dt: float,
    inertia: ArrayLike,
    stiffness: float = np.inf,
    link_inertia: ArrayLike = 1.0,
    damping: float = 0.0,
) -> tuple[Array, Array]:
    """Integrate one joint (or many in columns) under a torque history; semi-implicit Euler.

    ``torque`` (T, ...) [N·m] acts on the rotor, one row per step ``dt`` [s]. ``inertia`` [kg·m²] is
    that of the rotor, with the link's added if the joint is rigid: ``stiffness`` [N·m/rad] inf.
    Else ``link_inertia`` and ``damping`` [N·m·s/rad] are those behind and of the spring.

    Returns:
        (q, z): link position [rad] and bristle deflection [rad], (T, ...) after each step.
    """
    shape = np.broadcast_shapes(torque.shape[1:], np.shape(inertia), np.shape(law.stiction))
    theta, omega, z, q, v = (np.zeros(shape) for _ in range(5))
    rigid = not np.isfinite(stiffness)
    out_q, out_z = np.empty((len(torque), *shape)), np.empty((len(torque), *shape))
    for k, u in enumerate(torque):
        spring = 0.0 if rigid else stiffness * (theta - q) + damping * (omega - v)
        friction = law.torque(z, omega)
        z = law.advance(z, omega, dt)
        omega = omega + dt * (u - friction - spring) / np.asarray(inertia)
        theta = theta + dt * omega
        if rigid:
            q = theta
        else:
            v = v + dt * spring / np.asarray(link_inertia)
            q = q + dt * v
        out_q[k], out_z[k] = q, z
    return out_q, out_z
