"""Tuning beside a real robot: ask for settings, tell what was measured, over weeks.

    ask("panda", 2, out="runs/robot")       # runs/robot/ask.csv, measure.csv to fill in
    tell("panda", "measured.csv", out="runs/robot")

Both write report.md, belief.png, final.csv and final.yaml. All that lasts is in the study.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import optuna

from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Protocol
from stiction_envs.friction.parameters import QUANTITIES
from stiction_envs.friction.sticking import Friction, Robot, model_sha256
from stiction_envs.measured import AmplitudeRow, read_amplitudes
from stiction_envs.method_settings import Changes, override
from stiction_envs.reporting.output_folder import OutputFolder, default_folder
from stiction_envs.reporting.provenance import provenance, sha256
from stiction_envs.version import __version__
from tuning.explore.bounds import bounds_of
from tuning.explore.breakaway import BreakawayObjective
from tuning.explore.tables import other_tables
from tuning.record import Record
from tuning.robot.candidates import CONFIGURATIONS, Candidates
from tuning.robot.memory import (
    Predicted,
    add_told,
    keep_predictions,
    predictions,
)
from tuning.robot.page import State, state_of, write_state
from tuning.robot.prediction import job, measure, predict, shaken
from tuning.robot.told import Told, check_told, read_told
from tuning.settings import TuningSettings, tuning_settings

Array = np.ndarray[Any, np.dtype[np.float64]]
Progress = Callable[[str, float, float], None]
STUDY = "study.db"


def ask(robot: Robot, count: int = 1, **options: Any) -> State:
    """Write the settings to measure next: ask.csv, and measure.csv to fill in and tell.

    The first call simulates all candidates, minutes; later ones find them in the study.

    Args:
        robot: name, model file, arm, or an arm with its friction (`load_model`).
        count: settings per joint that is not done yet.
        options: of `Session`.

    Raises:
        StictionError: bad input, or a folder or study of another robot; nothing was written.
    """
    if count < 1:
        raise StictionError(f"settings to ask for: {count}: expected 1 or more")
    session = Session(robot, **options)
    session.reach()
    with session.folder:
        record, predicted = session.open()
        state = state_of(session.experiment, record, predicted, session.settings.robot, count)
        write_state(session.folder.path, state, asked=True)
    return state


def tell(robot: Robot, table: str | Path, **options: Any) -> State:
    """Add measured torques to the study, and write what is believed now.

    Args:
        robot: as of `ask`.
        table: `told.read_told`; settings that were not asked for count too, within the bounds.
        options: of `Session`.

    Raises:
        StictionError: a table that cannot be this robot's, or as of `ask`; nothing was changed.
    """
    session = Session(robot, **options)
    path, experiment = Path(table), session.experiment
    rows = read_told(path, experiment.sticking.arm.name, experiment.n)
    rough = {
        (c.joint, c.load, c.direction): experiment.expected(j)
        for j in experiment.jobs()
        for c in (j.configuration,)
    }
    check_told(rows, session.bounds, rough, session.settings.robot)
    session.reach()
    with session.folder:
        record, predicted = session.open()
        predicted = session.with_told(record, predicted, rows)
        most = float(max(session.bounds.frequency_hz.max(), session.bounds.amplitude_nm.max()))
        new = add_told(record, rows, sha256(path), most, experiment.n)
        state = state_of(experiment, record, predicted, session.settings.robot, 1)
        state = dataclasses.replace(state, told=new)
        write_state(session.folder.path, state, asked=False)
    return state


class Session:
    """One robot, one study, one folder."""

    def __init__(
        self,
        robot: Robot,
        *,
        bounds: str | Path | None = None,
        limit: str | Path | None = None,
        out: str | Path | None = None,
        force: bool = False,
        seed: int = 0,
        storage: str | None = None,
        study: str | None = None,
        friction: Friction | None = None,
        protocol: Protocol | None = None,
        nthread: int = 0,
        progress: Progress | None = None,
        settings: TuningSettings | Changes | None = None,
    ) -> None:
        """Check everything; nothing is written yet.

        Args:
            robot: name, model file, arm, or an arm with its friction (`load_model`).
            bounds: TOML of `bounds.bounds_of`; None for what arm and settings allow.
            limit: amplitude table whose displacement may not be passed; None for thesis Table 4.9
                on the Panda, on other arms for what `explore.tables` has.
            out: output folder; None for ``runs/ask-ROBOT``.
            force: whether the files of *another* run in it are replaced; a session's own stay.
            seed: of the simulations.
            storage: URL or journal file of the study; None for a SQLite file in ``out``.
            study: its name; None for ``ROBOT-robot``.
            friction: of the arm, or its TOML; None for the robot's own.
            protocol: of the simulated SJE; None for the robot's.
            nthread: threads, 0 for all processors.
            progress: called with (stage, done, total).
            settings: constants that differ from ``settings.toml``.

        Raises:
            StictionError: bad input, or a folder of another run.
        """
        self.settings = override(tuning_settings(), settings)
        self.experiment = SingleJointExperiment(
            robot, friction=friction, protocol=protocol, seed=seed, nthread=nthread
        )
        e, arm = self.experiment, self.experiment.sticking.arm
        self.bounds = bounds_of(e, bounds, self.settings.bounds)
        self.limits: tuple[AmplitudeRow, ...]
        if limit is None:
            self.limits = other_tables(e, self.bounds, own={}, settings=self.settings).limits
        else:
            read = read_amplitudes(limit, n_joints=arm.n, torque_limit=arm.limits.torque)
            self.limits = tuple(read)
        self.about = {
            "robot": arm.name,
            "protocol": "search --ask",
            "version": __version__,
            "model": model_sha256(e.sticking),
            "sje": dataclasses.asdict(e.protocol),
            "friction": {k: getattr(e.sticking.parameters, k).tolist() for k in QUANTITIES},
            "bounds": {k: _plain(v) for k, v in vars(self.bounds).items()},
            "limits": [dataclasses.astuple(r) for r in self.limits],
            "seed": seed,
        }
        path = default_folder("ask", arm.name) if out is None else Path(out)
        self.folder = _folder(path, self._provenance(bounds, limit, storage, seed), force)
        self._outside = storage is not None
        self._storage = storage or f"sqlite:///{(path / STUDY).resolve()}"
        self._study, self._progress = study or f"{arm.name}-robot", progress

    def _provenance(
        self, bounds: str | Path | None, limit: str | Path | None, storage: str | None, seed: int
    ) -> dict[str, Any]:
        files = {k: Path(p) for k, p in (("bounds", bounds), ("limit", limit)) if p is not None}
        made = {**self.about, "storage": storage is not None}
        return provenance("tune", made, seed=seed, inputs=files)

    @cached_property
    def record(self) -> Record:
        """The study."""
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        return Record(self._storage, self._study, about=self.about)

    def reach(self) -> None:
        """Open a study outside of the folder before the folder is made: it may not be there."""
        if self._outside:
            _ = self.record

    def open(self) -> tuple[Record, Predicted]:
        """Return study and predictions; simulate what the robot may be asked for, once."""
        record = self.record
        predicted = predictions(record)
        if predicted is None:
            predicted = self._predict()
            keep_predictions(record, predicted)
        return record, predicted

    def _predict(self) -> Predicted:
        e, s = self.experiment, self.settings.robot
        report = self._simulated()
        objective = BreakawayObjective(
            e,
            self.bounds,
            [e.sticking.parameters],
            iterations=s.iterations,
            limits=self.limits,
            progress=report,
        )
        limit = objective.displacement
        found = predict(e, self.bounds, limit, settings=s, progress=report)
        base = {(c.joint, c.load, c.direction): abs(m.mean) for c, m in objective.base[0].items()}
        return Predicted(candidates=found, base_nm=base, limit=limit.tolist())

    def with_told(self, record: Record, predicted: Predicted, rows: list[Told]) -> Predicted:
        """Return the predictions with those of settings that were told but never asked for."""
        s = self.settings.robot
        told = dict.fromkeys(r.setting for r in rows if not r.is_base)
        new = [AmplitudeRow(*t) for t in told if predicted.find(t, s.same) is None]
        if not new:
            return predicted
        joints = sorted({row.joint for row in new})
        found = measure(self.experiment, new, s.iterations, self._simulated())
        candidates = dict(predicted.candidates)
        for j in joints:
            c, mine = candidates[j], [row for row in new if row.joint == j]
            base = np.array([predicted.base_nm[j, *cell] for cell in CONFIGURATIONS])
            tau = np.array([[found[job(r, *c)].mean for c in CONFIGURATIONS] for r in mine])
            swing = np.array(
                [[found[job(r, *c)].displacement for c in CONFIGURATIONS] for r in mine]
            )
            # one that sticks in simulation is predicted to do nothing
            ratio = np.nan_to_num(np.abs(tau) / base, nan=1.0)
            over = np.array([shaken(found, row) > predicted.limit[j - 1] for row in mine])
            candidates[j] = _joined(c, mine, ratio, np.maximum(swing, 1e-9), ~over)
        out = dataclasses.replace(predicted, candidates=candidates)
        keep_predictions(record, out)
        return out

    def _simulated(self) -> Callable[[float], None] | None:
        """Return what takes simulated seconds; how many it will be is known only roughly."""
        if self._progress is None:
            return None
        s, e, progress, done = self.settings.robot, self.experiment, self._progress, 0.0
        settings = s.frequencies * (s.amplitudes + 1) + 2
        total = settings * e.expected_seconds(e.jobs(), s.iterations)

        def report(seconds: float) -> None:
            nonlocal done
            done += seconds
            progress("simulate", min(done, total), total)

        return report


def _joined(
    c: Candidates,
    rows: list[AmplitudeRow],
    ratio: Array,
    displacement: Array,
    eligible: np.ndarray[Any, np.dtype[np.bool_]],
) -> Candidates:
    return Candidates(
        joint=c.joint,
        frequency_hz=np.append(c.frequency_hz, [r.frequency_hz for r in rows]),
        amplitude_nm=np.vstack([c.amplitude_nm, [[r.amplitude_nm] * 4 for r in rows]]),
        predicted=np.vstack([c.predicted, ratio]),
        displacement=np.vstack([c.displacement, displacement]),
        eligible=np.append(c.eligible, eligible),
    )


def _folder(path: Path, found: Mapping[str, Any], force: bool) -> OutputFolder:
    """Return the folder; ``force`` never wipes the study of this very session."""
    try:
        return OutputFolder(path, dict(found), resumable=True)
    except StictionError:
        if not force:
            raise
        return OutputFolder(path, dict(found), force=True, resumable=True)


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value
