"""A law of friction compensation: its parameters, its measured quantities, its compiled torque.

A law is one file with a `Law`, its ``LAW``, and a name in `control.COMPENSATIONS`. Compiled code
calls a law by the address of its compiled torque, and so is the same for every law.
"""

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from stiction_envs.arrays import Array
from stiction_envs.compiled import as_c_function
from stiction_envs.friction.parameters import FrictionParameters

WANTED_SPEED, SPEED, ERROR, GRAVITY, TORQUE, PUSHED = range(6)
"""Entries of ``seen``: speed that the reference asks for and measured speed [rad/s]; joint error
[rad]; gravity torque of the controller's model [N·m]; torque that accelerated the joint in the last
cycle by that model, which is the command less Coriolis and centrifugal torque [N·m]; momentum that
the joint gained in it, M Δq̇ [N·m·s]."""
SEEN = 6
_NUMBERS = types.CPointer(types.float64)
_TORQUE = types.float64(_NUMBERS, _NUMBERS, _NUMBERS, types.float64)


@dataclass(frozen=True, kw_only=True)
class Field:
    """One number per joint of a law, besides its gain."""

    name: str  # Key in `Compensation.numbers`
    column: str  # In tables of gains, with its unit
    unit: str
    positive: bool = False  # Whether it must be > 0; else >= 0
    default: float | None = None  # None: it must be given
    scales: bool = False  # Whether it is proportional to friction, as the gain is
    inverse: bool = False  # Whether the compiled law takes 1 over it
    largest: float = np.inf

    @property
    def expected(self) -> str:
        """Numbers that it may have, for messages."""
        low = f"> 0 {self.unit}" if self.positive else f">= 0 {self.unit}"
        return low if self.largest == np.inf else f"{low} and <= {self.largest:g}"


GAIN = Field(name="gain", column="gain_nm", unit="N·m", scales=True)


def smoothing_speed(default: float) -> Field:
    """Return the field of the speed at which a tanh is 76 % of its gain [rad/s]."""
    return Field(
        name="speed",
        column="speed_rad_s",
        unit="rad/s",
        default=default,
        positive=True,
        inverse=True,
    )


class Law(abc.ABC):
    """A law; derive from it, one file each."""

    name: ClassVar[str]
    words: ClassVar[str]  # What a sentence calls it
    what: ClassVar[str]  # In one line, for help and reports
    knows: ClassVar[str]  # What it needs to know or measure, for reports
    fields: ClassVar[tuple[Field, ...]]  # Its numbers besides the gain
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

    @staticmethod
    @abc.abstractmethod
    def torque(numbers: Array, seen: Array, state: Array, period: float) -> float:
        """Return the torque of one joint [N·m]; compiled, and called in every controller cycle.

        Args:
            numbers: (K,) the gain, then the `fields` in their order.
            seen: (6,) what a controller has, `WANTED_SPEED` and so on.
            state: (1,) the law's own memory, 0 at the start.
            period: of the controller's cycles [s].
        """

    @cached_property
    def code(self) -> Any:
        """The compiled `torque`; its ``address`` is that of `law_torque`."""
        return as_c_function(_TORQUE, self.torque)

    def __reduce__(self) -> tuple[type["Law"], tuple[()]]:
        return type(self), ()  # machine code stays in its process


def _call(
    typing: Any, address: Any, numbers: Any, seen: Any, state: Any, period: Any
) -> tuple[Any, Any]:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        number = context.get_value_type(types.float64)
        pointer = number.as_pointer()
        kind = ir.FunctionType(number, [pointer, pointer, pointer, number])
        code, *arrays = values[:4]
        given = [builder.inttoptr(x, pointer) for x in arrays]
        return builder.call(builder.inttoptr(code, kind.as_pointer()), [*given, values[4]])

    return types.float64(*4 * [types.intp], types.float64), generate


law_torque: Any = intrinsic(_call)
"""Compiled code calls a law by it: address of the code, addresses of arrays, period."""


def breakaway(friction: FrictionParameters, load: Array) -> Array:
    """Return (n,) breakaway torque under load, mean of both directions [N·m]."""
    return friction.stiction_at(load).mean(axis=-1)


def coulomb(friction: FrictionParameters, load: Array) -> Array:
    """Return (n,) Coulomb friction under load, mean of both directions [N·m]."""
    return (friction.stiction_at(load) * friction.coulomb_ratio).mean(axis=-1)
