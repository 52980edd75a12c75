"""Write what the package ships of the store: what a first contact with a builtin arm needs.

    python -m stiction_envs.envs.precompute

It takes a minute. Run it after a change that alters such a result, or what it is found by;
``tests/envs/test_precompute.py`` says when.
"""

from __future__ import annotations

import os
from pathlib import Path

from stiction_envs.envs import gte_base, sje_base
from stiction_envs.envs.gte_layout import drawn_stiffness
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import TRAJECTORIES
from stiction_envs.experiments.settings import experiment_settings
from stiction_envs.experiments.sje import poses
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import configurations
from stiction_envs.precomputed import store
from stiction_envs.robots import BUILTIN


def entries(robot: str) -> dict[str, tuple[str, str]]:
    """Make what an arm's environments need at first; return kind and digest by what it is."""
    sje = SingleJointExperiment(robot)
    sje_base.base_torques(sje, configurations(sje.n))
    gte = GeneratedTrajectoryExperiment(robot)
    gte_base.undithered(gte, [(t, k) for t in TRAJECTORIES for k in drawn_stiffness()])
    return {
        f"{robot}: poses [rad] and signed loads [N·m]": (
            "poses",
            poses.fingerprint(sje.sticking.arm, experiment_settings().poses),
        ),
        f"{robot}: base torques [N·m]": (sje_base.KIND, sje_base.fingerprint(sje)),
        f"{robot}: errors, duration, shaking without dither [m, rad, s]": (
            gte_base.KIND,
            gte_base.fingerprint(gte),
        ),
    }


def main(folder: Path = store.SHIPPED) -> None:
    """Make all results anew and put them in place of those in ``folder``."""
    os.environ["STICTION_CACHE"] = "off"
    store.forget()
    found = {k: v for robot in BUILTIN for k, v in entries(robot).items()}
    for old in folder.glob("*.json"):
        old.unlink()
    for about, (kind, of) in found.items():
        store.write(folder / store.file_name(kind, of), store.recall(kind, of), about=about)
        print(about)


if __name__ == "__main__":
    main()
