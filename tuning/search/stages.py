"""Stages of a search: each joint in the SJE, whole tables in the GTE, the final measurement."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
import optuna

from stiction_envs.control.compensation import KINDS, Compensation
from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import TRAJECTORIES
from stiction_envs.experiments.gte.rows import thesis_stiffness
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.assumed import friction_note
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.measured import AmplitudeRow, write_amplitudes, write_final
from stiction_envs.reporting.output_folder import OutputFolder
from tuning.protocol.tune import Tuning
from tuning.search.bounds import Bounds
from tuning.search.breakaway import BreakawayObjective
from tuning.search.frictions import frictions
from tuning.search.options import Found, Options
from tuning.search.reference_tables import GRID, best_of_grid, grid_rows
from tuning.search.report import write_search_report
from tuning.search.tracking import Place, Table, TrackingObjective, Treatment
from tuning.search.trials import best, score, write_compensation, write_pareto, write_trials
from tuning.search.verify import (
    Verified,
    another_start,
    measured_once,
    verify_breakaway,
    verify_tracking,
)
from tuning.settings import SearchSettings, TuningSettings
from tuning.study.record import Outcome, Parameters, Record, Search
from tuning.study.samplers import installed, sampler
from tuning.study.workers import fill

Progress = Callable[[str, float, float], None]
TUNED = TRAJECTORIES[:1]
"""Paths on which a table is tuned; it is verified on others too."""
UNSEEN = 7919
"""Separates the draws of the verification from those of the search, whose seeds are small."""


@dataclasses.dataclass(kw_only=True, eq=False)
class Stages:
    """The stages of one search; each of them finds its earlier results in the studies."""

    sje: SingleJointExperiment
    bounds: Bounds
    others: dict[str, Table]
    """Tables to compare with, by name."""
    limits: Table
    """Table whose displacement and vibration may not be exceeded."""
    options: Options
    settings: TuningSettings
    storage: str
    study: str
    """Prefix of the studies' names."""
    about: Mapping[str, Any]
    """Definition of the search."""
    progress: Progress | None
    records: dict[str, list[Record]] = dataclasses.field(default_factory=dict)
    tables: dict[str, Table] = dataclasses.field(default_factory=dict)
    """Tables of the finished stages."""
    compensation: Compensation | None = None
    """Compensation that was found."""
    limit: dict[str, Any] = dataclasses.field(default_factory=dict)
    """Largest displacement (n,) [rad] of ``sje``, vibration (2,) [m] of ``gte``."""

    @property
    def search(self) -> SearchSettings:
        """Settings of the search."""
        return self.settings.search

    @property
    def seed(self) -> int:
        """Seed of scatter, drawn frictions and samplers."""
        return self.sje.seed

    @cached_property
    def frictions(self) -> list[FrictionParameters]:
        """Frictions under which a setting is tried."""
        s = self.search
        return frictions(self.sje.sticking.parameters, s.draws, spread=s.spread, seed=self.seed)

    def run(self, folder: OutputFolder) -> Tuning:
        """Run all stages and write their results."""
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        tables = self.tables
        if self.options.objective in ("sje", "both"):
            tables["search sje"] = self.breakaway()
        if self.options.objective in ("gte", "both"):
            tables["search gte"] = self.tracking(tables.get("search sje"))
        final = list(tables.values())[-1]
        searched = dict(self.records)
        write_trials(folder.path / "trials.csv", searched)
        if self.options.pareto:
            write_pareto(folder.path / "pareto.csv", searched)
        if final:
            write_final(folder.path, final, self.sje.sticking.arm.joint_names)
        if len(tables) > 1:
            write_amplitudes(folder.path / "sje_table.csv", tables["search sje"])
        if self.compensation is not None:
            write_compensation(folder.path / "compensation.csv", self.compensation)
        if "search sje" in tables:
            self.others[GRID] = self.grid()
        verified = self.verify({**tables, **self.others})
        found = Found(
            robot=self.sje.sticking.arm.name,
            options=self.options,
            bounds=self.bounds,
            settings=self.search,
            records=self.records,
            tables=tables,
            others=self.others,
            limit=self.limit,
            compensation=self.compensation,
            note=friction_note(self.sje.sticking.arm, self.sje.sticking.parameters),
        )
        summary = write_search_report(found, folder.path, verified)
        return Tuning(
            summary=summary, final=final, folder=folder.path, provenance=folder.provenance
        )

    def record(self, name: str, objectives: int = 1, sampler: str | None = None) -> Record:
        """Open a study of this run; one that another sampler started is refused."""
        about = {**self.about, "stage": name}
        if sampler is not None:
            about["sampler"] = installed(sampler)
        return Record(
            self.storage,
            f"{self.study}-{name}",
            objectives=objectives,
            about=about,
            settings=self.settings.shared,
        )

    def reach(self) -> None:
        """Open the first study before anything is simulated or written: it may be unavailable.

        Raises:
            StictionError: a storage that cannot be opened, or a study of something else.
        """
        stage = "gte" if self.options.objective == "gte" else "sje"
        first = {"gte": "gte", "sje": "sje-joint1"}[stage]
        self.record(first, self.options.objectives, self.options.sampler_of(stage))

    def _filled(self, stage: str, searches: list[Search], evaluate: Any) -> None:
        progress = self.progress
        fill(
            searches,
            evaluate,
            None if progress is None else lambda done, total: progress(stage, done, total),
        )
        self.records[stage] = [s.record for s in searches]

    # ---- the SJE -----------------------------------------------------------------------------

    @cached_property
    def objective(self) -> BreakawayObjective:
        """The SJE of this search, its base torques measured."""
        out = BreakawayObjective(
            self.sje,
            self.bounds,
            self.frictions,
            iterations=self.search.iterations,
            limits=self.limits,
            pareto=self.options.pareto,
            progress=self._simulated("base torques"),
        )
        self.limit["sje"] = out.displacement
        out.progress = None  # from here on trials are counted
        return out

    def _simulated(self, stage: str) -> Callable[[float], None] | None:
        """Return a progress function for the simulated seconds of a part of unknown length."""
        progress, done = self.progress, 0.0

        def report(seconds: float) -> None:
            nonlocal done
            done += seconds
            if progress is not None:
                progress(stage, done, max(done, 1.0))

        return None if progress is None else report

    def grid(self) -> Table:
        """Return the best allowed setting of every joint on the thesis's grid."""
        rows = grid_rows(self.sje, self.bounds, self.settings)
        listed = list(rows)

        def evaluate(asked: list[tuple[int, Parameters]]) -> list[Outcome]:
            wanted = [listed[p["row"]] for _, p in asked]
            found = self.objective.measure(wanted)
            return [self.objective.outcome(r, found[r], -np.inf) for r in wanted]

        progress = self.progress
        record = self.record("grid", self.options.objectives)
        self.records["grid"] = [record]
        known = measured_once(
            record,
            len(listed),
            evaluate,
            None if progress is None else lambda done, total: progress("grid", done, total),
        )
        return best_of_grid(self.sje.n, listed, known)

    def breakaway(self) -> Table:
        """Search every joint separately; return the best setting of each."""
        s, options = self.search, self.options
        name = options.sampler_of("sje")
        objective = self.objective
        searches = []
        for j in range(1, self.sje.n + 1):
            space = self.bounds.space(j, options.free)
            population = s.population if name == "cmaes" or options.pareto else 1
            searches.append(
                Search(
                    record=self.record(f"sje-joint{j}", options.objectives, name),
                    space=space,
                    sampler=sampler(
                        name,
                        space,
                        seed=self.seed * 1000 + j,
                        startup=s.startup,
                        population=population,
                        points=s.points,
                        step=s.step,
                    ),
                    evaluations=options.evaluations
                    or (s.points ** len(space) if name == "grid" else s.evaluations_sje),
                    batch=s.points ** len(space) if name == "grid" else population,
                )
            )
        self._filled("sje", searches, objective.evaluate)
        rows = []
        for j, one in enumerate(searches, 1):
            chosen = best(one.record.trials)
            if chosen is None or chosen.values[0] >= 1.0:
                rows.append(AmplitudeRow(j, 0.0, 0.0))
            else:
                rows.append(self.bounds.setting(j, chosen.params))
        return tuple(rows)

    # ---- the GTE -----------------------------------------------------------------------------

    def gte(self, seed: int) -> GeneratedTrajectoryExperiment:
        """Return the experiment of this arm."""
        return GeneratedTrajectoryExperiment(self.sje.sticking, seed=seed, threads=self.sje.threads)

    def tracking(self, begin: Table | None) -> Table:
        """Search tables of the whole arm; return the best."""
        s, options = self.search, self.options
        name = options.sampler_of("gte")
        places: list[Place] = [(path, k) for path in TUNED for k in thesis_stiffness()]
        objective = TrackingObjective(
            self.gte(self.seed),
            self.bounds,
            self.frictions,
            places,
            iterations=s.iterations,
            joints=() if options.without_dither else range(1, self.sje.n + 1),
            free=options.free,
            gates=options.gates,
            compensation=options.compensation,
            limits=self.limits,
            penalty=s.penalty if name == "cmaes" else 0.0,
            pareto=options.pareto,
        )
        self.limit["gte"] = objective.vibration
        space = objective.space()
        gentle = tuple(
            dataclasses.replace(r, amplitude_nm=s.gentle * r.amplitude_nm) for r in begin or ()
        )
        first = objective.parameters(gentle or self.limits)
        population = s.population if name in ("cmaes", "nsga2") else 1
        one = Search(
            record=self.record("gte", options.objectives, name),
            space=space,
            sampler=sampler(
                name,
                space,
                seed=self.seed,
                startup=s.population,
                population=population,
                points=s.points,
                first=first,
                step=s.step,
            ),
            evaluations=options.evaluations or s.evaluations_gte,
            batch=population,
            first=(first,),
        )
        self._filled("gte", [one], objective.evaluate)
        chosen = best(one.record.trials)
        if chosen is None:
            raise ExperimentError(
                f"none of {one.evaluations} tables keeps the limits on vibration: expected a "
                "larger limit, or more evaluations"
            )
        if score(chosen) >= 0.0:  # no more than no dither achieves
            return tuple(AmplitudeRow(j, 0.0, 0.0) for j in objective.joints)
        treatment = objective.treatment(chosen.params)
        self.compensation = treatment.compensation
        return treatment.dither

    # ---- what was found ----------------------------------------------------------------------

    def verify(self, tables: Mapping[str, Table]) -> Verified:
        """Measure tables again, under frictions, seeds and paths that the search has not seen."""
        progress = self.progress

        def report(done: int, total: int) -> None:
            if progress is not None:
                progress("verification", done, total)

        unseen = frictions(
            self.sje.sticking.parameters,
            self.search.verify_draws,
            spread=self.search.spread,
            seed=self.seed + UNSEEN,
        )
        arguments: dict[str, Any] = {
            "bounds": self.bounds,
            "frictions": unseen,
            "settings": self.search,
        }
        out = Verified(
            breakaway=verify_breakaway(
                self.sje.replace(seed=self.seed + 1),
                # a ramp takes long: if only paths were searched, the table found is enough
                tables if "search sje" in tables else self.tables,
                record=self.record,
                progress=report,
                **arguments,
            ),
            tracking={},
        )
        if self.options.objective != "sje":
            out = dataclasses.replace(
                out,
                tracking=verify_tracking(
                    self.unseen_experiment(),
                    self.treatments(tables),
                    record=self.record,
                    progress=report,
                    **arguments,
                ),
            )
        return out

    def unseen_experiment(self) -> GeneratedTrajectoryExperiment:
        """Return the GTE with another seed and another start."""
        start = another_start(self.sje.sticking.arm, self.search.verify_start, [self.seed, UNSEEN])
        return GeneratedTrajectoryExperiment(
            self.sje.sticking, seed=self.seed + 1, start=start, threads=self.sje.threads
        )

    def treatments(self, tables: Mapping[str, Table]) -> dict[str, Treatment]:
        """Return the treatments to run on paths: tables, and compensation as it is and as found."""
        out = {name: Treatment(dither=table) for name, table in tables.items()}
        if self.compensation is not None:
            out["search gte"] = Treatment(
                dither=tables.get("search gte", ()), compensation=self.compensation
            )
        experiment = self.gte(self.seed)
        for kind in KINDS:
            out[f"{kind}, as believed"] = Treatment(compensation=experiment.compensation(kind))
        return out
