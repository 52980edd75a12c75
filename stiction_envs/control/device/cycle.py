"""Cartesian impedance control of N arms on Warp's device, through many control steps.

    kinematics -> pose, Jacobian -> goals, reference -> dither -> impedance -> torque path -> joints

Every arrow is the compiled function that the host calls, launched on the mirrors of its arrays: the
control law is written once. Of this file are only the arrows' ends: what the engine has in its own
arrays and in float32, the gates of the dither, and what is kept of every step. Pose, error and
torques are float64 as on the host. Float32 would do for the law, not for the clocks: at 20 s and
100 Hz the phase of a dither has steps of 1e-3 rad, and a goal would be accepted 10 ms later.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import warp as wp
from numpy.typing import NDArray

from stiction_envs.control.impedance import CartesianImpedance
from stiction_envs.control.kernels import (
    advance_reference,
    impedance_cycle,
    pass_torque,
    site_kinematics,
)
from stiction_envs.control.kinematics import EndEffector
from stiction_envs.control.torque_path import TorquePath
from stiction_envs.control.trajectory import GoalSequencer
from stiction_envs.control.trapezoid import accept, write_sample
from stiction_envs.dither.dither import Dither
from stiction_envs.dither.kernels import sine
from stiction_envs.engines.mirrors import Mirrors
from stiction_envs.engines.warp_batch import DEVICE
from stiction_envs.plant import CONTROL_DT, Plant

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@wp.kernel(enable_backward=False)
def _take_joints(
    xanchor: wp.array2d[wp.vec3],
    xaxis: wp.array2d[wp.vec3],
    anchor: wp.array3d[wp.float64],
    axis: wp.array3d[wp.float64],
) -> None:
    """Take places and axes of the joints from the engine."""
    world, joint = wp.tid()
    for k in range(3):
        anchor[world, joint, k] = wp.float64(xanchor[world, joint][k])
        axis[world, joint, k] = wp.float64(xaxis[world, joint][k])


@wp.kernel(enable_backward=False)
def _take_site(
    site: int,
    body: int,
    site_xpos: wp.array2d[wp.vec3],
    xquat: wp.array2d[wp.quat],
    position: wp.array2d[wp.float64],
    quaternion: wp.array2d[wp.float64],
) -> None:
    """Take the site's position and its body's orientation from the engine."""
    world = wp.tid()
    for k in range(3):
        position[world, k] = wp.float64(site_xpos[world, site][k])
    for k in range(4):
        quaternion[world, k] = wp.float64(xquat[world, body][k])


@wp.kernel(enable_backward=False)
def _take_angles(
    motor: wp.array[wp.int32],
    spring: wp.array[wp.int32],
    angle: wp.array2d[wp.float64],
    qvel: wp.array2d[wp.float32],
    q: wp.array2d[wp.float64],
    dq: wp.array2d[wp.float64],
) -> None:
    """Take link angles and speeds: `friction.model.link_angles`."""
    world, joint = wp.tid()
    q[world, joint] = angle[world, motor[joint]]
    dq[world, joint] = wp.float64(qvel[world, motor[joint]])
    if spring[joint] >= 0:
        q[world, joint] = q[world, joint] + angle[world, spring[joint]]
        dq[world, joint] = dq[world, joint] + wp.float64(qvel[world, spring[joint]])


@wp.kernel(enable_backward=False)
def _tell_time(
    ahead: int, timestep: wp.float64, step: wp.array[wp.int32], time: wp.array[wp.float64]
) -> None:
    """Write the times since arms began to follow."""
    world = wp.tid()
    time[world] = wp.float64(step[world] + ahead) * timestep


@wp.kernel(enable_backward=False)
def _tell_clock(
    time: wp.array[wp.float64], begun: wp.array[wp.float64], clock: wp.array[wp.float64]
) -> None:
    """Write the times since movements began."""
    world = wp.tid()
    clock[world] = time[world] - begun[world]


@wp.kernel(enable_backward=False)
def gate(
    speed: wp.array2d[wp.float64],
    inverse: wp.array2d[wp.float64],
    offset: wp.array2d[wp.float64],
    torque: wp.array2d[wp.float64],
) -> None:
    """Fade a dither's torque where a joint moves, and add its offset: `Dither.torque`.

    ``inverse`` is 1 over the gate velocity [s/rad].
    """
    world, joint = wp.tid()
    share = speed[world, joint] * inverse[world, joint]
    faded = torque[world, joint] * wp.exp(-(share * share))
    torque[world, joint] = faded + offset[world, joint]


@wp.kernel(enable_backward=False)
def _command(
    first: int,
    applied: wp.array2d[wp.float64],
    missing: wp.array2d[wp.float64],
    ctrl: wp.array2d[wp.float32],
) -> None:
    """Write the engine's controls."""
    world, joint = wp.tid()
    ctrl[world, first + joint] = wp.float32(applied[world, joint] + missing[world, joint])


@wp.kernel(enable_backward=False)
def _widen(narrow: wp.array2d[wp.float32], wide: wp.array2d[wp.float64]) -> None:
    world, k = wp.tid()
    wide[world, k] = wp.float64(narrow[world, k])


@wp.kernel(enable_backward=False)
def _take(k: int, source: wp.array3d[wp.float64], out: wp.array2d[wp.float64]) -> None:
    world, column = wp.tid()
    out[world, column] = source[k, world, column]


@wp.kernel(enable_backward=False)
def _keep(k: int, source: wp.array2d[wp.float64], out: wp.array3d[wp.float64]) -> None:
    world, column = wp.tid()
    out[k, world, column] = source[world, column]


class DeviceCycle:
    """The controllers of a plant's N arms, which see its state and whose commands act at once."""

    def __init__(
        self,
        plant: Plant,
        end_effector: EndEffector,
        controller: CartesianImpedance,
        sequencer: GoalSequencer,
        path: TorquePath,
        *,
        goal_period: int,
        step: Index,
        dither_torque: Array,
        missing: Array,
        applied: Array,
    ) -> None:
        """Make it of what the host's cycles work on; arrays are those of the host.

        Args:
            plant: on an engine with a device.
            end_effector: of the plant.
            controller: of all arms.
            sequencer: of their goals.
            path: of their torques.
            goal_period: control steps from one look at goals and reference to the next.
            step: (N,) control steps since arms began to follow.
            dither_torque: (N, n) of the last cycle [N·m].
            missing: (N, n) torque that acts besides [N·m].
            applied: (N, n) torque behind the path [N·m].
        """
        self._plant, self._pose, self._controller = plant, end_effector, controller
        self._sequencer, self._path, self._goal_period = sequencer, path, goal_period
        self._step, self._missing, self._applied = step, missing, applied
        self._dither_torque = dither_torque
        nsim, n = plant.nsim, plant.n
        self._mirrors = Mirrors(nsim)
        self._q, self._dq = np.zeros((2, nsim, n))
        self._omega, self._phase, self._amplitude, self._gate, self._offset = np.zeros((5, nsim, n))
        self._time, self._clock = np.zeros((2, nsim))
        self._velocity, self._speed = np.zeros((nsim, 3)), np.zeros((nsim, 2))
        self._accepted = np.zeros(nsim, dtype=bool)
        self._kept: dict[str, list[tuple[Array, wp.array]]] = {}
        self._tables: dict[str, wp.array] = {}

    def follow(
        self, steps: int, dither: Dither, *, watch: Callable[[], None], joints: bool
    ) -> None:
        """Follow for control steps.

        Args:
            steps: control steps.
            dither: of all arms.
            watch: called for each step afterwards, when the arrays of the host are what they were
                then: pose and reference.
            joints: whether what the joints did is among them.
        """
        hold = self._path.interface.hold_steps
        start = int(self._step.max())
        plain = dither.sines is not None
        null = self._controller.arguments[6]
        phase = start % np.lcm(hold, self._goal_period)
        name = f"{steps} {phase} {plain} {null} {joints}"

        def control(k: int) -> None:
            self._control(start + k, k, hold, plain, name)
            if joints:
                speed = self._plant.state[1]
                self._launch(_widen, speed.shape, self._plant.batch.device.qvel, speed)
            for host, out in kept:
                self._launch(_keep, host.shape, k, host, out)

        with DEVICE:
            self._set_dither(dither, name, steps, start)
            self._mirrors.send()
            if name not in self._kept:
                self._kept[name] = self._keep(steps, joints)
            kept = self._kept[name]
            self._plant.follow_on_device(name, control, steps)
            columns = [(host, out.numpy()) for host, out in kept]
        self._step += steps
        self._replay(watch, steps, columns)
        changed = (self._controller.arguments, self._controller.reference_arguments)
        poses = self._pose.arguments[-3:], self._sequencer.arguments, self._path.arguments
        with DEVICE:
            self._mirrors.fetch(*changed, *poses, self._applied, self._dither_torque)

    # ---- one control step, on the device -----------------------------------------------------

    def _launch(self, kernel: wp.Kernel, shape: int | tuple[int, ...], *arguments: object) -> None:
        """Launch a kernel on the device's own arrays, and on the mirrors of the host's."""
        of = self._mirrors.of
        inputs = [of(x) if isinstance(x, np.ndarray) else x for x in arguments]
        wp.launch(kernel, dim=shape, inputs=inputs)

    def _control(self, step: int, k: int, hold: int, plain: bool, name: str) -> None:
        run, controller, path = self._mirrors.launch, self._controller, self._path
        self._read()
        position, quaternion, jacobian = self._pose.arguments[-3:]
        if step % hold == 0:
            self._launch(_tell_time, len(self._time), k, CONTROL_DT, self._step, self._time)
            goals = step % self._goal_period < hold
            if goals:
                self._look_ahead(position, quaternion)
            if goals or controller.filters:
                run(advance_reference, *controller.reference_arguments)
            shaken = self._dither_torque
            if plain:
                run(sine, self._omega, self._phase, self._amplitude, self._time, shaken)
            else:
                self._launch(_take, shaken.shape, k // hold, self._tables[name], shaken)
                self._launch(gate, shaken.shape, self._dq, self._gate, self._offset, shaken)
            pose = position, quaternion, jacobian
            run(impedance_cycle, *pose, self._q, self._dq, shaken, *controller.arguments)
        run(pass_torque, controller.command, *path.arguments, self._applied)
        first = int(self._plant.sticking.torque_actuator[0])
        ctrl = self._plant.batch.device.ctrl
        self._launch(_command, self._applied.shape, first, self._applied, self._missing, ctrl)

    def _read(self) -> None:
        """Read pose, Jacobian, angles and speeds."""
        sticking, batch = self._plant.sticking, self._plant.batch
        data, model = batch.device, sticking.model
        anchor, axis, position, quaternion = self._pose.arguments[:4]
        site = model.site(sticking.arm.end_effector).id
        body = int(model.site_bodyid[site])
        self._launch(_take_joints, anchor.shape[:2], data.xanchor, data.xaxis, anchor, axis)
        where = (site, body, data.site_xpos, data.xquat, position, quaternion)
        self._launch(_take_site, len(position), *where)
        angles = sticking.motor, sticking.spring, batch.angle, data.qvel, self._q, self._dq
        self._launch(_take_angles, self._q.shape, *angles)
        self._mirrors.launch(site_kinematics, *self._pose.arguments)

    def _look_ahead(self, position: Array, quaternion: Array) -> None:
        """Accept goals, and move the reference's target."""
        run, arguments = self._mirrors.launch, self._sequencer.arguments
        run(accept, position, quaternion, self._time, *arguments, self._accepted)
        _, _, (_, _, begun, _), profile, trapezoid = arguments
        self._launch(_tell_clock, len(begun), self._time, begun, self._clock)
        _, place, turn, *_ = self._controller.reference_arguments
        sampled = place, turn, self._velocity, self._speed
        run(write_sample, self._clock, profile, trapezoid, *sampled)

    # ---- what goes there, and what comes back ------------------------------------------------

    def _set_dither(self, dither: Dither, name: str, steps: int, start: int) -> None:
        """Put a dither into arrays that stay the same; what is no sine as a table of its cycles."""
        if dither.sines is not None:
            self._omega[:], self._phase[:], self._amplitude[:] = dither.sines
            return
        hold, n = self._path.interface.hold_steps, self._plant.n
        self._gate[:], self._offset[:] = 1.0 / dither.gate_velocity, dither.offset
        cycles = [k for k in range(steps) if (start + k) % hold == 0]
        times: list[Array] = [np.multiply(self._step + k, CONTROL_DT, dtype=float) for k in cycles]
        table = [dither.ungated(t) for t in times]
        if name not in self._tables:
            shape = max(len(table), 1), self._plant.nsim, n
            self._tables[name] = wp.zeros(shape, dtype=wp.float64)
        if table:
            self._tables[name].assign(np.stack(table))

    def _keep(self, steps: int, joints: bool) -> list[tuple[Array, wp.array]]:
        """Return the arrays of the host that steps change, and where the device keeps them."""
        c = self._controller
        hosts: Sequence[Array] = (*self._pose.arguments[-3:-1], *c.reference_arguments[3:5])
        if joints:
            speed = self._plant.state[1]
            hosts = (*hosts, speed, self._dither_torque, self._applied, *c.arguments[-4:])
        shapes = ((steps, *host.shape) for host in hosts)
        return [
            (host, wp.zeros(shape, dtype=wp.float64))
            for host, shape in zip(hosts, shapes, strict=True)
        ]

    def _replay(
        self, watch: Callable[[], None], steps: int, columns: Sequence[tuple[Array, Array]]
    ) -> None:
        """Call ``watch`` with the host's arrays as they were in each step: the columns' rows."""
        speed = self._plant.state[1]
        now = speed.copy()
        for k in range(steps):
            for host, values in columns:
                host[...] = values[k]
            watch()
        speed[:] = now
