"""A joint that a person pushes: at which torque it moves, with and without dither.

    push = PushedJoint(sticking_model("panda"), dither=rows)
    push.choose(7)
    push.harder(9)  # 90 % of what the joint holds
    push.advance(5.0)

The other joints are held where they are, as in the Single Joint Experiment. When the joint has
moved by that experiment's threshold it has let go: the push ends, and friction brings it to rest.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.experiments.rig import Experiment, Rig, dither_arrays, joint_number
from stiction_envs.experiments.sje.protocol import load_protocol
from stiction_envs.friction.model import StickingModel
from stiction_envs.measured.tables import AmplitudeRow
from stiction_envs.plant import CONTROL_DT, SLOW_STEPS

_ARM = np.array([0])


class PushedJoint(Rig):
    """One arm, one joint of which a person pushes."""

    STEP = 0.1
    """Step by which a push grows, over the torque that the joint holds [-]; assumed."""
    RISE_TIME = 20.0
    """Time in which the torque grows by the torque that the joint holds [s]; assumed: about the
    rate of the Single Joint Experiment; under a quicker ramp a LuGre joint lets go earlier."""
    WATCHED_TIME = 0.25
    """A joint has stopped if its mean position equals that of this much earlier [s]; assumed: some
    periods of a dither."""
    STILL = 0.005
    """Largest difference between those two positions [rad]; assumed."""

    def __init__(
        self, sticking: StickingModel, *, dither: Sequence[AmplitudeRow] = (), seed: int = 0
    ) -> None:
        """Put the arm at its rest pose, joint 1 free, nothing pushed, dither off.

        ``dither`` has the dither of a joint, for when that joint is pushed and dither is on.
        ``seed`` is that of a waveform that is drawn.
        """
        protocol = load_protocol(sticking.arm.registered_name)
        super().__init__(Experiment(sticking, threads=1), 1, approach=protocol)
        self.dither_seed[:] = seed
        for row in dither:
            joint_number(row.joint, self.n)
        self.rows = {row.joint: row for row in dither if row.amplitude_nm > 0}
        """Dither of each joint that has one."""
        self.threshold = protocol.threshold  # Distance after which the joint has let go [rad]
        # whole controller cycles, none longer than the plant leaves its friction alone
        self.block = max(1, SLOW_STEPS // self.interface.hold_steps) * self.interface.hold_steps
        """Control steps that `advance` counts in."""
        self.joint = 1  # The one that is pushed, from 1
        self.dithered = False  # Whether dither is on
        self.slips = False  # Whether the joint has let go and still moves
        self.start = 0.0  # Where the joint last rested [rad]
        self.torque = self.target = 0.0
        """The push now, dither excluded, and where it is going [N·m]."""
        self.let_go: float | None = None
        """Torque at which the joint last let go [N·m]; None since the last choice."""
        self.reset()

    def reset(self) -> None:
        """Bring the arm back to its rest pose; joint and dither stay as they are."""
        self.plant.reset(_ARM, self.plant.sticking.arm.rest[None])
        self.step[:] = 0
        self.choose(self.joint)

    def choose(self, joint: int) -> None:
        """Push another joint (from 1); all are held where they are, with no push on any."""
        self.joint = joint_number(joint, self.n) + 1
        stiffness, damping = self._servos_of(_ARM, *self._servos.inertia(self.plant.position))
        stiffness[0, joint - 1] = damping[0, joint - 1] = 0.0
        self.plant.set_servo(_ARM, stiffness, damping, self.plant.motor_position)
        self._path.reset(_ARM)
        self.torque = self.target = 0.0
        self.let_go = None
        self._rest_here()
        self._set_dither()

    def harder(self, steps: float) -> None:
        """Push harder in the positive direction by steps of `STEP`; the torque follows."""
        self.target += steps * self.STEP * self.holds_up_to(1.0)
        limit = float(self.interface.torque_limit[self.joint - 1])
        self.target = float(np.clip(self.target, -limit, limit))
        if abs(self.target) < 1e-9:
            self.target = 0.0

    def switch_dither(self) -> None:
        """Switch the dither of the joint on or off."""
        self.dithered = not self.dithered
        self._set_dither()

    @property
    def angle(self) -> float:
        """Angle of the joint since it last rested [rad]."""
        return float(self.plant.position[0, self.joint - 1]) - self.start

    def holds_up_to(self, direction: float) -> float:
        """Return the torque's size up to which the joint holds without dither in a direction [N·m].

        Stiction at the present load, and the torque that balances the arm beyond its gravity
        compensation. A ``direction`` from 0 is positive.
        """
        j, side, sign = self.joint - 1, int(direction < 0), -1.0 if direction < 0 else 1.0
        plant = self.plant
        levels = plant.sticking.parameters.stiction_at(plant.load[1][0])[j]
        # the plant's own mean: it knows of warm-up
        stiction = float(plant.stiction[0, j] * levels[side] / levels.mean())
        return stiction + sign * float(plant.offset[0, j])

    def advance(self, seconds: float) -> None:
        """Let time pass, in blocks of `block` control steps."""
        blocks = max(1, round(seconds / (self.block * CONTROL_DT)))
        for _ in range(blocks):
            self._advance_block()

    def _advance_block(self) -> None:
        hold, j = self.interface.hold_steps, self.joint - 1
        stride = hold if self.dither.gated else self.block
        ramp = self._ramp()
        for k in range(0, self.block, stride):
            command = np.zeros((1, stride, self.n))
            command[0, :, j] = ramp[k : k + stride]
            speed = self._gate_speed()
            for cycle in range(0, stride, hold):
                shaken = self.dither.torque(self._command_time(cycle), speed)
                command[:, cycle : cycle + hold] += shaken[:, None]
            angle = self.plant.run(self._path.run(command, _ARM), joint=np.array([j]))[0]
            self.step += stride
            gone = np.abs(angle - self.start) >= self.threshold
            if gone.any() and not self.slips:
                self.let_go, self.slips = float(ramp[k + int(gone.argmax())]), True
                self.torque = self.target = 0.0
                ramp[k:] = 0.0
            self._seen.append(float(angle.mean()))
        self.torque = float(ramp[-1])
        if self.slips and self._is_still():
            self._rest_here()

    def _ramp(self) -> Array:
        """Return the commanded torque (block,) of the next control steps [N·m]."""
        rate = self.holds_up_to(self.target) / self.RISE_TIME
        step = np.arange(1, self.block + 1)
        # held for a controller cycle, as the robot holds it
        cycle = -(-step // self.interface.hold_steps) * self.interface.hold_steps
        away = self.target - self.torque
        grown = np.minimum(rate * CONTROL_DT * cycle, abs(away))
        return self.torque + np.sign(away) * grown

    def _is_still(self) -> bool:
        """Return whether the joint has stopped, apart from its dither."""
        half = len(self._seen) // 2
        if len(self._seen) < (self._seen.maxlen or 0):
            return False
        seen = list(self._seen)
        return abs(float(np.mean(seen[half:]) - np.mean(seen[:half]))) < self.STILL

    def _rest_here(self) -> None:
        """Count the joint's angle from here."""
        self.start, self.slips = float(self.plant.position[0, self.joint - 1]), False
        stride = self.interface.hold_steps if self.dither.gated else self.block
        watched = round(2 * self.WATCHED_TIME / CONTROL_DT / stride)
        self._seen: deque[float] = deque(maxlen=max(2, watched))

    def _set_dither(self) -> None:
        on = self.dithered and self.joint in self.rows
        rows = [self.rows[self.joint]] if on else []
        self.set_dither(_ARM, **dither_arrays(rows, self.n))
