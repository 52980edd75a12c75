"""One run of the tuner: its output folder, its studies, and what tells it from another run."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import optuna

from stiction_envs.errors import ExperimentError, StictionError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import QUANTITIES
from stiction_envs.reporting.output_folder import OutputFolder, default_folder
from stiction_envs.reporting.provenance import provenance
from stiction_envs.version import __version__
from tuning.settings import SharedSettings
from tuning.study.record import Record
from tuning.study.samplers import installed
from tuning.study.storage import parse, shown

Progress = Callable[[str, float, float], None]
"""Called with the name of a stage, how much of it is done, and how much there is."""


def counted(progress: Progress, stage: str, total: float = 1.0) -> Callable[[float], None]:
    """Return a function that adds to what is done of a stage, of a roughly known total."""
    done = 0.0

    def report(more: float) -> None:
        nonlocal done
        done += more
        progress(stage, done, max(done, total))

    return report


@dataclass(frozen=True, kw_only=True)
class TuningRun:
    """Folder and studies of a run."""

    folder: OutputFolder
    about: Mapping[str, object]
    storage: str
    study: str  # Prefix of the studies' names
    settings: SharedSettings

    def record(self, stage: str, objectives: int = 1, sampler: str | None = None) -> Record:
        """Open the study of a stage; errors as of `Record`."""
        about = {**self.about, "stage": stage}
        if sampler is not None:
            about["sampler"] = installed(sampler)
        name = f"{self.study}-{stage}"
        return Record(
            self.storage, name, objectives=objectives, about=about, settings=self.settings
        )

    @contextmanager
    def working(self) -> Iterator[Path]:
        """Create the folder; a StictionError after something was written is an ExperimentError."""
        try:
            with self.folder:
                yield self.folder.path
        except StictionError as error:
            if self.folder.resumed or self.folder.wrote:
                raise ExperimentError(str(error)) from error
            raise


def open_run(
    name: str,
    protocol: str,
    experiment: SingleJointExperiment,
    defining: Mapping[str, object],
    *,
    out: str | Path | None,
    force: bool,
    settings: SharedSettings,
    inputs: Mapping[str, object],
    storage: str | None = None,
    study: str | None = None,
    database: str = "study.db",
    **others: object,
) -> TuningRun:
    """Check the output folder of a run; nothing is written yet.

    Args:
        name: start of the default folder's name, ``runs/NAME-ROBOT``.
        protocol: name of the procedure.
        experiment: the arm, its friction, its protocol and the seed.
        defining: further arguments that distinguish studies.
        out: output folder, see `OutputFolder` for ``force``.
        settings: time limits of a shared database.
        inputs: arguments by name, of which those that are files are recorded with their hashes.
        storage: URL; None for the SQLite file ``database`` in the folder.
        study: prefix of the studies' names; None for the arm's name.
        others: arguments that distinguish folders, but not studies.
    """
    sticking = experiment.sticking
    about = {
        **experiment.record,
        "protocol": protocol,
        "version": __version__,
        "friction": {k: getattr(sticking.parameters, k) for k in QUANTITIES},
        "sje": dataclasses.asdict(experiment.protocol),
        "seed": experiment.seed,
        **defining,
    }
    made = {**about, **others, "storage": storage and shown(parse(storage)), "study": study}
    paths = {k: Path(v) for k, v in inputs.items() if isinstance(v, str | Path)}
    files = {k: path for k, path in paths.items() if path.is_file()}
    folder = OutputFolder(
        default_folder(name, sticking.arm.name) if out is None else Path(out),
        provenance("tune", made, seed=experiment.seed, inputs=files),
        force=force,
        resumable=True,
    )
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    return TuningRun(
        folder=folder,
        about=about,
        storage=storage or f"sqlite:///{(folder.path / database).resolve()}",
        study=study or sticking.arm.name,
        settings=settings,
    )
