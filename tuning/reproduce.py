"""The thesis simulated beside measured, and why the two differ: what ``stiction reproduce`` runs.

reproduce(["tables"], "runs/tables")

Each target has a folder of its own; all tables and figures in one folder: `tuning.whole`.
Light to import: the command line reads names and helps of `TARGETS` from here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction_envs.errors import unknown

if TYPE_CHECKING:
    from stiction_envs.experiments.sje.protocol import Job, Measurement
    from stiction_envs.reporting.output_folder import OutputFolder

SEEDS = 5
"""Seeds of the optimiser: a parameter that some do not find again is not identified."""
PHASE_SECONDS = 1000.0
"""Simulated time of the iiwa's phases, roughly [s]: 64 ramps of about 15 s."""
SIMULATED = "s simulated"
Tell = Callable[[str, float, float, str], None]
"""Progress: stage, done, total, unit."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """How targets are run."""

    seed: int = 0
    seeds: int = SEEDS
    """Of the optimiser, from ``seed`` on."""
    iterations: int | None = None
    """Repeats; None for the protocol's."""
    scatter: bool = True
    nthread: int = 0
    tell: Tell = lambda *_: None


@dataclass(frozen=True)
class Target:
    """One thing that can be reproduced."""

    run: Callable[[Request, Path], dict[str, Any]]
    help: str
    tables: tuple[str, ...]
    """The thesis's tables that it depends on."""


def reproduce(
    targets: Sequence[str], out: str | Path | OutputFolder, request: Request | None = None
) -> dict[str, Any]:
    """Run targets, each into a folder of its name; an interrupted call goes on.

    Args:
        targets: of `TARGETS`; none for all.
        out: the folder.
        request: how; None for the defaults.

    Returns:
        A summary by target.

    Raises:
        StictionError: no such target, or an output folder of another run.
    """
    from stiction_envs.reporting.output_folder import OutputFolder
    from stiction_envs.reporting.provenance import provenance

    request = Request() if request is None else request
    chosen = in_order(targets)
    if not isinstance(out, OutputFolder):
        made = {
            "targets": chosen,
            "seeds": request.seeds,
            "iterations": request.iterations,
            "no_scatter": not request.scatter,
        }
        found = provenance("reproduce", made, seed=request.seed, inputs=inputs_of(chosen))
        out = OutputFolder(Path(out), found, resumable=True)
    if "gap" in chosen:
        from stiction_envs.thesis.fit import optimiser

        optimiser()  # before anything is written
    results: dict[str, Any] = {}
    with out:
        for name in chosen:
            (out.path / name).mkdir(exist_ok=True)
            results[name] = TARGETS[name].run(request, out.path / name)
    return results


def in_order(targets: Sequence[str]) -> list[str]:
    """Return targets in our order, each once, all for none: the same run, however asked for.

    Raises:
        StictionError: no such target.
    """
    for name in targets:
        if name not in TARGETS:
            raise unknown("target", name, TARGETS)
    return [t for t in TARGETS if t in targets] or list(TARGETS)


def inputs_of(targets: Sequence[str]) -> dict[str, Path]:
    """Return the files targets depend on: arms, their friction, settings, measured tables."""
    from stiction_envs.friction.parameters import friction_path
    from stiction_envs.measured import thesis_robots
    from stiction_envs.reporting.provenance import package_folder
    from stiction_envs.robots.files import robot_files

    package = package_folder()
    found: dict[str, Path] = {}
    for robot in thesis_robots():
        files = robot_files(robot)
        found[robot], found[f"{robot}_table"] = files["robot"], files["robot_table"]
        found[f"{robot}_friction"] = friction_path(robot)
    found["protocol"] = package / "experiments" / "sje" / "sje.toml"
    if "gte" in targets:
        found["gte_protocol"] = package / "experiments" / "gte" / "gte.toml"
        found["controller"] = package / "control" / "gte.toml"
        found["ensemble"] = package / "thesis" / "ensemble.toml"
    if "gap" in targets:
        found["dither_fit"] = package / "thesis" / "dither_fit.toml"
    for number in [n for t in targets for n in TARGETS[t].tables]:
        name = f"table_{number.replace('.', '_')}"
        found[name] = package / "measured" / "thesis" / f"{name}.csv"
    return found


# ---- targets -------------------------------------------------------------------------------------


def _gap(request: Request, folder: Path) -> dict[str, Any]:
    """Fit the nested models, or go on with them; write their page."""
    from stiction_envs.reporting.atomic import write_text_atomic
    from stiction_envs.reporting.html import to_html
    from stiction_envs.thesis.nested_models import NestedModels
    from stiction_envs.thesis.nyquist_phase import study_phase
    from stiction_envs.thesis.page import write_page

    seeds = range(request.seed, request.seed + request.seeds)
    nested = NestedModels(folder, seeds=seeds, processes=request.nthread)
    for _ in nested.fit(lambda stage, k, n: request.tell(stage, k, n, "steps")):
        pass
    done = 0.0

    def simulated(seconds: float) -> None:
        nonlocal done
        done += seconds
        request.tell("iiwa's phase", done, PHASE_SECONDS, SIMULATED)

    study = study_phase(nthread=request.nthread, progress=simulated)
    found = write_page(
        folder,
        nested.models,
        study=study,
        progress=lambda stage, k, n: request.tell(stage, k, n, "figures"),
    )
    text = (folder / "gap.md").read_text(encoding="utf-8")
    page = to_html(text.splitlines(), folder, "The thesis's dithered torques, model by model")
    write_text_atomic(folder / "report.html", page)
    return found


def _simulated_tables(request: Request, folder: Path) -> dict[str, Any]:
    """Simulate Tables 4.3 and 4.5 to 4.10 with the shipped friction."""
    from dataclasses import asdict

    from stiction_envs.experiments.sje.experiment import SingleJointExperiment
    from stiction_envs.robots import load_arm
    from stiction_envs.thesis.tables import TUNED, reproduce
    from stiction_envs.thesis.tables_page import write_tables
    from stiction_envs.version import __version__
    from tuning.labbook import LabBook
    from tuning.rules import final_amplitude

    def measure(robot: str, jobs: list[Job]) -> dict[Job, Measurement]:
        experiment = SingleJointExperiment(
            robot, scatter=request.scatter, seed=request.seed, nthread=request.nthread
        )
        # the folder's provenance has told this run from others already
        book = LabBook(folder / f"{robot}.jsonl", {"robot": robot, "version": __version__})
        missing = [j for j in jobs if book.get("tables", j) is None]
        total = experiment.expected_seconds(missing, request.iterations)
        done = 0.0

        def simulated(seconds: float) -> None:
            nonlocal done
            done += seconds
            request.tell(robot, done, total, SIMULATED)

        return book.measure(
            "tables", experiment, jobs, iterations=request.iterations, progress=simulated
        )

    rates = load_arm(TUNED).limits.torque_rate
    found = reproduce(measure, rule=final_amplitude, torque_rate=rates)
    scores = write_tables(
        folder, found, progress=lambda stage, k, n: request.tell(stage, k, n, "figures")
    )
    stuck = [r for r in found.rows if r.simulated_nm != r.simulated_nm]
    return {
        "tables": scores,
        "chosen": [asdict(c) for c in found.chosen],
        "stuck": [
            f"{r.robot} table {r.table} joint {r.joint} {r.load} ({r.direction}) at "
            f"{r.frequency_hz:g} Hz"
            for r in stuck
        ],
    }


def _simulated_gte(request: Request, folder: Path) -> dict[str, Any]:
    """Simulate Table 4.11 and the figures of the Generated Trajectory Experiment."""
    from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
    from stiction_envs.thesis.ensemble import run_ensemble, shipped_lag
    from stiction_envs.thesis.ensemble_page import write_ensemble
    from stiction_envs.thesis.ensemble_settings import ensemble_settings
    from stiction_envs.thesis.gte import ROBOT, run_thesis_cases, thesis_cases, write_gte

    bench = GeneratedTrajectoryExperiment(
        ROBOT, scatter=request.scatter, seed=request.seed, nthread=request.nthread
    )
    total = bench.expected_seconds(thesis_cases(), request.iterations)
    done = 0.0

    def simulated(seconds: float) -> None:
        nonlocal done
        done += seconds
        request.tell("gte", done, total, SIMULATED)

    pairs = run_thesis_cases(bench, iterations=request.iterations, progress=simulated)
    settings = ensemble_settings()
    how: dict[str, Any] = {"scatter": request.scatter, "seed": request.seed}
    members = run_ensemble(
        folder / "ensemble.jsonl",
        settings=settings,
        nthread=request.nthread,
        progress=lambda k, n: request.tell("ensemble", k, n, "set-ups"),
        **how,
    )
    lag = shipped_lag(settings, nthread=request.nthread, **how)
    section, found = write_ensemble(folder, members, lag, settings.run)
    scores = write_gte(
        folder,
        pairs,
        ensemble=section,
        progress=lambda stage, k, n: request.tell(stage, k, n, "figures"),
    )
    return {**scores, "ensemble": found, "shipped_lag": lag}


TARGETS: dict[str, Target] = {
    "gap": Target(
        _gap,
        "one physical statement after the other, fitted to Tables 4.3 and 4.6 and scored on the "
        "others, with a page that names each joint's causes",
        ("4.3", "4.5", "4.6", "4.7", "4.8", "4.9", "4.10"),
    ),
    "tables": Target(
        _simulated_tables,
        "Tables 4.3 and 4.5-4.10 and Appendices B-D with the shipped friction",
        ("4.3", "4.5", "4.6", "4.7", "4.8", "4.9", "4.10"),
    ),
    "gte": Target(
        _simulated_gte,
        "Table 4.11 and Figures 4.6-4.8, E.1, F.1 and F.2 with the shipped friction, and an "
        "ensemble of what the thesis does not print",
        ("4.9", "4.11"),
    ),
}
"""By name."""
