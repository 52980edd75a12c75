"""A control step of `GTERig`, in one call of compiled code.

Called one by one from Python, these functions would spend half of the time between their calls.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.control.compensation import compensate
from stiction_envs.control.kernels import impedance_cycle, pass_torque, site_kinematics
from stiction_envs.dither.kernels import sine
from stiction_envs.friction.model import link_angles
from stiction_envs.plant import CONTROL_DT

Array = NDArray[np.float64]


@compiled
def control_step(
    due: bool,
    site: tuple[Any, ...],
    joints: tuple[Any, ...],
    sines: tuple[bool, Array, Array, Array],
    step: NDArray[np.int64],
    compensation: tuple[bool, tuple[Array, Array, Array, Array, Array], Array],
    modelled: tuple[Array, Array],
    impedance: tuple[Any, ...],
    path: tuple[Array, float, Array, Array, Array],
    missing: Array,
    shaking: Array,
    applied: Array,
    torque: Array,
) -> None:
    """Read the end effector and, where ``due``, compute the next command; pass the command on.

    Args:
        due: whether the controller computes in this step, or its command is held.
        site: of `site_kinematics`; the last three are what it writes.
        joints: (N, nq) positions [rad], (N, nv) speeds [rad/s], and the last two of `link_angles`.
        sines: whether the dither is nothing else but sines, then the first three of `sine`;
            any other dither is in ``shaking`` already.
        step: (N,) control steps since the arm began to follow.
        compensation: whether any arm is compensated; the last five of `compensate`; (N, n) dither
            and compensation together, written where so [N·m].
        modelled: of `impedance_cycle`, Coriolis torque and gravity correction (N, n) [N·m].
        impedance: of `impedance_cycle` behind the dither; the last is what it writes.
        path: of `pass_torque` between command and result.
        missing: (N, n) torque that acts besides, gravity compensated wrongly [N·m].
        shaking: (N, n) dither, sines are written where ``due`` [N·m].
        applied: (N, n) what the joints get of the command, written [N·m].
        torque: (N, n) the sum of that and ``missing``, written [N·m].
    """
    site_kinematics(*site)
    if due:
        qpos, qvel, motor, spring = joints
        plain, omega, phase, amplitude = sines
        if plain:
            sine(omega, phase, amplitude, step.astype(np.float64) * CONTROL_DT, shaking)
        dq = link_angles(qvel, motor, spring)
        compensated, arguments, added = compensation
        extra = shaking
        if compensated:
            reference, error_matrix, stiffness = impedance[3], impedance[4], impedance[5]
            compensate(
                site[-3], site[-2], site[-1], dq, reference, error_matrix, stiffness, *arguments
            )
            for i in range(added.shape[0]):
                for j in range(added.shape[1]):
                    added[i, j] = shaking[i, j] + arguments[-1][i, j]
            extra = added
        impedance_cycle(
            site[-3],
            site[-2],
            site[-1],
            link_angles(qpos, motor, spring),
            dq,
            *modelled,
            extra,
            *impedance,
        )
    pass_torque(impedance[-1], *path, applied)
    for i in range(torque.shape[0]):
        for j in range(torque.shape[1]):
            torque[i, j] = applied[i, j] + missing[i, j]
