"""`search`: the dither of an arm by Bayesian or evolutionary search, under constraints.

found = search("panda", objective="sje", out="runs/panda-search")
print(found)

    bounds -> SJE: a study per joint -> table
                      |  its frequencies are where the next begins
                      v
              GTE: one study of whole tables -> table
                      |
                      v
    final.csv -> measured anew: unseen seeds, frictions and paths, beside other tables -> report.md
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import optuna

from stiction_envs.control.compensation import KINDS, Compensation
from stiction_envs.errors import ExperimentError, StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Protocol
from stiction_envs.friction.parameters import QUANTITIES
from stiction_envs.friction.sticking import Friction, Robot, model_sha256
from stiction_envs.measured import AmplitudeRow, read_amplitudes, write_amplitudes
from stiction_envs.method_settings import Changes, override
from stiction_envs.reporting.output_folder import OutputFolder, default_folder
from stiction_envs.reporting.provenance import provenance
from stiction_envs.version import __version__
from tuning.explore.bounds import Bounds, bounds_of
from tuning.explore.breakaway import BreakawayObjective
from tuning.explore.frictions import frictions
from tuning.explore.options import Found, Options
from tuning.explore.report import write_search_report
from tuning.explore.tables import GRID, best_of_grid, grid_rows, other_tables
from tuning.explore.tracking import Place, Table, TrackingObjective, Treatment
from tuning.explore.trials import best, write_compensation, write_pareto, write_trials
from tuning.explore.verify import (
    Verified,
    measured_once,
    verify_breakaway,
    verify_tracking,
)
from tuning.record import Outcome, Parameters, Record, Search, run
from tuning.samplers import sampler
from tuning.settings import TuningSettings, tuning_settings
from tuning.tune import Tuning

TUNED = ("triangle",)
"""Paths on which a table is tuned; it is verified on the others too."""
STIFFNESSES = ((200.0, 20.0, 0.0), (400.0, 40.0, 0.0))
"""Thesis Table 4.11 [N/m, N·m/rad, N·m/rad]."""
Progress = Callable[[str, float, float], None]


def search(
    robot: Robot,
    *,
    options: Options | None = None,
    bounds: str | Path | None = None,
    limit: str | Path | None = None,
    beside: Sequence[str | Path] = (),
    out: str | Path | OutputFolder | None = None,
    force: bool = False,
    seed: int = 0,
    storage: str | None = None,
    study: str | None = None,
    friction: Friction | None = None,
    protocol: Protocol | None = None,
    nthread: int = 0,
    progress: Progress | None = None,
    settings: TuningSettings | Changes | None = None,
    **asked: Any,
) -> Tuning:
    """Search the dither of every joint, and measure what was found anew.

    Interrupted at any moment, the same call goes on where it was and ends with the same files.

    Args:
        robot: name, model file, arm, or an arm with its friction (`load_model`).
        options: what is asked for; or its fields as arguments (``objective="gte"``).
        bounds: TOML of `bounds.bounds_of`; None for what arm and settings allow.
        limit: amplitude table whose displacement (SJE) and vibration (GTE) may not be passed; None
            for thesis Table 4.9 on the Panda, and on other arms what ``make tune`` would choose.
        beside: more amplitude tables to compare with.
        out: output folder: trials.csv, final.csv, verification.csv, comparison.csv, report.md,
            plots, study.db. None for ``runs/search-ROBOT``.
        force: whether the files of another run in it are replaced.
        seed: of scatter, drawn frictions and samplers.
        storage: URL or journal file of the study; None for a SQLite file in ``out``.
        study: prefix of the studies' names; None for the arm's name.
        friction: of the arm, or its TOML; None for the robot's own.
        protocol: of the SJE; None for the robot's.
        nthread: threads, 0 for all processors.
        progress: called with (stage, done, total).
        settings: constants that differ from ``settings.toml``.
        asked: fields of `Options`.

    Raises:
        StictionError: bad input, or a folder or study of another run; nothing was written.
        ExperimentError: a joint that sticks; a search that found nothing it may use.
    """
    options = dataclasses.replace(options or Options(), **asked)
    s = override(tuning_settings(), settings)
    sje = SingleJointExperiment(
        robot, friction=friction, protocol=protocol, seed=seed, nthread=nthread
    )
    arm = sje.sticking.arm
    where = bounds_of(sje, bounds, s.bounds)
    if options.objective != "sje":
        _check_vibration(where, s)
    read: dict[str, Any] = {
        "n_joints": arm.n,
        "torque_limit": arm.limits.torque,
        "controller_rate_hz": sje.interface.controller_rate_hz,
    }
    tables = other_tables(
        sje,
        where,
        own={Path(p).stem: tuple(read_amplitudes(p, **read)) for p in beside},
        settings=s,
    )
    limits = tables.limits if limit is None else tuple(read_amplitudes(limit, **read))
    about = {
        "robot": arm.name,
        "protocol": "search",
        "version": __version__,
        "model": model_sha256(sje.sticking),
        "friction": {k: getattr(sje.sticking.parameters, k).tolist() for k in QUANTITIES},
        "sje": dataclasses.asdict(sje.protocol),
        "bounds": {k: _plain(v) for k, v in vars(where).items()},
        "limits": [dataclasses.astuple(r) for r in limits],
        "options": {**dataclasses.asdict(options), "evaluations": None},
        "settings": dataclasses.asdict(s),
        "seed": seed,
    }
    folder = out
    if not isinstance(folder, OutputFolder):
        files = {
            name: Path(p) for name, p in (("bounds", bounds), ("limit", limit)) if p is not None
        }
        folder = OutputFolder(
            default_folder("search", arm.name) if folder is None else Path(folder),
            provenance(
                "search",
                {**about, "options": dataclasses.asdict(options), "storage": storage},
                seed=seed,
                inputs=files,
            ),
            force=force,
            resumable=True,
        )
    try:
        with folder:
            url = storage or f"sqlite:///{(folder.path / 'study.db').resolve()}"
            job = SearchRun(
                sje,
                where,
                tables.others,
                limits,
                options,
                s,
                url,
                study or arm.name,
                about,
                progress,
            )
            return job.run(folder)
    except StictionError as error:
        if folder.resumed or folder.wrote:  # it had begun to work
            raise ExperimentError(str(error)) from error
        raise


class SearchRun:
    """The stages of one search; each of them finds what was done of it in the studies."""

    def __init__(
        self,
        sje: SingleJointExperiment,
        bounds: Bounds,
        others: Mapping[str, Table],
        limits: Table,
        options: Options,
        settings: TuningSettings,
        storage: str,
        study: str,
        about: Mapping[str, Any],
        progress: Progress | None,
    ) -> None:
        self.sje, self.bounds, self.others, self.limits = sje, bounds, dict(others), limits
        self.options, self.settings, self.search = options, settings, settings.search
        self.storage, self.study, self.about, self._progress = storage, study, about, progress
        self.seed = sje.seed
        self.frictions = frictions(
            sje.sticking.parameters, self.search.draws, spread=self.search.spread, seed=self.seed
        )
        self.records: dict[str, list[Record]] = {}
        self.tables: dict[str, Table] = {}
        """Tables of the stages that are over."""
        self.compensation: Compensation | None = None
        """What was found of it."""
        self.limit: dict[str, Any] = {}
        """Largest displacement (n,) [rad] of ``sje``, vibration (2,) [m] of ``gte``."""

    def run(self, folder: OutputFolder) -> Tuning:
        """Run all stages; write what they found."""
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
            write_amplitudes(folder.path / "final.csv", final)
        if self.compensation is not None:
            write_compensation(folder.path / "compensation.csv", self.compensation)
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
        )
        summary = write_search_report(found, folder.path, verified)
        return Tuning(
            summary=summary, final=final, folder=folder.path, provenance=folder.provenance
        )

    def record(self, name: str, objectives: int = 1) -> Record:
        """Open a study of this run."""
        return Record(
            self.storage,
            f"{self.study}-{name}",
            objectives=objectives,
            about={**self.about, "stage": name},
        )

    def _filled(self, stage: str, searches: list[Search], evaluate: Any) -> None:
        progress = self._progress
        run(
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
        return out

    def _simulated(self, stage: str) -> Callable[[float], None] | None:
        """Return what takes simulated seconds of a part whose length is not known."""
        progress, done = self._progress, 0.0

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

        progress = self._progress
        record = self.record("grid", 1 + self.options.pareto)
        self.records["grid"] = [record]
        known = measured_once(
            record,
            len(listed),
            evaluate,
            None if progress is None else lambda done, total: progress("grid", done, total),
        )
        return best_of_grid(self.sje.n, listed, known)

    def breakaway(self) -> Table:
        """Search every joint by itself; return the best setting of each."""
        s, options = self.search, self.options
        name = options.sampler_of("sje")
        objective = self.objective
        searches = []
        for j in range(1, self.sje.n + 1):
            space = self.bounds.space(j, options.free)
            population = s.population if name == "cmaes" or options.pareto else 1
            searches.append(
                Search(
                    record=self.record(f"sje-joint{j}", 1 + options.pareto),
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
        return GeneratedTrajectoryExperiment(self.sje.sticking, seed=seed, nthread=self.sje.nthread)

    def tracking(self, begin: Table | None) -> Table:
        """Search tables of the whole arm; return the best."""
        s, options = self.search, self.options
        name = options.sampler_of("gte")
        places: list[Place] = [(path, k) for path in TUNED for k in STIFFNESSES]
        objective = TrackingObjective(
            self.gte(self.seed),
            self.bounds,
            self.frictions,
            places,
            iterations=s.iterations,
            joints=() if options.without_dither else range(1, self.sje.n + 1),
            gates="" if options.gates == "none" else options.gates,
            compensation="" if options.compensation == "none" else options.compensation,
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
            record=self.record("gte", 1 + options.pareto),
            space=space,
            sampler=sampler(
                name,
                space,
                seed=self.seed,
                startup=2 * s.population,
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
                "larger --limit, or more --evaluations"
            )
        treatment = objective.treatment(chosen.params)
        self.compensation = treatment.compensation
        return treatment.dither

    # ---- what was found ----------------------------------------------------------------------

    def verify(self, tables: Mapping[str, Table]) -> Verified:
        """Measure tables anew, under frictions, seeds and paths that the search has not seen."""
        progress = self._progress

        def report(done: int, total: int) -> None:
            if progress is not None:
                progress("verification", done, total)

        unseen = frictions(
            self.sje.sticking.parameters,
            self.search.verify_draws,
            spread=self.search.spread,
            seed=self.seed + 7919,
        )
        arguments: dict[str, Any] = {
            "bounds": self.bounds,
            "frictions": unseen,
            "settings": self.search,
        }
        out = Verified(
            breakaway=verify_breakaway(
                self.sje.replace(seed=self.seed + 1),
                tables,
                record=self.record("verify-sje"),
                progress=report,
                **arguments,
            ),
            tracking={},
        )
        if self.options.objective != "sje":
            out = dataclasses.replace(
                out,
                tracking=verify_tracking(
                    self.gte,
                    self.treatments(tables),
                    seed=self.seed + 1,
                    record=self.record("verify-gte"),
                    progress=report,
                    **arguments,
                ),
            )
        return out

    def treatments(self, tables: Mapping[str, Table]) -> dict[str, Treatment]:
        """Return what is run on paths: tables, and compensation as it is and as it was found."""
        out = {name: Treatment(dither=table) for name, table in tables.items()}
        if self.compensation is not None:
            out["search gte"] = Treatment(
                dither=tables.get("search gte", ()), compensation=self.compensation
            )
        experiment = self.gte(self.seed)
        for kind in KINDS:
            out[f"{kind}, as believed"] = Treatment(compensation=experiment.compensation(kind))
        return out


def _check_vibration(bounds: Bounds, settings: TuningSettings) -> None:
    """Raise where a dither could slip under the filter of the vibration measure."""
    from stiction_envs.experiments.gte.protocol import load_gte_protocol

    edge = settings.bounds.vibration_edge * load_gte_protocol().vibration_low
    low = float(bounds.frequency_hz[:, 0].min())
    if low < edge:
        raise StictionError(
            f"frequency from {low:g} Hz: vibration is measured above {edge:g} Hz: expected "
            f"frequency_hz from {edge:g} Hz with objective gte"
        )


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value
