"""Torques of the opposite sign are inverted, those that are not measured left out: by `loads`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.gap.settings import GapSettings
from stiction_envs.gap.signals.loads import loads
from stiction_envs.gap.signals.prepare import Signals
from stiction_envs.measured.logs.corrections import Correction
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.reporting.markdown import joints as joint_list
from stiction_envs.robots import Arm

OF_CHANNELS = ("torque_sign", "measured", "findings", "set_up", "zero_off")
"""Fields of `Signals` that `correct_sign` fills in."""


def correct_sign(
    logs: Sequence[JointLog],
    signals: Signals,
    arm: Arm,
    settings: GapSettings | None = None,
    known: int = 0,
) -> tuple[list[JointLog], Signals]:
    """Invert torques of the opposite sign, leave out those that are not measured, and say so.

    Args:
        logs: of one robot, with one convention.
        signals: made of them.
        arm: the nominal rigid arm.
        settings: constants of the method; None for those of ``settings.toml``.
        known: sign of the robot's torques by an earlier diagnosis, 1 or -1; 0 for none. Only a load
            that changes overrides it.

    Returns:
        Logs, with notes on corrections, and signals; unchanged where nothing is wrong.

    Raises:
        StictionError: a joint's torque has the opposite sign in one log, and not in another.
    """
    numbers = dict.fromkeys(s.log for s in signals.segments)
    found = {k: loads(signals, k, arm, settings) for k in numbers}
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
    done = replace(
        signals,
        torque_sign=-1 if opposite.all() else int(signs.any()),
        measured=np.all([x.measured for x in found.values()], axis=0),
        set_up=any(x.elsewhere or (x.angle and x.angle.offset is None) for x in found.values()),
        zero_off=next((x.angle for x in found.values() if x.angle and x.angle.offset), None),
        findings=tuple(dict.fromkeys(text for x in found.values() for text in x.findings)),
    )
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
    turned = []
    for log in logs:
        extra = {k: x * side if k == "tau_cmd" else x for k, x in log.extra.items()}
        corrections = (*log.corrections, Correction(kind="sign", rows=len(log.t), text=text))
        turned.append(replace(log, tau=log.tau * side, extra=extra, corrections=corrections))
    segments = tuple(replace(s, tau=s.tau * side) for s in done.segments)
    return turned, replace(done, segments=segments)
