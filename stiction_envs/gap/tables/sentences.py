"""A diagnosis of torque tables in numbers and sentences that can be checked against the tables."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.protocol import LOADS
from stiction_envs.gap.tables.cells import Cell
from stiction_envs.gap.tables.evidence import DYNAMIC, FIELD
from stiction_envs.gap.tables.hypotheses import Fit, Hypothesis, Model

Array = NDArray[np.float64]
VERDICTS = ("explained", "partly explained", "no discrepancy", "cannot tell")


@dataclass(frozen=True)
class Parameter:
    """One found number."""

    value: float
    ci95: tuple[float, float]
    on_bound: bool


@dataclass(frozen=True, kw_only=True)
class TableCause:
    """One thing that the simulation gets wrong."""

    name: str
    joints: tuple[int, ...]
    parameters: dict[str, Parameter]
    gain_percent: float
    """Share of the held-out error, mean over joints, that is back without this cause [%]."""
    gain_nats: float
    """Held-out log likelihood that is lost without it."""
    evidence: str
    """One sentence that can be checked in the table."""
    confused_with: dict[str, str]
    """Causes that these tables cannot tell from it, and the measurement that would."""
    cell: Cell | None = None
    """The reading, of a corrupted dithered torque."""

    def as_dict(self) -> dict[str, Any]:
        """Return an entry of `diagnosis.json`."""
        return {
            "name": self.name,
            "joints": list(self.joints),
            "gain_percent": self.gain_percent,
            "parameters": {
                k: {"value": p.value, "ci95": list(p.ci95), "on_bound": p.on_bound}
                for k, p in self.parameters.items()
            },
            "evidence": self.evidence,
            "confused_with": list(self.confused_with),
            "told_apart_by": dict(self.confused_with),
        }


@dataclass(frozen=True, kw_only=True)
class TableDiagnosis:
    """What the tables say about the simulation."""

    robot: str
    verdict: str
    """One of `VERDICTS`."""
    causes: tuple[TableCause, ...]
    """Strongest first."""
    joints: tuple[int, ...]
    """The joints that the tables hold dithered torques of."""
    nominal: dict[int, float]
    """Mean |error| of the nominal simulation per joint, over the joint's friction [%]."""
    extended: dict[int, float]
    """The same with the causes, each block predicted from the others [%]."""
    noise_floor: dict[int, float]
    """Standard deviation of a reading, over the joint's friction [%]; NaN: cannot tell."""
    gain_percent: float
    """100 (1 − mean over joints of extended over nominal) [%]."""
    reason: str = field(default="")
    """Why nothing, or not all, could be told; empty otherwise."""

    def as_dict(self) -> dict[str, Any]:
        """Return the contents of a `diagnosis.json`; joints are text there, NaN is None."""

        def by_joint(values: Mapping[int, float]) -> dict[str, float | None]:
            return {str(j): v if math.isfinite(v) else None for j, v in values.items()}

        return {
            "robot": self.robot,
            "verdict": self.verdict,
            "reason": self.reason,
            "joints": list(self.joints),
            "nominal": {"error_percent": by_joint(self.nominal)},
            "extended": {"error_percent": by_joint(self.extended), "held_out": True},
            "noise_floor_percent": by_joint(self.noise_floor),
            "gain_percent": self.gain_percent,
            "causes": [cause.as_dict() for cause in self.causes],
        }


ELSE = "dithered torques at other frequencies and amplitudes"
_SAME_DAY = "base and dithered torques measured in turn on one day"
_OTHER_JOINTS = "the same dither on the other joints: a filter acts on all of them"
_BELOW = (
    "dither well below the presliding resonance (half of √(σ0/J)/2π): there inertia plays no part"
)
_STRONG = "a dither that takes away a third of the torque or more: an added torque stays as it was"
_POSES = "base torques in a third pose with another load"
_AGAIN = "the base torque measured again"
_FREE = "the free joint shaken at 50 to 80 Hz above breakaway: its acceleration shows the inertia"
TOLD_APART: dict[str, dict[str, str]] = {
    "low_pass": {
        "rotor_inertia": _OTHER_JOINTS,
        "presliding": _OTHER_JOINTS,
        "base_drift": _SAME_DAY,
    },
    "rotor_inertia": {
        "low_pass": _OTHER_JOINTS,
        "presliding": _BELOW,
        "base_drift": _SAME_DAY,
        "friction_level": _FREE,
    },
    "presliding": {
        "low_pass": _OTHER_JOINTS,
        "rotor_inertia": _BELOW,
        "base_drift": _SAME_DAY,
        "friction_level": _SAME_DAY,
    },
    "torque_offset": {"gravity_error": _POSES, "direction_asymmetry": _STRONG},
    "gravity_error": {"torque_offset": _POSES, "direction_asymmetry": _POSES},
    "direction_asymmetry": {"torque_offset": _STRONG, "gravity_error": _POSES},
    "friction_level": {"base_drift": _AGAIN, "presliding": _SAME_DAY, "rotor_inertia": _FREE},
    "base_drift": {
        "corrupted_cell": _AGAIN,
        "friction_level": _AGAIN,
        "low_pass": _SAME_DAY,
        "rotor_inertia": _SAME_DAY,
        "presliding": _SAME_DAY,
    },
}
"""What measurement tells two causes apart."""
KEY = {
    "low_pass": "cutoff_hz",
    "rotor_inertia": "factor",
    "presliding": "factor",
    "torque_offset": "offset_nm",
    "gravity_error": "share_of_gravity",
    "direction_asymmetry": "asymmetry_nm",
    "friction_level": "factor",
    "base_drift": "factor",
}
"""What a cause's parameter is called."""
ABSOLUTE = {"rotor_inertia": "armature_kgm2", "presliding": "bristle_stiffness"}
"""The same as an absolute number."""


def parameters_of(fits: list[Fit], model: Model) -> dict[str, Parameter]:
    """Return the parameters of a cause that one or more hypotheses state."""
    out = {}
    for fit in fits:
        h = fit.hypothesis
        logarithmic = h.name not in ("torque_offset", "gravity_error", "direction_asymmetry")
        value, low, high = (
            float(np.exp(v)) if logarithmic else float(v) for v in (fit.x, fit.low, fit.high)
        )
        key = KEY[h.name] if len(fits) == 1 and len(h.where) > 2 else f"{KEY[h.name]} {_scope(h)}"
        out[key] = Parameter(value, (low, high), fit.on_bound)
        if h.instead:
            out["offset_nm"] = Parameter(-value, (-high, -low), fit.on_bound)
        if h.name in FIELD:
            unit = model.lone(h.joints[0]).nominal[h.name]
            out[ABSOLUTE[h.name]] = Parameter(unit * value, (unit * low, unit * high), fit.on_bound)
    return out


def _scope(h: Hypothesis) -> str:
    """Return the poses and directions of a hypothesis in words."""
    if len(h.where) == 1:
        return f"{h.where[0].load} {h.where[0].direction}"
    loads = sorted({w.load for w in h.where})
    return loads[0] if len(loads) == 1 else "both poses"


def _joints(joints: tuple[int, ...]) -> str:
    return f"joint{'s' * (len(joints) > 1)} {', '.join(map(str, joints))}"


def evidence_of(name: str, some: list[Hypothesis], model: Model, without: Model) -> str:
    """Return one sentence that can be checked in the tables.

    Args:
        name: of the cause.
        some: its hypotheses.
        model: with the cause.
        without: without it.
    """
    if name in DYNAMIC:
        return _dynamic(some[0], model, without)
    if name in ("friction_level", "base_drift"):
        return "; ".join(_level(h, without) for h in some)
    return _halves(some[0], without)


def _dynamic(h: Hypothesis, model: Model, without: Model) -> str:
    """Say where the cause matters most, in per cent of change as the tables print it."""
    r = model.readings
    rows = r.of_joints(h.joints)
    everything = np.arange(len(r.all))
    new = model.predict(everything, model.values)[0]
    old = without.predict(everything, without.values)[0]
    frequency = np.array([x.frequency for x in r.all])
    effect = np.abs(new - old) / model.unit
    choice = max({f for f in frequency[rows] if f}, key=lambda f: effect[rows][frequency[rows] == f].mean())  # fmt: skip  # noqa: E501
    at = [int(i) for i in rows if frequency[i] == choice]
    change = {
        k: 100 * np.mean([v[i] / _base(model, v, i) - 1 for i in at])
        for k, v in (("measured", r.torque), ("old", old), ("new", new))
    }
    value = float(np.exp(model.values[h]))
    text = f"a cut-off of {value:.3g} Hz" if h.name == "low_pass" else f"{value:.2f} times the {NAMES[h.name]}"  # fmt: skip  # noqa: E501
    return (
        f"{choice:g} Hz dither changes the torque of {_joints(h.joints)} by "
        f"{change['measured']:+.1f} % on average over {len(at)} readings; the simulation says "
        f"{change['old']:+.1f} %, and with {text} {change['new']:+.1f} %"
    )


NAMES = {"rotor_inertia": "rotor inertia", "presliding": "bristle stiffness"}


def _base(model: Model, values: Array, i: int) -> float:
    """Return the base torque that belongs to a reading."""
    r = model.readings
    return float(values[next(k for k, x in enumerate(r.all)
                             if x.cell is None and x.where == r.all[i].where)])  # fmt: skip


def _level(h: Hypothesis, without: Model) -> str:
    """Say how far the readings are off, and that they are so at every frequency."""
    r, rows = without.readings, without.readings.of(h.where)
    predicted = without.predict(np.arange(len(r.all)), without.values)[0]
    off = 100 * (r.torque - predicted) / without.unit
    dithered, base = off[rows & ~r.base], off[rows & r.base]
    low, high = np.percentile(dithered, [10, 90])
    return (
        f"{_joints(h.joints)} {_scope(h)}: eight of ten of the {len(dithered)} dithered torques "
        f"are {low:+.1f} to {high:+.1f} % of the friction off the simulation (median "
        f"{np.median(dithered):+.1f} %), the base torques {base.mean():+.1f} %"
    )


def _halves(h: Hypothesis, without: Model) -> str:
    """Say what half the sum of both directions is, beyond the simulation's."""
    r, j = without.readings, h.joints[0]
    off = r.sign * (r.torque - without.predict(np.arange(len(r.all)), without.values)[0])
    ratio = np.array([x.torque / _base(without, r.torque, i) for i, x in enumerate(r.all)])
    parts = []
    for k, load in enumerate(LOADS):
        mine = (r.joint == j) & (r.pose == k)
        strong = mine & ~r.base & (ratio <= np.median(ratio[mine & ~r.base]))
        parts.append(
            f"{_mean(off, r.sign, mine & r.base):+.3f} N·m {load} without dither, "
            f"{_mean(off, r.sign, strong):+.3f} N·m under the stronger half of the dithers, which "
            f"leave {100 * ratio[strong].mean():.0f} % of the torque"
        )
    loads = " and ".join(f"{g:+.2f}" for g in without.loads[j - 1])
    return (
        f"joint {j}: half the sum of + and − torques exceeds the simulation's by "
        f"{'; by '.join(parts)}; the poses' loads are {loads} N·m"
    )


def _mean(off: Array, sign: Array, some: NDArray[np.bool_]) -> float:
    """Return the mean of the medians of both directions."""
    sides = [np.median(off[some & (sign == s)]) for s in (1.0, -1.0) if (some & (sign == s)).any()]
    return float(np.mean(sides))


def bad_reading(i: int, model: Model) -> str:
    """Say what is read, what is expected, and how well the readings around it are met."""
    r, x = model.readings, model.readings.all[i]
    predicted = model.predict(np.arange(len(r.all)), model.values)[0]
    off = 100 * (r.torque - predicted) / model.unit
    near = [k for k, y in enumerate(r.all) if y.where == x.where and k != i]
    what = f"{x.frequency:g} Hz, {x.amplitude:.4g} N·m" if x.cell else "base torque"
    return (
        f"joint {x.where.joint} {x.where.load} {x.where.direction}, {what}: "
        f"{x.where.sign * x.torque:.4f} N·m is read where {x.where.sign * predicted[i]:.4f} N·m "
        f"is expected; the other {len(near)} readings of this pose and direction are within "
        f"{np.abs(off[near]).max():.0f} % of the friction, this one is {off[i]:+.0f} % off"
    )
