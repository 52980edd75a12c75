"""Laws of friction compensation, a file each: the registry, and their compiled torques by number.

A new law is its file and its two entries here: in `LAWS`, and in `law_torque` by its place there.
"""

from __future__ import annotations

from stiction_envs.compiled import compiled
from stiction_envs.control.laws import (
    feedforward,
    lugre_observer,
    momentum_observer,
    partial,
    push,
    smooth_sign,
)
from stiction_envs.control.laws.base import Array, Field, Law

__all__ = ["LAWS", "Field", "Law", "law_torque"]

LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        feedforward.Feedforward(),
        push.Push(),
        smooth_sign.SmoothSign(),
        partial.Partial(),
        lugre_observer.LuGreObserver(),
        momentum_observer.MomentumObserver(),
    )
}
"""By name; the place of each is its number in `law_torque`."""


@compiled
def law_torque(law: int, numbers: Array, seen: Array, state: Array, period: float) -> float:
    """Return the torque of one joint by the law of that number [N·m]; see `base`."""
    if law == 0:
        return feedforward.torque(numbers, seen, state, period)
    if law == 1:
        return push.torque(numbers, seen, state, period)
    if law == 2:
        return smooth_sign.torque(numbers, seen, state, period)
    if law == 3:
        return partial.torque(numbers, seen, state, period)
    if law == 4:
        return lugre_observer.torque(numbers, seen, state, period)
    return momentum_observer.torque(numbers, seen, state, period)
