"""`search`: the dither of an arm by Bayesian or evolutionary search, under constraints.

bounds -> SJE: a study per joint -> table
                  |  its frequencies are where the next begins
                  v
          GTE: one study of whole tables -> table
                  |
                  v
final.csv -> measured again, with other tables: unseen seeds, frictions, paths -> report.md
"""

import dataclasses
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from stiction_envs.control.sensing import SensingLike
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.protocol import load_gte_protocol
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Protocol
from stiction_envs.friction.sticking import Friction, Robot
from stiction_envs.measured.tables import read_amplitudes
from stiction_envs.method_settings import Changes, override
from tuning.protocol.tune import Tuning
from tuning.search.bounds import bounds_of, reference_tables
from tuning.search.report import write_search_report
from tuning.search.stages import Options, SearchStages
from tuning.settings import TuningSettings, tuning_settings
from tuning.study.tuning_run import Progress, open_run


def search(
    robot: Robot,
    *,
    objective: str | None = None,
    sampler: str | None = None,
    pareto: bool = False,
    treatment: str | None = None,
    evaluations: int | None = None,
    bounds: str | Path | None = None,
    limit: str | Path | None = None,
    beside: Sequence[str | Path] = (),
    out: str | Path | None = None,
    force: bool = False,
    seed: int = 0,
    storage: str | None = None,
    study: str | None = None,
    friction: Friction | None = None,
    sensing: SensingLike = "ideal",
    protocol: Protocol | None = None,
    threads: int = 0,
    progress: Progress | None = None,
    settings: TuningSettings | Changes | None = None,
) -> Tuning:
    """Search the dither of every joint, and measure the result again.

    After an interruption, the same call continues and ends with the same files.

    Args:
        robot: name, model file, arm, or an arm with its friction (`load_model`).
        objective: "sje": breakaway torque of each joint; "gte": error left at the goals of a path;
            "both": gte starts from the table of sje. None: "gte" for a treatment.
        sampler: one of `names.SAMPLERS`; None: gp for the SJE, cmaes for the GTE.
        pareto: whether shaking is a second objective instead of a constraint.
        treatment: one of `names.TREATMENTS`: each is searched alone with the same budget and
            under the same limits on vibration and torque rate, and the best on other paths that
            does not shake at rest is recommended.
        evaluations: trials per joint (SJE) and of whole tables (GTE); None for the settings'.
        bounds: TOML of `bounds.bounds_of`; None for the bounds of arm and settings.
        limit: amplitude table whose displacement (SJE) and vibration (GTE) are the limit; None
            for thesis Table 4.9 on the Panda, and on other arms the table of ``make tune``.
        beside: more amplitude tables to compare with.
        out: output folder: trials.csv, final.csv (dither, or else gains), final.yaml (both, for
            ROS 2), compensation.csv, a folder for each of several treatments, verification.csv,
            comparison.csv, report.md, plots, study.db. None for ``runs/search-ROBOT``.
        seed: seed of scatter, drawn frictions and samplers.
        progress: called with (stage, done, total).

    All other arguments are those of `tune`.

    Raises:
        StictionError: bad input, or a folder or study of another run; nothing was written.
        ExperimentError: a joint that sticks; a search that found nothing it may use.
    """
    options = Options(
        objective=objective or ("sje" if treatment is None else "gte"),
        sampler=sampler,
        pareto=pareto,
        treatment=treatment,
        evaluations=evaluations,
    )
    s = override(tuning_settings(), settings)
    sje = SingleJointExperiment(
        robot,
        friction=friction,
        drive="torque",
        protocol=protocol,
        sensing=sensing,
        seed=seed,
        threads=threads,
    )
    arm = sje.sticking.arm
    where = bounds_of(sje, bounds, s.bounds)
    if options.objective != "sje":
        # below the edge, the filter of the vibration measure could hide a dither
        edge = s.bounds.vibration_edge * load_gte_protocol().vibration_low
        low = float(where.frequency_hz[:, 0].min())
        if low < edge:
            raise StictionError(
                f"frequency from {low:g} Hz: vibration is measured above {edge:g} Hz: expected "
                f"frequency_hz from {edge:g} Hz with objective gte"
            )
    read = partial(
        read_amplitudes,
        n_joints=arm.n,
        torque_limit=arm.limits.torque,
        controller_rate_hz=sje.interface.controller_rate_hz,
    )
    tables = reference_tables(sje, where, s)
    limits = next(iter(tables.values())) if limit is None else tuple(read(limit))
    tables |= {Path(p).stem: tuple(read(p)) for p in beside}
    run = open_run(
        "search",
        "search",
        sje,
        {
            "bounds": vars(where),
            "limits": [dataclasses.astuple(r) for r in limits],
            "options": {**dataclasses.asdict(options), "evaluations": None},
            "settings": {
                name: dataclasses.asdict(getattr(s, name))
                for name in ("thesis", "bounds", "search")
            },
        },
        out=out,
        force=force,
        storage=storage,
        study=study,
        settings=s.shared,
        inputs={
            **{"robot": robot, "friction": friction, "sensing": sensing},
            **{"bounds": bounds, "limit": limit},
            **{f"beside {k}": path for k, path in enumerate(beside)},
        },
        evaluations=evaluations,
    )
    stages = SearchStages(
        run=run,
        sje=sje,
        bounds=where,
        others=tables,
        limits=limits,
        options=options,
        settings=s,
        progress=progress or (lambda *_: None),
    )
    if storage is not None:
        stages.reach()
    with run.working() as path:
        verified = stages.find()
        summary = write_search_report(stages, path, verified)
    return Tuning(
        summary=summary, final=stages.final, folder=path, provenance=run.folder.provenance
    )
