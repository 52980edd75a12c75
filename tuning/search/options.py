"""Options of a search."""

from __future__ import annotations

from dataclasses import dataclass

from stiction_envs.errors import StictionError, unknown
from tuning.names import OBJECTIVES, SAMPLERS, TREATMENTS


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a search, besides arm and bounds: see the arguments of `search`."""

    objective: str = "sje"
    sampler: str | None = None
    pareto: bool = False
    treatment: str | None = None
    evaluations: int | None = None

    def __post_init__(self) -> None:
        for name, choices in (
            ("objective", OBJECTIVES),
            ("sampler", (None, *SAMPLERS)),
            ("treatment", (None, *TREATMENTS)),
        ):
            if getattr(self, name) not in choices:
                raise unknown(name, getattr(self, name), [x for x in choices if x is not None])
        if self.treatment is not None and self.objective != "gte":
            raise StictionError("treatment: expected objective gte")
        if self.evaluations is not None and self.evaluations < 1:
            raise StictionError(f"evaluations {self.evaluations}: expected 1 or more")
        paths = self.objective != "sje"
        if self.sampler == "grid" and paths:
            raise StictionError("sampler grid: expected objective sje: a whole table has no grid")
        if self.pareto and self.sampler in ("gp", "cmaes"):
            raise StictionError(
                f"sampler {self.sampler} with two objectives: expected nsga2, tpe, random or grid"
            )
        if self.sampler == "nsga2" and not self.pareto:
            raise StictionError("sampler nsga2: expected pareto (two objectives)")

    @property
    def searched(self) -> tuple[str, ...]:
        """Names of the treatments that are searched one after the other."""
        return ("",) if self.treatment is None else TREATMENTS[self.treatment]

    def sampler_of(self, objective: str) -> str:
        """Return the sampler of a stage."""
        if self.sampler is not None:
            return self.sampler
        return "nsga2" if self.pareto else {"sje": "gp", "gte": "cmaes"}[objective]
