"""Write the precomputed results that the package ships: those for the first reset of builtin arms.

    python -m stiction_envs.envs.precompute

It takes some minutes. Run it after a change that alters such a result or its digest;
``tests/envs/test_precompute.py`` says when.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from stiction_envs.experiments import poses
from stiction_envs.experiments.gte import random_paths
from stiction_envs.experiments.gte import undithered as gte_base
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import TRAJECTORIES, episode_settings
from stiction_envs.experiments.sje import undithered as sje_base
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import configurations
from stiction_envs.precomputed import store
from stiction_envs.robots import BUILTIN


def entries(robot: str, paths: Sequence[int] = ()) -> dict[str, tuple[str, str]]:
    """Compute what the first reset of an arm's environments needs.

    Args:
        robot: a builtin arm.
        paths: numbers of the random paths to include.

    Returns:
        Kind and digest of each result, by its description.
    """
    sje = SingleJointExperiment(robot)
    sje_base.base_torques(sje, configurations(sje.n))
    gte = GeneratedTrajectoryExperiment(robot)
    gte_base.undithered(gte, [(t, k) for t in TRAJECTORIES for k in episode_settings().stiffness])
    found = random_paths.random_paths(gte.sticking, gte.start, gte.tool, paths)
    gte_base.undithered(gte, [(p.path.name, p.stiffness) for p in found.values()])
    of = gte_base.fingerprint(gte)
    more = {
        f"{robot}: draws of random paths": (
            random_paths.KIND,
            random_paths.fingerprint(gte.sticking, gte.start, gte.tool),
        ),
        f"{robot}: random paths without dither [m, rad, s]": (gte_base.RANDOM_KIND, of),
    }
    return {
        f"{robot}: poses [rad] and signed loads [N·m]": (
            "poses",
            poses.fingerprint(sje.sticking.arm),
        ),
        f"{robot}: base torques [N·m]": (sje_base.KIND, sje_base.fingerprint(sje)),
        f"{robot}: errors, duration, shaking without dither [m, rad, s]": (
            gte_base.KIND,
            of,
        ),
        **(more if paths else {}),
    }


def main(folder: Path = store.SHIPPED) -> None:
    """Compute all results again; they replace those in ``folder``."""
    os.environ["STICTION_CACHE"] = "off"
    store.forget()
    paths = range(episode_settings().random_paths)
    found = {k: v for robot in BUILTIN for k, v in entries(robot, paths).items()}
    for old in folder.glob("*.json"):
        old.unlink()
    for about, (kind, of) in found.items():
        store.write(folder / store.file_name(kind, of), store.recall(kind, of), about=about)
        print(about)


if __name__ == "__main__":
    main()
