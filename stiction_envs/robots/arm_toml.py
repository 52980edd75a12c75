"""Read the TOML of an arm: limits, interface, rest pose, each with its source."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Bools
from stiction_envs.errors import StictionError, checked_array, unknown
from stiction_envs.method_settings import read_toml as read_toml

MOUNTINGS = ("floor", "free")
PLACEHOLDER = 0.2  # no arm has so low a limit of speed or torque [rad/s, N·m]; assumed
Table = dict[str, Any]
"""Parsed TOML, whose values are checked where they are read."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of the joints: float64 arrays, read-only, base to flange."""

    position: Array
    """Lower and upper joint angle, (n, 2), rad."""
    velocity: Array
    """Largest joint speed, (n,), rad/s."""
    torque: Array
    """Largest joint torque, (n,), N·m."""
    torque_rate: Array
    """Largest change of the commanded torque, (n,), N·m/s; inf where unknown."""

    def assumed(self, name: str) -> Bools:
        """Return (n,) whether limits of ``position``, ``velocity`` or ``torque`` are `generic`.

        A joint whose position is not limited, as a continuous one, turns as far as it likes.
        """
        default = lookup(generic(), f"limits.{name}")
        return np.array([bool((np.abs(x) == default).all()) for x in getattr(self, name)])

    def doubtful(self, name: str) -> Bools:
        """Return (n,) whether limits of ``velocity`` or ``torque`` are assumed or fill a gap.

        An exporter that knows none writes one number for all joints, or a tiny one.
        """
        values = getattr(self, name)
        same = len(values) > 1 and bool((values == values[0]).all())
        return np.asarray(self.assumed(name) | same | (values <= PLACEHOLDER))

    def __post_init__(self) -> None:
        for field in fields(self):
            # np.array copies: the caller's array must not change the limits later.
            array = np.array(getattr(self, field.name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, field.name, array)


@cache
def generic() -> Table:
    """Return the values that are assumed where an arm's file has none (``generic.toml``)."""
    return read_toml(Path(__file__).with_name("generic.toml"))


def lookup(table: Mapping[str, object], key: str) -> Any:
    """Return ``value`` of the dotted ``key``, e.g. ``limits.torque``; None if it is missing."""
    node: object = table
    for part in key.split("."):
        if not isinstance(node, Mapping) or part not in node:
            return None
        node = node[part]
    return node.get("value") if isinstance(node, Mapping) else None


def payload_radius() -> float:
    """Return the radius of the solid sphere that a payload is [m]."""
    return float(lookup(generic(), "payload_radius"))


def on_floor(table: Mapping[str, object], where: str) -> bool:
    """Return whether ``mounting`` is ``floor``, z = 0 of the world; the default is ``free``."""
    mounting = table.get("mounting", "free")
    if mounting not in MOUNTINGS:
        raise StictionError(f"{where}: {unknown('mounting', mounting, MOUNTINGS)}")
    return bool(mounting == "floor")


def hand_yaw(table: Mapping[str, object], where: str) -> float:
    """Turn of the hand's frame from the flange's about its z [rad], else ``generic.toml``'s."""
    given = lookup(table, "hand_yaw")
    value = lookup(generic(), "hand_yaw") if given is None else given
    return float(checked_array(value, f"{where}, hand_yaw", (), expected="a finite number of rad"))


def per_joint(value: object, shape: tuple[int, ...], where: str) -> Array:
    """Return ``value`` as float64 array of ``shape``; a single number fills it; no NaN."""
    lone = np.ndim(value) == 0  # type: ignore[arg-type]
    array = checked_array(value, where, () if lone else shape, finite=False)
    if np.isnan(array).any():
        raise StictionError(f"{where}: contains NaN")
    return np.array(np.broadcast_to(array, shape))


def check_range(
    value: ArrayLike, unit: str, where: str, *, low: float = -np.inf, allow_inf: bool = False
) -> None:
    """Raise if a number is below ``low`` or above `[largest]` of `generic.toml` for its unit.

    Only if ``allow_inf`` may it be inf; ``where`` begins the message.
    """
    array, most = np.asarray(value, dtype=np.float64), largest(unit)
    good = (array >= low) & (np.abs(array) <= most) | (allow_inf & (array == np.inf))
    if not good.all():
        more = " or inf" if allow_inf else ""
        raise StictionError(
            f"{where}: {array[~good].flat[0]:g} {unit}: "
            f"expected {max(low, -most):g} to {most:g}{more}"
        )


def largest(unit: str = "") -> float:
    """Return the largest size of a joint's numbers in a unit; "" for the largest of all units."""
    sizes = generic()["largest"]
    return float(sizes[unit]["value"] if unit else max(x["value"] for x in sizes.values()))
