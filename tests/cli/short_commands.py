"""Every command that writes, each as short as it can be, with the files that it reads."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from stiction_envs.identification import settings as identification_settings
from stiction_envs.method_settings import override
from stiction_envs.robots import load_arm
from tests.cli.bad_disk import BadDisk
from tests.cli.test_bad_input import BASE_TWO
from tests.cli.test_train import QUICK as PANDA
from tests.cli.test_train import SETTINGS
from tests.experiments.test_conformance import lugre
from tests.gap.small_logs import hidden, sliding, write_csv
from tuning.robot import session
from tuning.settings import tuning_settings

ONCE = ["--iterations", 1]
SEARCH = ["--protocol", "search", "--sampler", "random", "--evaluations", 2]
FEW = {"robot.frequencies": 2, "robot.amplitudes": 2, "robot.iterations": 1}


@dataclass(frozen=True)
class Command:
    """A command line, what it is again after a failure, and at how many writes it is tried."""

    argv: tuple[object, ...]
    resumes: bool = False
    points: int = 1
    out: str = "out"


QUICK = {
    "excite": Command(("excite", "TWO", "--rate", 50, "--harmonics", 3, "--base-frequency", 0.2)),
    "export": Command(("export", "TWO"), points=5),
    "conformance": Command(("conformance", "SLIDER"), points=5),
    "identify": Command(("identify", "LOG", "--robot", "TWO")),
}
SLOW = {
    "sje": Command(("sje", "TWO", *ONCE, "--no-scatter")),
    "gte": Command(("gte", "panda", "--trajectory", "PATH", "--stiffness", 500, 30, 0, *ONCE)),
    "calibrate": Command(("calibrate", "TWO", "BASE"), out="out/friction.toml"),
    "diagnose": Command(("diagnose", "LOG", "--robot", "TWO", "--method", "lsm")),
    "evaluate": Command(("evaluate", "panda", "sje", "--policy", "none", "--episodes", 2, *PANDA)),
    "tune": Command(
        ("tune", "TWO", *ONCE, "--no-scatter", "--frequencies", 15, "--scales", 1.0), True
    ),
    "tune journal": Command(
        (
            *("tune", "TWO", *ONCE, "--no-scatter", "--frequencies", 15, "--scales", 1.0),
            *("--storage", "study.journal"),
        ),
        True,
    ),
    "search": Command(("tune", "TWO", *SEARCH), True),
    "ask": Command(("tune", "TWO", "--protocol", "search", "--ask"), True),
    "tell": Command(("tune", "TWO", "--protocol", "search", "--tell", "TOLD", "--ask"), True),
    "train": Command(
        ("train", "panda", "sje", "--algo", "ppo", "--steps", 64, "--settings", "SMALL", *PANDA),
        True,
        points=2,
    ),
}


@pytest.fixture
def short_inputs(inputs, two) -> dict[str, Path]:
    """Input files, by the words that stand for them in a command line."""
    write_csv(inputs / "log.csv", hidden(load_arm(two), lambda q, dq, ddq: 0.5 * sliding(q)))
    (inputs / "slider.xml").write_text(lugre("2000 12 0.5 0.6 0.003"))
    (inputs / "base.csv").write_text(BASE_TWO)
    (inputs / "small.toml").write_text(SETTINGS)
    head = "robot,joint,frequency_hz,amplitude_nm,load,direction,tau_nm\n"
    rows = [
        f"two,{j},{f},{a},{load},{d},{d}{tau}\n"
        for j in (1, 2)
        for f, a, tau in ((0, 0, 0.8), (15, 0.3, 0.7))
        for load in ("load", "no_load")
        for d in "+-"
    ]
    (inputs / "told.csv").write_text(head + "".join(rows))
    (inputs / "path.csv").write_text("x,y,z\n0.03,0,0\n0,0.03,0\n")
    names = {
        "PATH": "path.csv",
        "LOG": "log.csv",
        "SLIDER": "slider.xml",
        "BASE": "base.csv",
        "SMALL": "small.toml",
    }
    return {"TWO": two, "TOLD": inputs / "told.csv"} | {k: inputs / v for k, v in names.items()}


@pytest.fixture
def run_short(cli, work, short_inputs, monkeypatch) -> Callable[..., Any]:
    """Run a command in a folder of its own, on a disk that may be bad."""
    few = {"excitation": {"iterations": 6, "randoms": 3, "starts": 1}}
    motion = override(identification_settings.identification_settings(), few)
    monkeypatch.setattr(identification_settings, "identification_settings", lambda: motion)
    asked = override(tuning_settings(), FEW)
    monkeypatch.setattr(session, "tuning_settings", lambda: asked)

    def run(command: Command, name: str, disk: BadDisk | None = None, *more: str):
        (work / name).mkdir(exist_ok=True)
        monkeypatch.chdir(work / name)
        argv = [short_inputs.get(a, a) if isinstance(a, str) else a for a in command.argv]
        argv += ["--out", command.out, "--threads", 1]
        with disk or nullcontext():
            return cli(*argv, *more)

    return run
