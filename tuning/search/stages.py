"""Stages of a search: each joint in the SJE, whole tables in the GTE, the final measurement."""

import dataclasses
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.control.compensation import Compensation
from stiction_envs.control.compensation_files import write_treatment
from stiction_envs.control.laws import LAWS
from stiction_envs.errors import ExperimentError, StictionError, checked_array, unknown
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import TRAJECTORIES
from stiction_envs.experiments.gte.random_paths import RANDOM
from stiction_envs.experiments.gte.rows import thesis_stiffness
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.measured.tables import AmplitudeRow
from stiction_envs.reporting.kept_rows import KeptRows
from tuning.names import OBJECTIVES, SAMPLERS, TREATMENTS
from tuning.search.bounds import Bounds, Table
from tuning.search.breakaway import BreakawayObjective
from tuning.search.frictions import frictions
from tuning.search.tracking import Place, TrackingObjective, Treatment
from tuning.search.trials import best, front, score, write_trials
from tuning.search.verify import AT_REST, NOTHING, Tracked, Unseen, Verified, another_start
from tuning.settings import TuningSettings
from tuning.study.record import Parameters, Record, Space, TrialSearch
from tuning.study.samplers import cells, sampler
from tuning.study.tuning_run import Progress, TuningRun, counted
from tuning.study.workers import Evaluate, fill

TUNED = TRAJECTORIES[:1]  # Paths on which a table is tuned; it is verified on others too
SEARCHED = "search gte"
BELIEVED = ("feedforward", "push", "momentum_observer")
"""Compensations with the gains of the model, to compare with; the last leaves least error."""
LAYOUT = "2"  # The form of rows in verified.jsonl; a run does not go on from rows of another one
UNSEEN = 7919
"""Added to the seed of drawn frictions [-]; assumed: larger than the seeds that people use."""


@dataclasses.dataclass(frozen=True, kw_only=True)
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
        if self.evaluations is not None:
            checked_array(self.evaluations, "evaluations", (), low=1)
        if self.sampler == "grid" and self.objective != "sje":
            raise StictionError("sampler grid: expected objective sje: a whole table has no grid")
        if self.pareto and self.sampler == "cmaes":
            raise StictionError(
                "sampler cmaes with two objectives: expected gp, tpe, random or grid"
            )

    @property
    def searched(self) -> tuple[str, ...]:
        """Names of the treatments that are searched one after the other."""
        return ("",) if self.treatment is None else TREATMENTS[self.treatment]

    def sampler_of(self, objective: str) -> str:
        """Return the sampler of a stage."""
        if self.sampler is not None:
            return self.sampler
        return "tpe" if self.pareto else {"sje": "gp", "gte": "cmaes"}[objective]


@dataclasses.dataclass(kw_only=True, eq=False)
class SearchStages:
    """The stages of one search; each of them finds its earlier results in the studies."""

    run: TuningRun
    sje: SingleJointExperiment
    bounds: Bounds
    others: dict[str, Table]
    limits: Table  # Table whose displacement and vibration may not be exceeded
    options: Options
    settings: TuningSettings
    progress: Progress
    records: dict[str, list[Record]] = dataclasses.field(default_factory=dict)
    """Studies per stage, ``sje`` and ``gte``."""
    tables: dict[str, Table] = dataclasses.field(default_factory=dict)
    compensation: Compensation | None = None
    treatments: dict[str, Treatment] = dataclasses.field(default_factory=dict)
    """Results on paths, by the name of the treatment, or ``search gte``."""
    chosen: str = ""  # Name of the treatment that is the result of the search on paths

    def __post_init__(self) -> None:
        self.search, self.seed = self.settings.search, self.sje.seed

    @property
    def final(self) -> Table:
        """The table of the last stage."""
        return list(self.tables.values())[-1]

    @cached_property
    def frictions(self) -> list[FrictionParameters]:
        """Frictions under which a setting is tried."""
        s = self.search
        return frictions(self.sje.sticking.parameters, s.draws, spread=s.spread, seed=self.seed)

    def find(self) -> Verified:
        """Run all stages, write their tables, and measure these again."""
        tables, folder = self.tables, self.run.folder.path
        if self.options.objective in ("sje", "both"):
            tables["search sje"] = self.breakaway()
        if self.options.objective in ("gte", "both"):
            for kind in self.options.searched:
                name = f"{kind}, searched" if kind else SEARCHED
                self.treatments[name] = self.tracking(tables.get("search sje"), kind)
                if len(self.options.searched) > 1:
                    self._write(folder / kind, self.treatments[name])
        write_trials(folder / "trials.csv", self.records)
        tracking = self.verify_paths() if self.treatments else {}
        if self.treatments:
            judged = self.ranking(tracking)
            # one that was asked for by name is the result, recommended or not
            self.chosen = next(iter(self.treatments if len(self.treatments) == 1 else judged), "")
            best_one = self.treatments.get(self.chosen, Treatment())
            tables[SEARCHED], self.compensation = best_one.dither, best_one.compensation
        if self.options.pareto:
            write_trials(folder / "pareto.csv", self.records, front)
        self._write(folder, Treatment(dither=self.final, compensation=self.compensation))
        breakaway = self._unseen.breakaway(
            self.sje.replace(seed=self.seed + 1),
            # a ramp takes long: if only paths were searched, the table found is enough
            {**tables, **self.others} if "search sje" in tables else tables,
        )
        return Verified(breakaway=breakaway, tracking=tracking)

    def _write(self, folder: Path, found: Treatment) -> None:
        """Write the files that are handed over, if anything was found."""
        if found != Treatment():
            folder.mkdir(exist_ok=True)
            names = self.sje.sticking.arm.joint_names
            write_treatment(folder, found.dither, found.compensation, names)

    def reach(self) -> None:
        """Open the first study before anything is simulated or written: it may be unavailable."""
        stage, study = "sje", "sje-joint1"
        if self.options.objective == "gte":
            stage, study = "gte", _study(self.options.searched[0])
        self.run.record(study, 1 + self.options.pareto, self.options.sampler_of(stage))

    def _search(
        self, stage: str, study: str, space: Space, seed: int, first: Parameters | None = None
    ) -> TrialSearch:
        """Return a search by the sampler of a stage; a grid is one batch of all its cells."""
        s, options = self.search, self.options
        name = options.sampler_of(stage)
        batch = s.population if name == "cmaes" else 1
        startup, usual = s.startup, s.evaluations_sje
        if stage == "gte":
            startup, usual = s.population, s.evaluations_gte
        evaluations = options.evaluations or usual
        begin: tuple[Parameters, ...] = () if first is None else (first,)
        if name == "grid":
            begin = cells(space, s.points, seed)
            batch = len(begin)
            evaluations = min(options.evaluations or batch, batch)
        return TrialSearch(
            record=self.run.record(study, 1 + options.pareto, name),
            space=space,
            sampler=sampler(
                name, space, seed=seed, startup=startup, population=batch, first=first, step=s.step
            ),
            evaluations=evaluations,
            batch=batch,
            first=begin,
        )

    def _fill(self, stage: str, searches: list[TrialSearch], evaluate: Evaluate) -> None:
        fill(searches, evaluate, partial(self.progress, stage))
        self.records.setdefault(stage, []).extend(s.record for s in searches)

    # ---- the SJE -----------------------------------------------------------------------------

    def breakaway(self) -> Table:
        """Search every joint separately; return the best setting of each."""
        objective = BreakawayObjective(
            self.sje,
            self.bounds,
            self.frictions,
            iterations=self.search.iterations,
            limits=self.limits,
            pareto=self.options.pareto,
            progress=counted(self.progress, "base torques"),  # the total is not known
        )
        objective.progress = None  # from here on trials are counted
        searches = [
            self._search("sje", f"sje-joint{j}", self.bounds.space(j), self.seed * 1000 + j)
            for j in range(1, self.sje.n + 1)
        ]
        self._fill("sje", searches, objective.evaluate)
        rows = []
        for j, one in enumerate(searches, 1):
            chosen = best(one.record.trials)
            row = AmplitudeRow(j, 0.0, 0.0)
            if chosen is not None and chosen.values[0] < 1.0:
                row = self.bounds.setting(j, chosen.params)
            rows.append(row)
        return tuple(rows)

    # ---- the GTE -----------------------------------------------------------------------------

    def tracking(self, begin: Table | None, kind: str) -> Treatment:
        """Search a treatment of the whole arm, ``kind`` of `Options.searched`; return the best."""
        s, options = self.search, self.options
        still = kind not in ("", "dither")
        places: list[Place] = [(path, k) for path in TUNED for k in thesis_stiffness()]
        objective = TrackingObjective(
            self._gte(self.seed),
            self.bounds,
            self.frictions,
            places,
            iterations=s.iterations,
            joints=() if still else range(1, self.sje.n + 1),
            compensation=kind if still else "none",
            rest_margin=s.rest_margin if kind else None,
            limits=self.limits,
            penalty=s.penalty if options.sampler_of("gte") == "cmaes" else 0.0,
            pareto=options.pareto,
            settings=self.settings.bounds,
        )
        gentle = tuple(
            dataclasses.replace(r, amplitude_nm=s.gentle * r.amplitude_nm) for r in begin or ()
        )
        first = objective.parameters(gentle or self.limits)
        one = self._search("gte", _study(kind), objective.space(), self.seed, first)
        self._fill("gte", [one], objective.evaluate)
        chosen = best(one.record.trials)
        if chosen is None:
            if kind:
                return Treatment()
            raise ExperimentError(
                f"none of {one.evaluations} tables keeps the limits on vibration: expected a "
                "larger limit, or more evaluations"
            )
        if score(chosen) >= 0.0:  # no more than no dither achieves
            return Treatment(dither=tuple(AmplitudeRow(j, 0.0, 0.0) for j in objective.joints))
        return objective.treatment(chosen.params)

    def _gte(self, seed: int, start: ArrayLike | None = None) -> GeneratedTrajectoryExperiment:
        """Return the experiment of this arm."""
        sje = self.sje
        return GeneratedTrajectoryExperiment(
            sje.sticking, start=start, sensing=sje.sensing, seed=seed, threads=sje.threads
        )

    # ---- what was found ----------------------------------------------------------------------

    def ranking(self, tracking: Tracked) -> list[str]:
        """Return treatments that may be recommended, those that leave least error first.

        They leave less than nothing does, and on no path shake at rest more than that and a margin.
        """
        margin = self.search.rest_margin
        allowed = [
            name
            for name in self.treatments
            if self.left(tracking, name) < 1.0
            and all(
                result.totals[AT_REST] <= tracking[NOTHING][path].totals[AT_REST] + margin
                for path, result in tracking[name].items()
            )
        ]
        return sorted(allowed, key=lambda name: self.left(tracking, name))

    def left(self, tracking: Tracked, name: str) -> float:
        """Return the error left on unseen paths over no treatment's, geometric mean [-].

        The mean is over position and orientation at all goals.
        """
        unseen = [r for path, r in tracking[name].items() if path not in TUNED]
        values = [r.left[x][0] for r in unseen for x in ("position", "orientation")]
        return float(np.exp(np.mean(np.log(values))))

    def needs(self, name: str) -> str:
        """Return the prerequisites of a treatment: models, measurements."""
        compensation = self.treatments[name].compensation
        return "nothing" if compensation is None else LAWS[compensation.kind].knows

    def verify_paths(self) -> Tracked:
        """Measure treatments again, from a start and on paths that the search has not seen."""
        start = another_start(self.sje.sticking.arm, self.search.verify_start, [self.seed, UNSEEN])
        unseen = self._gte(self.seed + 1, start=start)
        experiment = self._gte(self.seed)
        out = {name: Treatment(dither=table) for name, table in self.tables.items()}
        out |= self.treatments
        out |= {name: Treatment(dither=table) for name, table in self.others.items()}
        for kind in BELIEVED:
            out[f"{kind}, as believed"] = Treatment(compensation=experiment.compensation(kind))
        random = self.options.treatment is not None
        try:
            unseen.path(f"{RANDOM}-0")
        except StictionError:  # this arm can follow none around its start
            random = False
        return self._unseen.tracking(unseen, out, random=random)

    @cached_property
    def _unseen(self) -> Unseen:
        """Repeated measurements of tables and treatments."""
        s, parameters = self.search, self.sje.sticking.parameters
        draws = frictions(parameters, s.verify_draws, spread=s.spread, seed=self.seed + UNSEEN)
        return Unseen(
            bounds=self.bounds,
            frictions=draws,
            settings=s,
            kept=KeptRows(self.run.folder.path / "verified.jsonl", code=LAYOUT),
            progress=partial(self.progress, "verification"),
        )


def _study(kind: str) -> str:
    """Return the name of the study of a treatment."""
    return f"gte-{kind}" if kind else "gte"
