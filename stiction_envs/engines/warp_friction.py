"""What MuJoCo's LuGre lacks, on Warp's device: direction, and what changes slowly.

The friction of both directions of every joint is on the device, which takes that of the present
one. Load, warm-up and offset change it every `SLOW_STEPS` control steps: between calls the plant
writes what they make of it; within a call of many control steps the device does, by the same law.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from stiction_envs.compiled import Arguments
from stiction_envs.friction.load_sensor import LoadSensor
from stiction_envs.friction.model import COULOMB, STICTION, STRIBECK, StickingModel

if TYPE_CHECKING:
    import mujoco_warp

Array = NDArray[np.float64]
Index = NDArray[np.int64]
VECTOR = wp.types.vector(length=10, dtype=wp.float32)
BY_DIRECTION = ("coulomb_ratio", "stiction", "stribeck_velocity", "viscous")
"""Quantities of `_renew`, in its order."""
OTHERS = (
    *("load_low", "load_high", "load_coefficient"),
    *("warm_up_friction", "warm_up_viscous", "warm_up_time"),
    *("offset", "gravity_error"),
)
"""Quantities of `_renew`, in its order; the factor of the dry friction comes behind them."""
LEAST = wp.constant(wp.float64(1e-3))
"""Stiction that load cannot take away, over that without load [-]; as `Plant`."""


@wp.kernel(enable_backward=False)
def _switch(
    step: wp.array[wp.int32],
    every: int,
    dofs: wp.array[wp.int32],
    actuators: wp.array[wp.int32],
    columns: wp.vec3i,
    levels: wp.array3d[wp.vec4],
    qvel: wp.array2d[wp.float32],
    up: wp.array2d[wp.bool],
    biasprm: wp.array2d[VECTOR],
    damping: wp.array2d[wp.float32],
) -> None:
    """Write the friction of the direction in which a joint moves, or moved last."""
    world, joint = wp.tid()
    if step[1] % every != 0:
        return
    speed = qvel[world, dofs[joint]]
    if speed != 0.0:
        up[world, joint] = speed > 0.0
    level = levels[world, joint, wp.where(up[world, joint], 0, 1)]
    values = biasprm[world, actuators[joint]]
    for k in range(3):
        values[columns[k]] = level[k]
    biasprm[world, actuators[joint]] = values
    damping[world, dofs[joint]] = level[3]


@wp.func
def _wide(v: wp.vec3) -> wp.vec3d:
    return wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))


@wp.kernel(enable_backward=False)
def _renew(
    ahead: int,
    every: int,
    timestep: wp.float64,
    steps: wp.array[wp.int32],
    bodies: wp.array[wp.int32],
    joints: wp.array[wp.int32],
    weight: wp.array[wp.vec3d],
    bearing: wp.array[wp.bool],
    own: wp.array3d[wp.float64],
    sided: wp.array4d[wp.float64],
    com: wp.array2d[wp.vec3],
    anchor: wp.array2d[wp.vec3],
    axis: wp.array2d[wp.vec3],
    motor: wp.array[wp.int32],
    spring: wp.array[wp.int32],
    levels: wp.array3d[wp.vec4],
    applied: wp.array2d[wp.float32],
) -> None:
    """Write what load, warm-up and offset make of the friction, as `Plant` does."""
    world, joint = wp.tid()
    now = steps[world] + ahead
    if now % every != 0:
        return
    at = joints[joint]
    arm = _wide(com[world, bodies[joint]]) - _wide(anchor[world, at])
    moment = wp.cross(arm, weight[joint])
    about = wp.dot(moment, _wide(axis[world, at]))
    signed = -about
    if bearing[joint]:
        signed = wp.sqrt(wp.max(wp.dot(moment, moment) - about * about, wp.float64(0.0)))
    low, high = own[world, joint, 0], own[world, joint, 1]
    growth = own[world, joint, 2] * wp.min(wp.max(wp.abs(signed), low), high)
    cold = wp.exp(-(wp.float64(now) * timestep) / own[world, joint, 5])
    dry = own[world, joint, 8] * (wp.float64(1.0) + own[world, joint, 3] * cold)
    wet = wp.float64(1.0) + own[world, joint, 4] * cold
    for side in range(2):
        still = sided[world, joint, side, 1]
        stiction = wp.max(still + growth, LEAST * still) * dry
        levels[world, joint, side] = wp.vec4(
            wp.float32(stiction * sided[world, joint, side, 0]),
            wp.float32(stiction),
            wp.float32(sided[world, joint, side, 2]),
            wp.float32(sided[world, joint, side, 3] * wet),
        )
    clipped = wp.min(wp.max(signed, -high), high)
    bias = wp.float32(-(own[world, joint, 6] + own[world, joint, 7] * clipped))
    applied[world, motor[joint]] = bias
    if spring[joint] >= 0:
        applied[world, spring[joint]] = bias


class DeviceFriction:
    """Friction of both directions of every joint, of which the device takes the present one."""

    def __init__(self, sticking: StickingModel, up: NDArray[np.bool_], every: int) -> None:
        """Make it; see `WarpBatch.carry`."""
        self._shape = up.shape
        self._motor = wp.array(sticking.motor, dtype=wp.int32)
        self._spring = wp.array(sticking.spring, dtype=wp.int32)
        actuators = wp.array(sticking.torque_actuator, dtype=wp.int32)
        columns = wp.vec3i(COULOMB, STICTION, STRIBECK)
        self._where = every, self._motor, actuators, columns
        self._host_up, self._host_levels = up, np.zeros((*up.shape, 2, 4))
        self._up = wp.zeros(up.shape, dtype=wp.bool)
        self._levels = wp.zeros((*up.shape, 2), dtype=wp.vec4)
        self._slow: Arguments = ()

    def write(
        self, ids: Index, coulomb: Array, stiction: Array, stribeck: Array, viscous: Array
    ) -> None:
        """Set the friction of simulations ``ids``, up and down, (M, n, 2).

        Coulomb friction and stiction are in N·m, Stribeck velocities in rad/s, viscous friction in
        N·m·s/rad.
        """
        self._host_levels[ids] = np.stack([coulomb, stiction, stribeck, viscous], axis=-1)

    def change_slowly(
        self,
        sensor: LoadSensor,
        parameters: Mapping[str, Array],
        factor: Array,
        steps: Index,
        every: int,
        timestep: float,
    ) -> None:
        """Prepare a call in which the device renews the friction.

        Args:
            sensor: of the load.
            parameters: the quantities, (N, n) or (N, n, 2).
            factor: (N, n) of the dry friction [-].
            steps: (N,) control steps so far.
            every: control steps from one update to the next.
            timestep: of the control [s].
        """
        sided = np.stack([parameters[name] for name in BY_DIRECTION], axis=-1)
        own = np.stack([*(parameters[name] for name in OTHERS), factor], axis=-1)
        if not self._slow:
            where = (wp.array(x, dtype=wp.int32) for x in (sensor.body, sensor.joint))
            weight = wp.array(sensor.weight, dtype=wp.vec3d)
            self._slow = (
                *(every, timestep, wp.zeros(len(steps), dtype=wp.int32), *where, weight),
                wp.array(sensor.bearing, dtype=wp.bool),
                *(wp.zeros(x.shape, dtype=wp.float64) for x in (own, sided)),
            )
        for k, values in ((2, steps), (-2, own), (-1, sided)):
            self._slow[k].assign(values)

    def send(self) -> None:
        """Send levels and directions to the device."""
        self._levels.assign(self._host_levels)
        self._up.assign(self._host_up)

    def fetch(self, rows: Index) -> None:
        """Fetch the directions."""
        self._host_up[rows] = self._up.numpy()[rows]

    def fetch_levels(self) -> tuple[Array, Array]:
        """Fetch the friction; return stiction [N·m] and viscous friction [N·m·s/rad] (N, n, 2)."""
        self._host_levels[:] = self._levels.numpy()
        return self._host_levels[..., 1], self._host_levels[..., 3]

    def launch(self, step: wp.array, model: mujoco_warp.Model, data: mujoco_warp.Data) -> None:
        """Choose by direction, on the device."""
        wp.launch(
            _switch,
            dim=self._shape,
            inputs=[step, *self._where, self._levels, data.qvel],
            outputs=[self._up, model.actuator_biasprm, model.dof_damping],
        )

    def launch_slow(self, ahead: int, data: mujoco_warp.Data) -> None:
        """Renew where it is due, ``ahead`` control steps after the call began."""
        wp.launch(
            _renew,
            dim=self._shape,
            inputs=[
                *(ahead, *self._slow, data.subtree_com, data.xanchor, data.xaxis),
                *(self._motor, self._spring),
            ],
            outputs=[self._levels, data.qfrc_applied],
        )
