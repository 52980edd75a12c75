"""Measures of an episode: what `policies` has on its page, of rows as they were measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

Row = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A number of an episode."""

    key: str
    """Of the results."""
    label: str
    """On the page."""
    unit: str
    """Of it."""
    value: Callable[[Row], float]
    """Returns it of a row."""
    digits: int = 2
    """On the page."""
    sign: int = 1
    """−1 where more is better."""


def _over(name: str, unit: str) -> Callable[[Row], float]:
    return lambda row: row[f"{name}_{unit}"] / row[f"undithered_{name}_{unit}"]


def _column(name: str) -> Callable[[Row], float]:
    return lambda row: row[name]


GTE = (
    Measure(key="position", label="position left", unit="1", value=_over("position_left", "m")),
    Measure(
        key="orientation",
        label="orientation left",
        unit="1",
        value=_over("orientation_left", "rad"),
    ),
    Measure(
        key="position_at_rest",
        label="position left at the last goal",
        unit="1",
        value=_over("position_resting", "m"),
    ),
    Measure(
        key="orientation_at_rest",
        label="orientation left at the last goal",
        unit="1",
        value=_over("orientation_resting", "rad"),
    ),
    Measure(key="tracking", label="tracking", unit="1", value=_column("tracking_error")),
    Measure(
        key="moving",
        label="vibration moving",
        unit="1",
        value=lambda row: row["vibration_moving_mm"] / row["undithered_vibration_mm"],
    ),
    Measure(
        key="at_rest",
        label="vibration at rest",
        unit="mm",
        value=_column("vibration_at_rest_mm"),
        digits=3,
    ),
    Measure(key="power", label="power", unit="1", value=_column("power"), digits=3),
    Measure(key="rate", label="torque rate", unit="N·m/s", value=_column("torque_rate"), digits=0),
    Measure(key="return", label="return", unit="1", value=_column("return"), digits=3, sign=-1),
)
SJE = (
    Measure(
        key="torque",
        label="breakaway torque left",
        unit="1",
        value=lambda row: abs(row["tau_sje_nm"] / row["tau_base_nm"]),
    ),
    Measure(
        key="oscillation",
        label="oscillation",
        unit="mrad",
        value=_column("oscillation_mrad"),
        digits=3,
    ),
    *GTE[-3:],
)
MEASURES = {"gte": {m.key: m for m in GTE}, "sje": {m.key: m for m in SJE}}
"""Of an episode, by experiment and key."""


def truncated(rows: Sequence[Row]) -> int:
    """Count episodes that did not come to their end."""
    return sum(not row["terminated"] for row in rows)
