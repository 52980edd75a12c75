"""`tune`: from an arm and its base torques to a final amplitude table, by the thesis's protocol."""

import dataclasses
import shutil
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stiction_envs.control.sensing import SensingLike
from stiction_envs.dither.dither import check_frequency
from stiction_envs.errors import StictionError, checked_array
from stiction_envs.experiments.sje.calibrate import calibrate
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Protocol
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.friction.sticking import Friction, Robot, friction_origin
from stiction_envs.measured.tables import AmplitudeRow, BaseTable, read_base
from stiction_envs.method_settings import Changes, override
from stiction_envs.reporting.json_text import JsonRecord
from stiction_envs.reporting.markdown import aligned
from stiction_envs.reporting.provenance import Provenance
from stiction_envs.reporting.result import Result
from tuning.protocol.report import write_report
from tuning.protocol.stages import ThesisTuner, frequencies_of
from tuning.settings import TuningSettings, tuning_settings
from tuning.study.tuning_run import Progress, open_run


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Tuning(Result):
    """Result of a tuning; its files are in `folder`."""

    summary: JsonRecord  # JSON that ``stiction tune --json`` prints
    final: tuple[AmplitudeRow, ...]  # Dither of every joint, the rows of ``final.csv``
    folder: Path
    provenance: Provenance

    @property
    def robot(self) -> str:
        """Name of the arm."""
        return str(self.summary["robot"])

    def to_json(self) -> dict[str, object]:
        """Return final table, reductions, warnings and the path of the report."""
        return dict(self.summary)

    def write(self, folder: Path) -> None:
        """Copy tables, report and plots."""
        leave = shutil.ignore_patterns("provenance.json")
        shutil.copytree(self.folder, folder, ignore=leave, dirs_exist_ok=True)

    def __repr__(self) -> str:
        return f"<Tuning of {self.robot}: {len(self.final)} joints, in {self.folder}>"

    def __str__(self) -> str:
        lines: list[str] = []
        final = self.summary["final"]
        if gains := self.summary.get("compensation"):
            lines += [f"{gains['kind']}:", aligned(*gains_table(gains))]
        if final or not gains:
            header = ["joint", "frequency [Hz]", "amplitude [N·m]"]
            cells = [
                [f"{r['joint']}", f"{r['frequency_hz']:g}", f"{r['amplitude_nm']:.4f}"]
                for r in final
            ]
            if any("amplitude_rad" in r for r in final):
                header.append("of command [mrad]")
                for row, r in zip(cells, final, strict=True):
                    row.append(f"{1e3 * r['amplitude_rad']:.1f}")
            lines.append(aligned(header, cells))
            if (mean := self.summary["mean_reduction_percent"]) is not None:
                text = "torque to move a joint, mean over all configurations"
                lines.append(f"{text}: {-mean:+.1f} %")
        if best := self.summary.get("treatment"):
            words = f"recommended: {best['name']}, which leaves {best['left_percent']:.0f} %"
            lines.append(f"{words} of the error on paths that were not searched on")
        return "\n".join(lines)


def gains_table(gains: JsonRecord) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of a compensation's numbers, one row per joint."""
    columns = {name: x for name, x in gains.items() if name != "kind"}
    rows = enumerate(zip(*columns.values(), strict=True), 1)
    return ["joint", *columns], [[f"{j}", *(f"{x:.4g}" for x in row)] for j, row in rows]


def tune(
    robot: Robot,
    *,
    table: str | Path | BaseTable | None = None,
    out: str | Path | None = None,
    force: bool = False,
    frequencies: Sequence[float] | None = None,
    scales: Sequence[float] | None = None,
    iterations: int | None = None,
    scatter: bool = True,
    seed: int = 0,
    storage: str | None = None,
    study: str | None = None,
    friction: Friction | None = None,
    sensing: SensingLike = "ideal",
    drive: str | None = None,
    protocol: Protocol | None = None,
    threads: int = 0,
    progress: Progress | None = None,
    settings: TuningSettings | Changes | None = None,
) -> Tuning:
    """Find the dither of every joint by the thesis's protocol, and verify it.

    Measurements are written at once: after an interruption, the same call continues.

    Args:
        robot: name, model file, arm, or an arm with its friction (`load_model`).
        table: measured base torques, or their file; the friction is calibrated to them first.
            None tunes with the friction as it is.
        out: output folder: base.csv, frequency.csv, scale.csv, intermediate.csv, final.csv,
            final.yaml (the same for ROS 2), verification.csv, report.md, plots, friction.toml,
            optuna.db. None for ``runs/tune-ROBOT``.
        force: whether the files of another run in ``out`` are replaced.
        frequencies: frequencies to try [Hz]; None for the thesis's for that robot.
        scales: amplitude over base torque [-]; None for 0.8, 1.0, 1.2.
        iterations: per configuration; None for the protocol's.
        scatter: whether iterations differ.
        seed: seed of the scatter.
        storage: Optuna storage URL; None for a SQLite file in ``out``.
        study: prefix of the studies' names; None for the arm's name.
        friction: parameters to start from, or their TOML; None for the robot's own.
        sensing: what the controller sees: "ideal", "robot", a TOML, or `Sensing`.
        drive: "torque", or "position": servos, as in `SingleJointExperiment`; final_command.csv
            then has amplitudes of the commanded angle. None: position if the TOML has [servo].
        protocol: protocol of the experiment; None for the robot's.
        threads: threads, 0 for all processors.
        progress: called with (stage, simulated seconds done, total).
        settings: changes to ``settings.toml`` by name (``{"thesis.cap_half_widths": 2.5}``), a
            TOML file of changes, or all settings.

    Raises:
        StictionError: bad input, or an output folder of another run; nothing was written.
        ExperimentError: a joint that sticks, a calibration that does not converge.
    """
    experiment = SingleJointExperiment(
        robot,
        friction=friction,
        drive=drive,
        protocol=protocol,
        sensing=sensing,
        scatter=scatter,
        seed=seed,
        threads=threads,
    )
    if experiment.servos is not None and table is not None:
        raise StictionError("table of base torques: expected drive torque, not position servos")
    arm = experiment.sticking.arm
    chosen = override(tuning_settings(), settings)
    s = chosen.thesis
    tried = frequencies_of(arm.registered_name, s) if frequencies is None else tuple(frequencies)
    sizes = tuple(s.scales if scales is None else scales)
    for given in (tried, sizes):
        if not given or len(set(given)) < len(given):
            raise StictionError(
                "frequencies and scales must not repeat: expected at least one of each, once"
            )
    checked_array(sizes, "scale", above=0, high=s.most_scale)
    rate = experiment.interface.controller_rate_hz
    warned = [text for f in tried if (text := check_frequency(f, rate)) is not None]
    for text in warned:
        warnings.warn(text, stacklevel=2)
    inputs = {"robot": robot, "friction": friction, "sensing": sensing, "table": table}
    if isinstance(table, str | Path):
        # a user's own file of the arm may name it differently
        table = read_base(table, arm.registered_name, arm.n)
    if table is not None and table.n_joints != arm.n:
        raise StictionError(f"base table of {table.n_joints} joints, but {arm.name} has {arm.n}")
    run = open_run(
        "tune",
        "thesis",
        experiment,
        {
            "iterations": iterations,
            "frequencies": tried,
            "scales": sizes,
            "table": None if table is None else table.tau,
            "settings": dataclasses.asdict(s),
        },
        out=out,
        force=force,
        storage=storage,
        study=study,
        settings=chosen.shared,
        inputs=inputs,
        database="optuna.db",
    )
    if storage is not None:
        run.record("base")  # report errors of the storage before anything is written
    progress = progress or (lambda *_: None)
    with run.working() as path:
        if table is not None:
            origin = friction_origin(robot, friction)
            experiment = _calibrated(experiment, table, origin, path, progress)
        tuner = ThesisTuner(
            experiment=experiment,
            run=run,
            frequencies=tried,
            scales=sizes,
            iterations=iterations,
            progress=progress,
            settings=s,
        )
        return run_protocol(tuner, table, warned)


def run_protocol(tuner: ThesisTuner, table: BaseTable | None, warned: list[str]) -> Tuning:
    """Run the protocol and write its report; ``table`` has the measured base torques."""
    tuner.measure_base()
    tuner.measure_grid()
    choices = tuner.choose()
    verified = tuner.verify(choices)
    return Tuning(
        summary=write_report(tuner, choices, verified, table=table, warnings=warned),
        final=tuple(c.row for c in choices),
        folder=tuner.out,
        provenance=tuner.run.folder.provenance,
    )


def _calibrated(
    experiment: SingleJointExperiment,
    table: BaseTable,
    origin: Path | FrictionParameters,
    out: Path,
    progress: Progress,
) -> SingleJointExperiment:
    """Return the experiment with friction calibrated to the table; kept in friction.toml."""
    path = out / "friction.toml"
    if not path.exists():
        result = calibrate(table, experiment, progress=lambda k, _: progress("calibrate", k, 10))
        name, content = f"base torques of {table.robot}", repr(table.tau.tolist()).encode()
        result.write_toml(path, base=origin, table=name, content=content)
    arm, timestep = experiment.sticking.arm, experiment.sticking.timestep
    sticking = build(arm, load_friction(path, arm.n), timestep=timestep)
    return experiment.replace(sticking=sticking)
