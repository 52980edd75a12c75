"""`tune`: from an arm and its base torques to a final amplitude table, by the thesis's protocol."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import optuna

from stiction_envs.dither.aliasing import check_frequency
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.calibrate import calibrate, calibrated_toml
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import (
    Protocol,
)
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters, load_friction
from stiction_envs.measured import BaseTable
from stiction_envs.method_settings import Changes, override
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.robots import Arm
from stiction_envs.version import __version__
from tuning.labbook import LabBook
from tuning.report import write_report
from tuning.rules import frequencies_of
from tuning.settings import TuningSettings, tuning_settings
from tuning.thesis import Progress, ThesisTuner


def _fingerprint(
    experiment: SingleJointExperiment, iterations: int | None, extra: dict[str, Any]
) -> dict[str, Any]:
    p = experiment.sticking.parameters
    return {
        "version": __version__,
        "model": experiment.sticking.arm.xml,
        "friction": {k: getattr(p, k).tolist() for k in QUANTITIES},
        "protocol": dataclasses.asdict(experiment.protocol),
        "rate_hz": experiment.interface.controller_rate_hz,
        "lowpass_hz": experiment.interface.lowpass_hz,
        "scatter": experiment.scatter,
        "seed": experiment.seed,
        "iterations": iterations,
        **extra,
    }


def _check(
    frequencies: tuple[float, ...], scales: tuple[float, ...], most: float, rate_hz: float
) -> list[str]:
    """Return warnings about frequencies past half the controller's rate; raise on bad ones."""
    if not frequencies or not scales:
        raise StictionError("at least one frequency and one scale are needed")
    if len(set(frequencies)) != len(frequencies) or len(set(scales)) != len(scales):
        raise StictionError("frequencies and scales must not repeat")
    for scale in scales:
        if not (np.isfinite(scale) and 0 < scale <= most):
            raise StictionError(f"scale {scale}: expected above 0 up to {most:g}")
    return [w for f in frequencies if (w := check_frequency(f, rate_hz)) is not None]


def tune(
    arm: Arm,
    *,
    out: Path,
    table: BaseTable | None = None,
    frequencies: tuple[float, ...] | None = None,
    scales: tuple[float, ...] | None = None,
    iterations: int | None = None,
    scatter: bool = True,
    seed: int = 0,
    storage: str | None = None,
    study: str | None = None,
    sampler: str = "grid",
    friction: FrictionParameters | None = None,
    protocol: Protocol | None = None,
    nthread: int = 0,
    progress: Progress | None = None,
    settings: TuningSettings | Changes | None = None,
) -> dict[str, Any]:
    """Run the thesis's protocol; continue it if ``out`` holds a part of the same run.

    Args:
        arm: the arm.
        out: output folder: base.csv, frequency.csv, scale.csv, intermediate.csv, final.csv,
            verification.csv, report.md, plots, friction.toml, labbook.jsonl, optuna.db.
        table: measured base torques; the friction is calibrated to them first. None tunes with
            the friction as it is.
        frequencies: [Hz]; None for the thesis's of that robot.
        scales: amplitude over base torque [-]; None for 0.8, 1.0, 1.2.
        iterations: per configuration; None for the protocol's.
        scatter: whether iterations differ.
        seed: of the scatter.
        storage: Optuna storage URL; None for a SQLite file in ``out``.
        study: prefix of the studies' names; None for the arm's name.
        sampler: "grid": the protocol is a grid.
        friction: parameters to start from; None for the robot's.
        protocol: of the experiment; None for the robot's.
        nthread: threads, 0 for all processors.
        progress: called with (stage, simulated seconds done, total).
        settings: constants of the protocol that differ from ``settings.toml``: by name
            (``{"thesis.cap_half_widths": 2.5}``), a TOML file of them, or all.

    Returns:
        A summary: final table, mean reduction per joint, warnings, files.

    Raises:
        StictionError: bad input, or an output folder of another run.
        ExperimentError: a joint that sticks, a calibration that does not converge.
    """
    if sampler != "grid":
        raise StictionError(f"sampler {sampler!r} with protocol 'thesis': allowed is grid")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    experiment = SingleJointExperiment.of(
        arm, friction=friction, protocol=protocol, scatter=scatter, seed=seed, nthread=nthread
    )
    s = override(tuning_settings(), settings).thesis
    frequencies = frequencies_of(arm.name, s) if frequencies is None else frequencies
    scales = s.scales if scales is None else scales
    warnings = _check(frequencies, scales, s.most_scale, experiment.interface.controller_rate_hz)
    if table is not None and table.n_joints != arm.n:
        raise StictionError(f"base table of {table.n_joints} joints, but {arm.name} has {arm.n}")
    extra: dict[str, Any] = {
        "frequencies": frequencies,
        "scales": scales,
        "table": None if table is None else table.tau.tolist(),
    }
    book = LabBook(out / "labbook.jsonl", _fingerprint(experiment, iterations, extra))
    if table is not None:
        experiment = _calibrated(arm, experiment, table, out, progress)

    tuner = ThesisTuner(
        experiment,
        out,
        book,
        frequencies=frequencies,
        scales=scales,
        iterations=iterations,
        storage=storage,
        study=study or arm.name,
        progress=progress,
        settings=s,
    )
    tuner.run_base()
    tuner.prefetch()
    best = tuner.run_frequencies()
    choices = tuner.choose(best, tuner.run_scales(best))
    tuner.write_final(choices)
    verified = tuner.verify(choices)
    return write_report(tuner, choices, verified, table=table, warnings=warnings)


def _calibrated(
    arm: Arm,
    experiment: SingleJointExperiment,
    table: BaseTable,
    out: Path,
    progress: Progress | None,
) -> SingleJointExperiment:
    """Return the experiment with friction calibrated to the table; kept in friction.toml."""
    path = out / "friction.toml"
    if not path.exists():
        result = calibrate(
            table,
            experiment,
            progress=None if progress is None else lambda k, e: progress("calibrate", k, 10),
        )
        write_text_atomic(
            path,
            calibrated_toml(
                result,
                arm.name,
                f"base torques of {table.robot}",
                repr(table.tau.tolist()).encode(),
            ),
        )
    parameters = load_friction(path, arm.n)
    sticking = build(arm, parameters, timestep=experiment.sticking.timestep)
    return dataclasses.replace(experiment, sticking=sticking)
