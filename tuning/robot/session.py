"""Tuning on a real robot: propose settings, enter what was measured, over weeks.

    Session("panda", out="runs/robot").ask(2)       # runs/robot/ask.csv, measure.csv to fill in
    Session("panda", out="runs/robot").tell("measured.csv")

Both write report.md, final.csv and final.yaml. Everything permanent is in the study.
"""

import dataclasses
from functools import cached_property
from pathlib import Path

from stiction_envs.errors import checked_array
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Protocol
from stiction_envs.friction.sticking import Friction, Robot
from stiction_envs.measured.tables import read_amplitudes
from stiction_envs.method_settings import Changes, override
from stiction_envs.reporting.kept_rows import KeptRows
from stiction_envs.reporting.provenance import sha256
from tuning.robot.measured_table import (
    MeasuredRow,
    add_measured,
    check_measured,
    read_measured,
    readings,
)
from tuning.robot.posterior import Posterior
from tuning.robot.prediction import Predicted, candidates_of, predict
from tuning.robot.report import RobotState, write_state
from tuning.search.bounds import bounds_of, reference_tables
from tuning.search.breakaway import BreakawayObjective
from tuning.search.frictions import plausible
from tuning.settings import TuningSettings, tuning_settings
from tuning.study.tuning_run import Progress, counted, open_run


class Session:
    """One robot, one study, one folder."""

    def __init__(
        self,
        robot: Robot,
        *,
        bounds: str | Path | None = None,
        limit: str | Path | None = None,
        out: str | Path | None = None,
        seed: int = 0,
        friction: Friction | None = None,
        protocol: Protocol | None = None,
        threads: int = 0,
        progress: Progress | None = None,
        settings: TuningSettings | Changes | None = None,
    ) -> None:
        """Check everything; nothing is written yet.

        The arguments are those of `search.search`, but for: ``limit``, an amplitude table whose
        displacement may not be exceeded; ``out``, None for ``runs/ask-ROBOT``; without
        ``force``, which would delete what was measured.

        Raises:
            StictionError: bad input, or a folder of another run.
        """
        self.settings = override(tuning_settings(), settings)
        self.experiment = SingleJointExperiment(
            robot, friction=friction, drive="torque", protocol=protocol, seed=seed, threads=threads
        )
        e, arm = self.experiment, self.experiment.sticking.arm
        self.bounds = bounds_of(e, bounds, self.settings.bounds)
        self.limits = (
            next(iter(reference_tables(e, self.bounds, self.settings).values()))
            if limit is None
            else tuple(read_amplitudes(limit, n_joints=arm.n, torque_limit=arm.limits.torque))
        )
        defining = {
            "bounds": vars(self.bounds),
            "limits": [dataclasses.astuple(r) for r in self.limits],
            "settings": dataclasses.asdict(self.settings.robot),
        }
        self.folder = open_run(
            *("ask", "search --ask", e, defining),
            out=out,
            force=False,
            settings=self.settings.shared,
            inputs={"robot": robot, "friction": friction, "bounds": bounds, "limit": limit},
        ).folder
        self._progress = progress or (lambda *_: None)

    def ask(self, count: int = 1) -> RobotState:
        """Write the next ``count`` settings of each unfinished joint: ask.csv, and measure.csv.

        The first call simulates all candidates (minutes; for an arm that nobody has fitted under
        several frictions, which takes as many times longer); later calls read them from the study.

        Raises:
            StictionError: bad input; nothing was written.
        """
        checked_array(count, "number of settings to ask for", (), low=1)
        with self.folder:
            state = self._state(*self.open(), count)
            write_state(self.folder.path, state, asked=True)
        return state

    def tell(self, table: str | Path) -> RobotState:
        """Add measured torques to the study, and write the new predictions.

        The table is that of `measured_table.read_measured`; settings that were not proposed count
        too, within the bounds.

        Raises:
            StictionError: a table that cannot be this robot's, or as in `ask`; nothing was changed.
        """
        path, experiment = Path(table), self.experiment
        rows = read_measured(path, experiment.sticking.arm.name, experiment.n)
        rough = {j.configuration: experiment.expected(j) for j in experiment.jobs()}
        check_measured(rows, self.bounds, rough, self.settings.robot)
        with self.folder:
            study, predicted = self.open()
            predicted = self.with_measured(study, predicted, rows)
            new = add_measured(study, rows, sha256(path))
            state = self._state(study, predicted, 1, told=new)
            write_state(self.folder.path, state, asked=False)
        return state

    def _state(
        self, study: KeptRows, predicted: Predicted, count: int, told: int = 0
    ) -> RobotState:
        """Return the present results, with up to ``count`` settings per joint to measure."""
        settings, candidates = self.settings.robot, predicted.candidates
        measured, missing = readings(study, predicted, settings.same)
        joints = [Posterior(c, measured[j], settings) for j, c in sorted(candidates.items())]
        return RobotState(
            sticking=self.experiment.sticking,
            joints={p: [] if p.may_stop else p.next_settings(count) for p in joints},
            missing=missing,
            told=told,
        )

    def open(self) -> tuple[KeptRows, Predicted]:
        """Return study and predictions; simulate the candidate settings once."""
        study = KeptRows(self.folder.path / "study.jsonl")
        predicted = Predicted.read(study)
        if predicted is None:
            objective = self._objective
            predicted = Predicted(
                candidates=predict(objective, self.settings.robot),
                base_nm={c: abs(m.mean) for c, m in objective.base[0].items()},
                limit=objective.displacement.tolist(),
            )
            predicted.write(study)
        return study, predicted

    @cached_property
    def _objective(self) -> BreakawayObjective:
        """The simulated robot; its base torques are measured when it is first used."""
        e, s = self.experiment, self.settings.robot
        frictions = plausible(e.sticking.parameters, s)
        settings = s.frequencies * (s.amplitudes + 1) + 2  # roughly
        total = settings * e.expected_seconds(e.jobs(), s.iterations) * len(frictions)
        return BreakawayObjective(
            e,
            self.bounds,
            frictions,
            iterations=s.iterations,
            limits=self.limits,
            progress=counted(self._progress, "simulate", total),
        )

    def with_measured(
        self, study: KeptRows, predicted: Predicted, rows: list[MeasuredRow]
    ) -> Predicted:
        """Return the predictions, with those of settings that were measured but never proposed."""
        measured = dict.fromkeys(r.setting for r in rows if not r.is_base)
        same = self.settings.robot.same
        new = [row for row in measured if predicted.find(row, same) is None]
        if not new:
            return predicted
        candidates = dict(predicted.candidates)
        for row, found in self._objective.measure(new).items():
            j = row.joint
            more = candidates_of(j, {row: found}, predicted.limit[j - 1])
            candidates[j] = candidates[j].with_more(more)
        out = dataclasses.replace(predicted, candidates=candidates)
        out.write(study)
        return out
