"""The data that causes use: a recording, the torque of the nominal model, and its dry friction.

A change makes a new `Data`; derived values stay with the old one.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.signals.bristle import grown
from stiction_envs.gap.signals.friction_state import (
    FrictionState,
    friction_torque,
    noise_floor,
    presliding_distances,
)
from stiction_envs.gap.signals.prepare import Signals
from stiction_envs.gap.signals.recording import Recording, join, rate
from stiction_envs.gap.signals.rigid_body import mass_matrices, passive_torque
from stiction_envs.robots import Arm

NOT_MEASURED = 1e6
"""Noise floor of a torque that is not measured [N·m]: it has no weight."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Data:
    """T samples of n joints, measured and nominal."""

    recording: Recording
    nominal: Array
    """(T, n) torque of the nominal model [N·m]."""
    rigid: Array
    """(T, n) torque of the nominal model without friction, which the gears transmit [N·m]."""
    carried: Array | None = None
    """(T, n) torque of causes in ``rigid`` that ``nominal`` lacks: payload, tilt [N·m]."""
    gravity_found: tuple[float, ...] = ()
    """Gravity x, y, z for bodies once a tilt was found [m/s²]; () for the arm's gravity."""
    found: Recording | None = None
    """The motion of the arm with all links as they were found; None for the nominal arm."""
    friction: FrictionState
    noise: Array
    """(n,) noise floor of the residual torque [N·m]."""
    unit: Array = field(default_factory=lambda: np.ones(1))
    """(n,) or (1,) what 1 N·m is in the logged unit, as far as the nominal model has another."""

    def __post_init__(self) -> None:
        for x in (self.nominal, self.rigid, self.carried):
            if x is not None:
                x.flags.writeable = False

    # ---- the recording -----------------------------------------------------------------------

    @property
    def arm(self) -> Arm:
        """The nominal rigid arm."""
        return self.recording.arm

    @property
    def links(self) -> Recording:
        """The motion of the links that the gears drive, as far as they are known."""
        return self.recording if self.found is None else self.found

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.recording.n

    @property
    def dt(self) -> float:
        """Sampling time within a segment [s]; NaN for poses alone."""
        return self.recording.dt

    @property
    def q(self) -> Array:
        """(T, n) [rad]."""
        return self.recording.q

    @property
    def dq(self) -> Array:
        """(T, n) [rad/s]."""
        return self.recording.dq

    @property
    def ddq(self) -> Array:
        """(T, n) [rad/s²]."""
        return self.recording.ddq

    @property
    def tau(self) -> Array:
        """(T, n) measured [N·m]."""
        return self.recording.tau

    @property
    def block(self) -> Index:
        """(T,) number of the block that is held out together, −1 in a guard."""
        return self.recording.block

    @property
    def measured(self) -> Bools:
        """(n,) whether each joint's torque is a measurement."""
        return self.noise < NOT_MEASURED

    def rate(self, x: Array) -> Array:
        """Return the time derivative of (T, ...) within each segment, per second."""
        return rate(x, self.recording.runs, self.dt)

    def smooth(self, x: Array) -> Array:
        """Return (T, ...) after the filter of the signals: see `Recording.smooth`."""
        return self.recording.smooth(x)

    # ---- the nominal model -------------------------------------------------------------------

    @cached_property
    def residual(self) -> Array:
        """(T, n) measured less nominal torque [N·m]."""
        return self.tau - self.nominal

    @property
    def logged_residual(self) -> Array:
        """(T, n) torque as it was logged less nominal torque [N·m]."""
        return self.unit * self.tau - self.nominal

    @property
    def converted(self) -> bool:
        """True if the torques were logged in another unit than N·m."""
        return bool((self.unit != 1).any())

    @cached_property
    def strength(self) -> Array:
        """(n,) torque that each joint can bear: its limit, or the motion's if larger [N·m]."""
        usual = np.sqrt(np.mean(np.square(self.recording.rigid), axis=0))
        return np.maximum(self.arm.limits.torque, usual)

    @cached_property
    def own_inertia(self) -> Array:
        """(n,) inertia of the rigid arm about each joint, mean of the motion [kg·m²]."""
        some = self.q[:: max(1, len(self.q) // 100)]
        return np.asarray(
            np.diagonal(mass_matrices(self.recording.pinocchio, some), 0, 1, 2).mean(axis=0)
        )

    def carrying(
        self, torque: Array, gravity: tuple[float, ...] = (), arm: Arm | None = None
    ) -> "Data":
        """Return data whose gears also transmit a torque (T, n) that ``nominal`` lacks [N·m].

        ``gravity`` becomes `gravity_found`; ``arm`` has the links as they were found, or None.
        """
        carried = torque if self.carried is None else self.carried + torque
        found = None if arm is None else self.on(arm).recording
        rigid = self.rigid + torque
        return replace(self, rigid=rigid, carried=carried, gravity_found=gravity, found=found)

    def on(self, arm: Arm) -> "Data":
        """Return data of an arm with other bodies or gravity: the same motion and torque."""
        recording = replace(self.recording, arm=arm, pinocchio=arm.pinocchio())
        return replace(self, recording=recording)

    def corrected(self, torque: Array, *, friction: bool, rotor: Array) -> "Data":
        """Return data whose nominal model has the causes of a diagnosis.

        Args:
            torque: (T, n) of all causes [N·m]; gears carry the part set by `carrying` before.
            friction: whether friction is among them.
            rotor: (n,) inertia that they add to the rotors [kg·m²].
        """
        state = replace(
            self.friction,
            in_nominal=self.has_friction or friction,
            rotor=self.friction.rotor + rotor,
        )
        return replace(
            self,
            nominal=self.nominal + torque,
            carried=None,
            found=None,
            friction=state,
        )

    # ---- dry friction ------------------------------------------------------------------------

    @property
    def has_friction(self) -> bool:
        """True if the nominal model has friction, so that it may also have too much."""
        return self.friction.in_nominal

    def with_presliding(self, distance: Array) -> "Data":
        """Return data whose dry friction builds up within distances (n,) [rad]."""
        return replace(self, friction=replace(self.friction, presliding_distance=distance))

    @cached_property
    def directions(self) -> Array:
        """(F, n) direction of motion in [-1, 1], unfiltered; at rest the last direction.

        A joint that stops keeps its friction until it goes back by the presliding distance.
        """
        return self.recording.bristles(self.friction.presliding_distance[:, None])[..., 0]

    def dry_friction_ratio(self, joint: int) -> Array:
        """Return (F,) dry friction over its steady level, unfiltered: ζ + (σ1/σ0) dζ/dt [-]."""
        return self._leading(self.directions[:, joint], joint)

    def side(self, joint: int) -> Array:
        """Return (F,) sign of the motion by which each row was reached; at rest the last one."""
        recording = self.recording
        out = np.zeros(len(recording.reversal_path))
        for run in recording.path_runs:
            path = recording.reversal_path[run, joint]
            step = np.sign(np.diff(path, prepend=path[0]))
            last = np.maximum.accumulate(np.where(step != 0, np.arange(len(step)), 0))
            out[run] = step[last]
        return out

    def growth(self, joint: int, weight: Array, ratio: float = 0.0) -> Array:
        """Return (F,) dry friction per unit of a level that grows by a weight, unfiltered.

        In steady sliding this is the weight in the direction of motion. The weight is (F,) along
        the reversal path, or smooth (T,); ``ratio`` is the growth per unit of weight over the
        level (`grown`).
        """
        recording, distance = self.recording, float(self.friction.presliding_distance[joint])
        if len(weight) != len(recording.reversal_path):
            weight = recording.along_path(weight)
        path, zeta = recording.reversal_path[:, joint], self.directions[:, joint]
        eta = grown(path, recording.path_runs, distance, zeta, weight, ratio)
        return self._leading(eta, joint)

    def _leading(self, x: Array, joint: int) -> Array:
        """Return (F,) a bristle's torque including its damping."""
        lead = self.friction.bristle_lead_time[joint]
        return x if lead == 0 else x + lead * self.recording.path_rate(x)


def assemble(
    arm: Arm,
    signals: Signals,
    *,
    friction: FrictionParameters | None = None,
    torque: str = "motor",
    link_factor: Array | None = None,
    of_file: bool = False,
    known_unit: Array | None = None,
) -> Data:
    """Compare signals with the nominal rigid arm and its friction, None for no friction.

    Rotors, springs and gravity compensation that the robot's file states act in either case.
    ``torque`` and ``link_factor`` are those of `Recording`; ``of_file`` says whether the friction
    is that of the robot's file: frictionloss has no presliding, so the logs tell it. ``known_unit``
    is the unit of torques that an earlier diagnosis found.
    """
    recording = join(arm, signals, torque=torque, link_factor=link_factor)
    if friction is None:
        state = FrictionState.unknown(recording)
    else:
        state, known = FrictionState.of(friction), arm.stated.bristle > 0
        if of_file and not known.all():
            seen = presliding_distances(recording, recording.tau - recording.rigid)
            distance = np.where(known, state.presliding_distance, seen)
            lead = np.where(known, state.bristle_lead_time, 0.0)
            state = replace(state, presliding_distance=distance, bristle_lead_time=lead)
    nominal = recording.rigid + passive_torque(arm, recording.q)
    if friction is None:
        nominal += state.rotor * recording.ddq
    else:
        nominal += friction_torque(recording, friction, state)
    noise = noise_floor(recording, recording.tau - nominal)
    if signals.measured is not None:
        noise = np.where(signals.measured, noise, NOT_MEASURED)
    return Data(
        recording=recording,
        nominal=nominal,
        rigid=recording.rigid + arm.stated.stiffness * (recording.q - arm.stated.springref),
        friction=state,
        noise=noise,
        unit=signals.torque_unit / (1.0 if known_unit is None else known_unit),
    )
