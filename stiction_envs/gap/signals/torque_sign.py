"""Torques of another sign or unit are corrected, dead channels left out: by `loads`."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.gap.signals.loads import loads
from stiction_envs.gap.signals.prepare import Signals
from stiction_envs.measured.logs.corrections import Correction
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.reporting.markdown import joints as joint_list
from stiction_envs.robots import Arm

OF_CHANNELS = ("torque_sign", "torque_unit", "measured", "findings", "set_up", "zero_off")
"""Fields of `Signals` that `correct_sign` fills in."""
LARGE_UNIT = 10.0
"""Torque over load from which on torques are converted [-]; assumed: missing masses make 2 to 3."""
SAME_UNIT = 2.0
"""Factor within which the units of two logs of a robot are the same [-]; assumed."""


def correct_sign(
    logs: Sequence[JointLog],
    signals: Signals,
    arm: Arm,
    known: int = 0,
    known_unit: Array | None = None,
) -> tuple[list[JointLog], Signals]:
    """Return logs and signals after torques of another sign or unit were corrected.

    Each change is recorded as a correction; channels that are not measured are left out.

    Args:
        logs: of one robot, with one convention.
        signals: made of the logs.
        arm: the nominal rigid arm.
        known: sign of the robot's torques by an earlier diagnosis, 1 or -1; 0 for none. Only a load
            that changes overrides it.
        known_unit: (n,) what 1 N·m is in the unit of the torques, likewise; None for 1.

    Raises:
        StictionError: a joint's torque has the opposite sign in one log, and not in another.
    """
    numbers = np.unique(signals.log).tolist()
    found = {k: loads(signals, k, arm) for k in numbers}
    shown = {k: x for k, x in found.items() if x.by_load.any()}
    for j in range(arm.n):
        each = {int(x.sign[j]): k for k, x in shown.items() if x.by_load[j]}
        if len(each) > 1:
            wrong, right = (Path(logs[each[x]].source) for x in (-1, 1))
            raise StictionError(
                f"{wrong}: tau{j + 1} has the opposite sign of what the model needs, but in "
                f"{right.name} the right one: expected one sign in all logs, tau drives the joint"
            )
    signs = np.array([x.sign for x in (shown or found).values()])
    again = any(c.kind == "sign" for x in logs for c in x.corrections)
    if known and not shown:
        signs = np.full((1, arm.n), 1 if again else known)
    opposite = (signs < 0).any(axis=0) & (signs <= 0).all(axis=0)
    unit = shared_unit([x.unit for x in found.values() if x.unit is not None], known_unit)
    done = replace(
        signals,
        torque_sign=-1 if opposite.all() else int(signs.any()),
        measured=np.all([x.measured for x in found.values()], axis=0),
        set_up=any(x.elsewhere or (x.angle and x.angle.offset is None) for x in found.values()),
        zero_off=next((x.angle for x in found.values() if x.angle and x.angle.offset), None),
        findings=tuple(dict.fromkeys(text for x in found.values() for text in x.findings)),
    )
    if (unit != 1).any():
        logs, done = converted(logs, done, unit * np.ones(arm.n))
    if not opposite.any():
        return list(logs), done
    which = joint_list([int(j) + 1 for j in np.flatnonzero(opposite)])
    side = np.where(opposite, -1.0, 1.0)
    text = (
        f"torques of {'all joints' if opposite.all() else which} have the opposite sign of the "
        "usual one: inverted, so that tau drives the joint"
    )
    if known < 0 and not shown:
        text += ", as those of the diagnosed logs"
    return _times(logs, done, side, "sign", text)


def shared_unit(shown: Sequence[float], known: Array | None) -> Array:
    """Return (n,) or (1,) what 1 N·m is in the unit of all logs; 1 where the unit may be N·m.

    ``shown`` are the units of the logs that show one; ``known`` (n,) is the unit of an earlier
    diagnosis, None for N·m.
    """
    unit = float(np.median(shown)) if shown else None
    if known is not None:
        usual = float(np.median(known))
        if unit is None or 1 / SAME_UNIT < unit / usual < SAME_UNIT:
            return known
    return np.full(1, unit if unit and (unit < 1 or unit > LARGE_UNIT) else 1.0)


def converted(
    logs: Sequence[JointLog], signals: Signals, unit: Array
) -> tuple[list[JointLog], Signals]:
    """Return logs and signals with torques in N·m: divided by ``unit`` (n,), and by no other."""
    more = unit / signals.torque_unit
    done = replace(signals, torque_unit=unit)
    each = ", ".join(f"{x:.3g}" for x in dict.fromkeys(unit))
    text = f"torques are converted to N·m: divided by {each}"
    earlier = [
        replace(x, corrections=tuple(c for c in x.corrections if c.kind != "unit")) for x in logs
    ]
    return _times(earlier, done, 1 / more, "unit", text)


def _times(
    logs: Sequence[JointLog], signals: Signals, factor: Array, kind: str, text: str
) -> tuple[list[JointLog], Signals]:
    """Return logs and signals with torques times a factor (n,), noted as a correction."""
    out = []
    for log in logs:
        extra = {k: x * factor if k == "tau_cmd" else x for k, x in log.extra.items()}
        corrections = (*log.corrections, Correction(kind=kind, rows=len(log.t), text=text))
        out.append(replace(log, tau=log.tau * factor, extra=extra, corrections=corrections))
    noise = signals.noise_tau * np.abs(factor)
    return out, replace(signals, tau=signals.tau * factor, noise_tau=noise)
