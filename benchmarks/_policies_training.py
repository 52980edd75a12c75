"""Trainings of `policies`: each in a process of its own, which goes on where it was stopped.

    python -m benchmarks._policies_training FOLDER ROBOT EXPERIMENT ALGORITHM RUN STEPS

is one of them; `train_all` starts them.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks._made_by import EPISODES, PACKAGES, made_by
from benchmarks._policies_plan import ALGORITHMS, Plan, Training, trainings
from stiction_envs.errors import StictionError
from stiction_envs.method_settings import fingerprint
from stiction_envs.precomputed.store import digest
from stiction_envs.reporting.atomic import write_text_atomic

TOGETHER = 2
"""Processes at most."""
DONE, CODE, SHARE, LOG, LOCK = "trained.json", "code", "share", "log", "lock"
"""What the benchmark adds to the folder of a training."""
TRAINED_BY = (
    *EPISODES,
    *(f"tuning/policies/{name}*.py" for name in ("algo", "call", "check", "policy", "recorded")),
    *(f"tuning/policies/{name}.py" for name in ("evaluation", "task", "train")),
)
"""Code that decides the bits of a training; its settings are in the name of its folder."""
RATES = {"sac": 440.0, "td3": 550.0, "ppo": 600.0}
"""Steps/s of each of two trainings together, assumed, to weigh what the progress bar shows: about
what the Panda's GTE had over 6000 to 11,000 steps. The page has what finished trainings had."""
POLL = 0.5  # seconds
Tell = Callable[[dict[Training, float]], None]
"""Called with the share of each training that is done."""


@dataclass(frozen=True)
class Folder:
    """The folder of a training."""

    training: Training
    steps: int
    path: Path

    @property
    def policy(self) -> Path:
        """What was trained."""
        return self.path / "policy.zip"

    @property
    def done(self) -> bool:
        """Whether the training is over."""
        return (self.path / DONE).exists()

    @property
    def share(self) -> float:
        """Share of the training that is done."""
        if self.done:
            return 1.0
        try:
            return float((self.path / SHARE).read_text("utf-8"))
        except (OSError, ValueError):
            return 0.0

    @property
    def found(self) -> dict[str, Any]:
        """``code`` that trained it, and ``steps_per_second`` of its last process.

        The latter is None where that process had nothing left to do.
        """
        out: dict[str, Any] = json.loads((self.path / DONE).read_text("utf-8"))
        return out

    def curve(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return steps and the returns of their evaluations."""
        table = np.genfromtxt(self.path / "curve.csv", delimiter=",", names=True)
        return np.atleast_1d(table["steps"]), np.atleast_1d(table["evaluation_return"])


def folder(work: Path, plan: Plan, training: Training) -> Folder:
    """Return the folder of a training; other settings have another one.

    What was finished by other code stays, and says so (`Folder.found`): a policy is what it is,
    however it came about. What was only begun by other code is begun anew.
    """
    arguments = {k: repr(v) for k, v in training.task.arguments.items()}
    settings = training.settings
    used = {"own": getattr(settings, training.algorithm), "run": settings.run}
    start = [repr(row) for row in training.start]
    begun = [start, fingerprint(settings.start)] if start else []
    of = digest(training.name, plan.steps, arguments, fingerprint(used), *begun)
    return Folder(training, plan.steps, work / "trainings" / f"{training.name}-{of[:8]}")


@cache
def code_today() -> str:
    """Return a hash of the code that trains today, as `Folder.found` has it."""
    return made_by(TRAINED_BY, (*PACKAGES, "stable-baselines3", "torch", "gymnasium"))


def best_algorithm(work: Path, plan: Plan) -> str | None:
    """Return whose kept policies had the best evaluations while the Panda's were trained.

    These episodes are on paths that training knows: none of the test's has a say. None while a
    training is missing.
    """
    mean = {}
    for algorithm in ALGORITHMS:
        mine = [
            folder(work, plan, t)
            for t in trainings(plan, None)
            if (t.experiment, t.algorithm) == ("gte", algorithm)
        ]
        if not all(f.done for f in mine):
            return None
        mean[algorithm] = np.mean([f.curve()[1].max() for f in mine])
    return max(mean, key=lambda a: float(mean[a]))


# ---- the one that starts them --------------------------------------------------------------------


def train_all(folders: Sequence[Folder], tell: Tell, deadline: float) -> list[str]:
    """Train what is not done, two at a time; return what went wrong.

    Args:
        folders: of the trainings.
        tell: called about once a second.
        deadline: of `time.monotonic`, when what is going on is stopped: it goes on later from its
            last checkpoint.
    """
    waiting = [f for f in folders if not f.done]
    running: dict[Training, tuple[Folder, subprocess.Popen[bytes]]] = {}
    wrong: list[str] = []
    try:
        while (waiting or running) and time.monotonic() < deadline:
            while waiting and len(running) < TOGETHER:
                one = waiting.pop(0)
                running[one.training] = one, _start(one)
            time.sleep(POLL)
            for training, (one, process) in list(running.items()):
                if process.poll() is not None:
                    del running[training]
                    if process.returncode:
                        wrong.append(f"{training.name}: {_last_line(one.path / LOG)}")
            tell({f.training: f.share for f in folders})
    finally:
        for _, process in running.values():
            process.terminate()
        for _, process in running.values():
            process.wait()
    return wrong


def _start(one: Folder) -> subprocess.Popen[bytes]:
    one.path.mkdir(parents=True, exist_ok=True)
    t = one.training
    words = [one.path, t.robot, t.experiment, t.algorithm, t.run, one.steps]
    command = [sys.executable, "-m", "benchmarks._policies_training", *map(str, words)]
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with (one.path / LOG).open("ab") as log:
        # a session of its own: Ctrl-C is for the one that starts them
        return subprocess.Popen(
            command, stdout=log, stderr=log, env={**os.environ, **threads}, start_new_session=True
        )


def _last_line(path: Path) -> str:
    lines = path.read_text("utf-8", errors="replace").strip().splitlines()
    return lines[-1] if lines else "ended without a word"


# ---- one of them ---------------------------------------------------------------------------------


def _train(path: Path, training: Training, steps: int) -> None:
    from tuning.policies.train import CHECKPOINTS, train

    parent, said = os.getppid(), 0.0

    def progress(stage: str, share: float) -> None:
        nonlocal said
        if os.getppid() != parent:  # whoever started this was killed
            os.kill(os.getpid(), signal.SIGTERM)
        if time.monotonic() - said > 1.0:
            said = time.monotonic()
            (path / SHARE).write_text(f"{share:.5f}", "utf-8")

    with (path / LOCK).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # until one that was left alone has noticed
        code = code_today()
        if not (path / CODE).exists() or (path / CODE).read_text("utf-8") != code:
            shutil.rmtree(path / CHECKPOINTS, ignore_errors=True)
            write_text_atomic(path / CODE, code)
        found = train(
            training.task,
            training.algorithm,
            steps=steps,
            out=path,
            seed=training.run,
            start=training.start,
            settings=training.settings,
            progress=progress,
        )
        text = json.dumps({"code": code, "steps_per_second": found.steps_per_second})
        write_text_atomic(path / DONE, text)


def main() -> int:
    path, robot, experiment, algorithm, run, steps = sys.argv[1:]
    training = Training(robot=robot, experiment=experiment, algorithm=algorithm, run=int(run))
    warnings.simplefilter("ignore")
    try:
        _train(Path(path), training, int(steps))
    except StictionError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
