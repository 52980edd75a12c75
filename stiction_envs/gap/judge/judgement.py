"""What the judge says: named causes, how sure it is, who takes how much, what was not shown."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.reporting.json_text import plain

WIDTH = 1.96
"""Half width of a 95 % interval of a Gaussian, in standard deviations [-]."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """One parameter of a cause on one joint, or of the arm."""

    value: float | list[float]
    ci95: Any
    """[low, high], or one such pair per number."""
    on_bound: bool


@dataclass(frozen=True, kw_only=True)
class NamedCause:
    """One significant cause, of any kind of data."""

    name: str
    joints: tuple[int, ...]
    """The joints (from 1) where it is significant; all joints for causes of the whole arm."""
    gain_percent: float
    """Loss of agreement when this cause alone is removed [%]."""
    parameters: dict[int, dict[str, Estimate]]
    """By joint (from 1); 0 for the whole arm."""
    nats: float = math.nan
    """Log evidence against the model without this cause [nats]."""
    rivals: tuple[tuple[str, float], ...] = ()
    """Log evidence against the best model with another cause in its place [nats], nearest first."""
    evidence: str
    confused_with: tuple[str, ...]
    told_apart_by: dict[str, str] | None = None
    """The measurement that tells it from each of `confused_with`; None where `what_to_record` of
    both does."""

    def to_json(self) -> dict[str, object]:
        """Return an entry of ``causes``.

        Parameters are those of the arm or of the strongest joint, then those of every joint.
        """
        by_joint = {
            str(j): {k: plain(asdict(e)) for k, e in found.items()}
            for j, found in self.parameters.items()
        }
        parameters: dict[str, object] = dict(next(iter(by_joint.values())))
        if len(by_joint) > 1:
            parameters["by_joint"] = by_joint
        return {
            "name": self.name,
            "joints": list(self.joints),
            "gain_percent": self.gain_percent,
            "parameters": parameters,
            "nats": self.nats,
            "evidence": self.evidence,
            "confused_with": list(self.confused_with),
            "rivals": [{"name": name, "nats": nats} for name, nats in self.rivals],
            **({} if self.told_apart_by is None else {"told_apart_by": self.told_apart_by}),
        }


@dataclass(frozen=True, kw_only=True)
class NotShown:
    """A cause whose posterior is about as wide as its prior along this motion."""

    name: str
    joints: tuple[int, ...]
    """From 1; () for the whole arm."""
    parameters: Mapping[str, tuple[float, float]]
    """95 % interval of each parameter."""

    def to_json(self) -> dict[str, object]:
        """Return an entry of ``not_shown``."""
        intervals = {k: {"ci95": list(x)} for k, x in self.parameters.items()}
        return {"name": self.name, "joints": list(self.joints), "parameters": intervals}


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelCheck:
    """Both models on logs that took no part."""

    nominal_rms: Array
    """(n,) error, root mean square [N·m], or of servo logs [rad]."""
    extended_rms: Array
    """(n,) likewise."""
    worse_joints: tuple[int, ...]
    """From 1."""
    unit: str = "nm"
    """Unit of errors in the keys of ``diagnosis.json``."""

    @property
    def verdict(self) -> str:
        """``holds`` or ``does not hold``."""
        return "does not hold" if self.worse_joints else "holds"

    @property
    def not_transferring(self) -> tuple[str, ...]:
        """Names of causes whose presence makes a joint worse."""
        return ()

    def to_json(self) -> dict[str, object]:
        """Return ``check`` of ``diagnosis.json``."""
        return {
            f"nominal_rms_{self.unit}": self.nominal_rms.tolist(),
            f"extended_rms_{self.unit}": self.extended_rms.tolist(),
            "verdict": self.verdict,
            "worse_joints": list(self.worse_joints),
            "not_transferring": list(self.not_transferring),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Judgement(ABC):
    """What a diagnosis of any kind of data says of the simulation."""

    robot: str
    verdict: str
    """``explained``, ``partly explained``, ``no discrepancy`` or ``cannot tell``."""
    causes: tuple[NamedCause, ...] = ()
    """Strongest first."""
    minor: tuple[NamedCause, ...] = ()
    """Causes that improve the fit a little; alone they are not reliable."""
    shares_percent: Mapping[str, float] = field(default_factory=dict)
    """What takes how much off the nominal error, ``named``, ``links`` and ``set_up``, and what is
    ``left`` [%]."""
    not_shown: tuple[NotShown, ...] = ()

    @property
    @abstractmethod
    def gain_percent(self) -> float:
        """100 (1 − mean over joints of extended over nominal held-out error) [%]."""

    @abstractmethod
    def to_json(self) -> dict[str, object]:
        """Return ``diagnosis.json``."""

    def judged_json(self) -> dict[str, object]:
        """Return the part of ``diagnosis.json`` that all kinds of data share."""
        out: dict[str, object] = {
            "causes": [c.to_json() for c in self.causes],
            "minor": [
                {"name": c.name, "joints": list(c.joints), "gain_percent": c.gain_percent}
                for c in self.minor
            ],
        }
        if self.shares_percent:
            out["shares_percent"] = dict(self.shares_percent)
        if self.not_shown:
            out["not_shown"] = [x.to_json() for x in self.not_shown]
        return out


def percent_gained(nominal: Array, extended: Array) -> float:
    """Return 100 (1 − mean over joints of extended over nominal error) [%]."""
    return float(100 * (1 - np.mean(extended / np.maximum(nominal, 1e-300))))


def percent_lost(without: Array, extended: Array, nominal: Array) -> float:
    """Return the loss when one cause is removed, mean over joints [%].

    A fit without it may be worse on a joint than the nominal model; the loss is limited to that.

    Args:
        without: (n,) error of the extended model without the cause.
        extended: (n,) error with it.
        nominal: (n,) error of the nominal model.
    """
    lost = (np.minimum(without, nominal) - extended) / np.maximum(nominal, 1e-300)
    return float(100 * np.mean(lost))
