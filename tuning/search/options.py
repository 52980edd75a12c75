"""Options of a search, and what its stages found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from stiction_envs.control.compensation import KINDS, Compensation
from stiction_envs.errors import StictionError, unknown
from tuning.search.bounds import OPTIONS, Bounds
from tuning.search.tracking import Table
from tuning.settings import SearchSettings
from tuning.study.record import Record
from tuning.study.samplers import available

OBJECTIVES = ("sje", "gte", "both")
GATES = ("none", "one", "each")
COMPENSATIONS = ("none", *KINDS)
PRICES = ("shaking", "power", "torque_rate")
"""Second objectives: displacement (SJE) [rad] or vibration (GTE) [m]; power of the dither [W], mean
(GTE) or apparent, torque times speed (SJE); rate of its torque [N·m/s]."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a search, besides arm and bounds."""

    objective: str = "sje"
    """One of `OBJECTIVES`."""
    sampler: str | None = None
    """One of `samplers.available`; None: gp for the SJE, cmaes for the GTE."""
    pareto: str | None = None
    """Second objective, one of `PRICES`; None: one objective. Shaking is a constraint
    unless it is this objective."""
    free: tuple[str, ...] = ()
    """Some of `bounds.OPTIONS`: parameters to search besides amplitude and frequency."""
    gates: str = "none"
    """Gates of the GTE, one of `GATES`."""
    compensation: str = "none"
    """Friction compensation of the GTE to search too, one of `COMPENSATIONS`."""
    without_dither: bool = False
    """Whether compensation is searched without dither."""
    evaluations: int | None = None
    """Trials per joint (SJE) and of whole tables (GTE); None: the settings'."""

    def __post_init__(self) -> None:
        if self.objective not in OBJECTIVES:
            raise unknown("objective", self.objective, OBJECTIVES)
        if self.sampler is not None and self.sampler not in available():
            raise unknown("sampler", self.sampler, available())
        if self.pareto is not None and self.pareto not in PRICES:
            raise unknown("pareto", self.pareto, PRICES)
        if self.gates not in GATES:
            raise unknown("gates", self.gates, GATES)
        if self.compensation not in COMPENSATIONS:
            raise unknown("compensation", self.compensation, COMPENSATIONS)
        if self.compensation != "none" and self.objective == "sje":
            raise StictionError("compensation: expected objective gte or both")
        if self.without_dither and (self.compensation == "none" or self.objective != "gte"):
            raise StictionError("without dither: expected objective gte, and a compensation")
        if self.without_dither and self.gates != "none":
            raise StictionError("gates: expected dither to be searched")
        for name in self.free:
            if name not in OPTIONS:
                raise unknown("search option", name, OPTIONS)
        if self.evaluations is not None and self.evaluations < 1:
            raise StictionError(f"evaluations {self.evaluations}: expected 1 or more")
        if self.gates != "none" and self.objective == "sje":
            raise StictionError("gates: expected objective gte or both: in the SJE a joint rests")
        paths = self.objective != "sje"
        if "waveform" in self.free and "cmaes" in (self.sampler, paths and self.sampler_of("gte")):
            raise StictionError("sampler cmaes: cannot search waveforms: expected gp, tpe, random")
        if self.sampler == "grid" and paths:
            raise StictionError("sampler grid: expected objective sje: a whole table has no grid")
        if self.pareto and self.sampler in ("gp", "cmaes"):
            raise StictionError(
                f"sampler {self.sampler} with two objectives: expected nsga2, tpe, random or grid"
            )
        if self.sampler == "nsga2" and not self.pareto:
            raise StictionError("sampler nsga2: expected pareto (two objectives)")

    @property
    def objectives(self) -> int:
        """Number of objectives."""
        return 1 if self.pareto is None else 2

    def sampler_of(self, objective: str) -> str:
        """Return the sampler of a stage."""
        if self.sampler is not None:
            return self.sampler
        return "nsga2" if self.pareto else {"sje": "gp", "gte": "cmaes"}[objective]


@dataclass(frozen=True, kw_only=True)
class Found:
    """Results of the stages of a search."""

    robot: str
    """Name of the arm."""
    options: Options
    """Options of the search."""
    bounds: Bounds
    """Bounds of the search."""
    settings: SearchSettings
    """Settings of the search."""
    records: Mapping[str, Sequence[Record]]
    """Studies per stage, ``sje`` and ``gte``; ``grid`` is the thesis's."""
    tables: Mapping[str, Table]
    """Table that each stage chose."""
    others: Mapping[str, Table]
    """Tables to compare with."""
    limit: Mapping[str, Any]
    """Largest displacement (n,) [rad] of ``sje``, vibration (2,) [m] of ``gte``."""
    compensation: Compensation | None
    """Compensation that was chosen."""
    note: str = ""
    """Shown at the top of the report."""

    @property
    def final(self) -> Table:
        """The table of the last stage."""
        return list(self.tables.values())[-1]
