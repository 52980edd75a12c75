"""Every command that writes, each as short as it can be, with the files that it reads."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass

import pytest

from benchmarks.thesis import command as thesis
from stiction_envs.cli.dispatch import all_commands
from stiction_envs.identification import settings as identification_settings
from stiction_envs.method_settings import override
from stiction_envs.robots import load_arm
from tests.cli.bad_disk import BadDisk
from tests.experiments.test_conformance import lugre
from tests.gap.small_logs import hidden, sliding, write_csv
from tuning.settings import tuning_settings

BASE_TWO = "robot,joint,load,direction,tau_base_Nm\n" + "".join(
    f"two,{j},{load},{d},{d}0.8\n" for j in (1, 2) for load in ("load", "no_load") for d in "+-"
)
"""Base torques of the arm of two joints."""
TRAINING = """
[ppo]
envs = 4
rollout = 8
batch_size = 16
network = [16]
[sac]
envs = 4
learning_starts = 16
[run]
evaluation_every = 32
evaluation_episodes = 2
final_episodes = 2
"""
"""Settings of a short training."""
EPISODES = """--env control_interval_s=0.2 'fixed_options={"joint":6,"load":"no_load"}'"""
"""Arguments of short episodes of the SJE."""
FEW = {
    **{"robot.frequencies": 2, "robot.amplitudes": 2, "robot.iterations": 1},
    **{"search.draws": 1, "search.verify_draws": 2, "search.verify_iterations": 1},
}
TUNE = "tune {two.xml} --iterations 1 --no-scatter --frequencies 15 --scales 1"
SEARCH = "tune {two.xml} --protocol search"


@dataclass(frozen=True)
class Command:
    """A command line, what it is again after a failure, and at how many writes it is tried."""

    line: str
    resumes: bool = False
    points: int = 1
    out: str = "out"


QUICK = {
    "excite": Command("excite {two.xml} --rate 50 --harmonics 3 --base-frequency 0.2"),
    "export": Command("export {two.xml}", points=5),
    "conformance": Command("conformance {slider.xml}", points=5),
    "identify": Command("identify {log.csv} --robot {two.xml}"),
}
SLOW = {
    "sje": Command("sje {two.xml} --iterations 1 --no-scatter"),
    "gte": Command("gte panda --trajectory {path.csv} --stiffness 500 30 0 --iterations 1"),
    "calibrate": Command("calibrate {two.xml} {base.csv}", out="out/friction.toml"),
    "diagnose": Command("diagnose {log.csv} --robot {two.xml}"),
    "rehearse": Command(
        "diagnose {log.csv} --robot {two.xml} --rehearse --rehearse-causes coulomb_friction", True
    ),
    "evaluate": Command(f"evaluate panda sje --policy none --episodes 2 {EPISODES}"),
    "tune": Command(TUNE, True),
    "search": Command(f"{SEARCH} --sampler random --evaluations 2", True),
    "ask": Command(f"{SEARCH} --ask", True),
    "tell": Command(f"{SEARCH} --tell {{told.csv}} --ask", True),
    "train": Command(
        f"train panda sje --algo ppo --steps 64 --settings {{small.toml}} {EPISODES}",
        True,
        points=2,
    ),
    "reproduce": Command("reproduce --only 2.3", True),
}
COMMANDS = QUICK | SLOW


@pytest.fixture
def short_motion(monkeypatch) -> None:
    """Make the search of an exciting motion short."""
    few = {"excitation": {"iterations": 6, "randoms": 3, "starts": 1}}
    motion = override(identification_settings.identification_settings(), few)
    monkeypatch.setattr(identification_settings, "identification_settings", lambda: motion)


@pytest.fixture
def few_settings(monkeypatch) -> None:
    """Leave so few settings to ask for, and frictions to try, that simulating them is quick."""
    asked = override(tuning_settings(), FEW)
    for module in ("robot.session", "search.search"):
        monkeypatch.setattr(f"tuning.{module}.tuning_settings", lambda: asked)


@pytest.fixture
def run_short(cli, work, inputs, two, short_motion, few_settings, monkeypatch) -> Callable:
    """Run a command in a folder of its own, on a disk that may be bad; its inputs are there."""
    write_csv(inputs / "log.csv", hidden(load_arm(two), lambda q, dq, ddq: 0.5 * sliding(q)))
    (inputs / "slider.xml").write_text(lugre("2000 12 0.5 0.6 0.003"))
    (inputs / "base.csv").write_text(BASE_TWO)
    (inputs / "small.toml").write_text(TRAINING)
    (inputs / "path.csv").write_text("x,y,z\n0.03,0,0\n0,0.03,0\n")
    rows = [
        f"two,{j},{f},{a},{load},{d},{d}{tau}\n"
        for j in (1, 2)
        for f, a, tau in ((0, 0, 0.8), (15, 0.3, 0.7))
        for load in ("load", "no_load")
        for d in "+-"
    ]
    head = "robot,joint,frequency_hz,amplitude_nm,load,direction,tau_nm\n"
    (inputs / "told.csv").write_text(head + "".join(rows))

    def run(command: Command, name: str, disk: BadDisk | None = None, *more: object):
        (work / name).mkdir(exist_ok=True)
        monkeypatch.chdir(work / name)
        argv = [*shlex.split(command.line), "--out", command.out, "--threads", 1]
        with disk or nullcontext():
            return cli(*argv, *more, commands=[*all_commands(), thesis])

    return run
