"""Make the pictures of the site: `python docs/make_pictures.py [sje panda log policies]`.

The first picture of each way in is what the commands of its page wrote.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import run_page

from stiction_envs.experiments.sje import plots
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job

HERE = Path(__file__).parent


def draw_sje() -> None:
    """Draw one experiment with and without dither."""
    experiment = SingleJointExperiment("panda", scatter=False)
    where = Configuration(7, "load", "+")
    measured = {
        m.job.amplitude_nm: m
        for m in experiment.run([Job(where), Job(where, 15.0, 0.801)], iterations=1)
    }
    plots.plot_with_and_without(
        measured[0.0],
        measured[0.801],
        HERE / "sje.png",
        robot="panda",
        threshold=experiment.protocol.threshold,
        ramp_rate=experiment.protocol.ramp_rate,
    )


def run(page: str) -> None:
    """Run a page's commands and keep its pictures."""
    with tempfile.TemporaryDirectory() as folder:
        script = [sys.executable, HERE / "run_page.py", HERE / f"{page}.md", folder]
        done = subprocess.run(script, env={"MUJOCO_GL": "egl", **os.environ}, check=False)
        for name, source in run_page.PICTURES[page].items():
            shutil.copyfile(Path(folder) / source, HERE / name)
    if done.returncode:
        sys.exit(f"{page}.md does not show what its commands print")


if __name__ == "__main__":
    makers: dict[str, Callable[[], None]] = {"sje": draw_sje}
    makers |= {page: lambda page=page: run(page) for page in run_page.PICTURES}
    for wanted in sys.argv[1:] or makers:
        makers[wanted]()
