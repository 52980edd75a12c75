"""A law of friction compensation: its parameters, its measured quantities, its compiled torque.

A law is one file with a `Law` and a compiled function

    torque(numbers, seen, state, period) -> torque of one joint [N·m]

which is called once per controller cycle and joint, and a line in the registry of this room.
``numbers`` (K,) are the gain, then the law's `fields` in their order; ``seen`` (6,) is what a
controller has (`WANTED_SPEED` … below); ``state`` (1,) is the law's own memory, 0 at the start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.control.impedance import GTE_DEFAULTS
from stiction_envs.friction.parameters import FrictionParameters

WANTED_SPEED, SPEED, ERROR, GRAVITY, TORQUE, PUSHED = range(6)
"""Entries of ``seen``: speed that the reference asks for and measured speed [rad/s]; joint error
[rad]; gravity torque of the controller's model [N·m]; torque that accelerated the joint in the last
cycle by that model, which is the command less Coriolis and centrifugal torque [N·m]; momentum that
the joint gained in it, M Δq̇ [N·m·s]."""
SEEN = 6


@dataclass(frozen=True, kw_only=True)
class Field:
    """One number per joint of a law, besides its gain."""

    name: str  # Attribute of `Compensation`; with the law's name before it, the key in ``gte.toml``
    column: str  # In tables of gains, with its unit
    unit: str
    positive: bool = False  # Whether it must be > 0; else >= 0
    optional: bool = True  # Whether it has a default
    scales: bool = False  # Whether it is proportional to friction, as the gain is
    inverse: bool = False  # Whether the compiled law takes 1 over it
    largest: float = np.inf

    @property
    def expected(self) -> str:
        """Numbers that it may have, for messages."""
        low = f"> 0 {self.unit}" if self.positive else f">= 0 {self.unit}"
        return low if self.largest == np.inf else f"{low} and <= {self.largest:g}"


GAIN_FIELD = Field(name="gain", column="gain_nm", unit="N·m", optional=False, scales=True)
SPEED_FIELD = Field(name="speed", column="speed_rad_s", unit="rad/s", positive=True, inverse=True)


class Law:
    """A law; derive from it, one file each."""

    name: ClassVar[str]
    words: ClassVar[str]  # What a sentence calls it
    what: ClassVar[str]  # In one line, for help and reports
    knows: ClassVar[str]  # What it needs to know or measure, for reports
    fields: ClassVar[tuple[Field, ...]] = (SPEED_FIELD,)
    searched: ClassVar[tuple[str, ...]] = ("speed",)  # Fields that the tuner varies
    feeds: ClassVar[bool] = False  # Whether it reads `WANTED_SPEED`
    reads_error: ClassVar[bool] = False
    reads_momentum: ClassVar[bool] = False  # Whether it reads `TORQUE` and `PUSHED`

    def reads_model(self, numbers: Mapping[str, Sequence[float]]) -> bool:
        """Return whether it reads `GRAVITY` or `TORQUE`, of the controller's model."""
        return self.reads_momentum

    def gains(self, friction: FrictionParameters, load: Array) -> Mapping[str, Array]:
        """Return numbers (n,) of the friction of one arm that transmits ``load`` (n,) [N·m].

        The gain here is the mean breakaway torque of both directions; a law that needs other
        numbers overrides this.
        """
        return {"gain": breakaway(friction, load)}

    def default(self, name: str) -> float:
        """Return the default of a field, of ``gte.toml``."""
        return float(GTE_DEFAULTS["compensation"][f"{self.name}_{name}"])


def breakaway(friction: FrictionParameters, load: Array) -> Array:
    """Return (n,) breakaway torque under load, mean of both directions [N·m]."""
    return friction.stiction_at(load).mean(axis=-1)


def coulomb(friction: FrictionParameters, load: Array) -> Array:
    """Return (n,) Coulomb friction under load, mean of both directions [N·m]."""
    return (friction.stiction_at(load) * friction.coulomb_ratio).mean(axis=-1)
