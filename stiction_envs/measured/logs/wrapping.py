"""Angles that come within one turn, as of continuous joints, and so jump."""

from __future__ import annotations

import numpy as np

from stiction_envs.measured.logs.corrections import Array, Correction, RawLog

TURN = 2 * np.pi
OFF = 0.5
"""A jump is a turn to this much, which the joint moves meanwhile [rad]; assumed."""


def unwrap(rows: RawLog) -> list[Correction]:
    """Add whole turns to angles where they jump by one, and to commands a turn away, in place."""
    found: dict[str, int] = {}
    for name in (x for x in ("q", "q_cmd") if x in rows.data):
        for j, x in enumerate(rows.data[name].T):
            if jumps := _unwrap(x):
                found[f"{name}{j + 1}"] = jumps
    if "q_cmd" in rows.data:
        for j, (x, q) in enumerate(zip(rows.data["q_cmd"].T, rows.data["q"].T, strict=True)):
            both = ~np.isnan(x - q)
            apart = float(np.median((x - q)[both])) if both.any() else 0.0
            if (turns := round(apart / TURN)) and abs(apart - turns * TURN) < OFF:
                x -= turns * TURN
                found.setdefault(f"q_cmd{j + 1}", 1)
    text = f"{', '.join(found)}: angles within one turn, which jump at its ends: unwrapped"
    return [Correction(kind="wrap", rows=sum(found.values()), text=text)] if found else []


def _unwrap(x: Array) -> int:
    """Add whole turns to angles (T,) within one turn, in place; return how often they jump."""
    known = np.flatnonzero(~np.isnan(x))
    if not len(known) or np.ptp(x[known]) > TURN + 1e-3:
        return 0
    jump = np.diff(x[known])
    turns = -np.sign(jump) * (np.abs(jump) > TURN - OFF)
    x[known[1:]] += TURN * np.cumsum(turns)
    return int(np.count_nonzero(turns))
