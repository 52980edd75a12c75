"""Write the precomputed results that the package ships: those for the first reset of builtin arms.

    python -m tests.envs.make_precomputed

It takes some minutes. Run it after a change that alters such a result or its digest;
``tests/envs/test_precompute.py`` says when.
"""

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from stiction_envs.experiments.gte import random_paths
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import TRAJECTORIES, episode_settings
from stiction_envs.experiments.gte.undithered import undithered
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import configurations
from stiction_envs.experiments.sje.undithered import base_torques
from stiction_envs.precomputed import store
from stiction_envs.reporting.kept_rows import KeptRows
from stiction_envs.robots import BUILTIN


def simulate(robot: str, paths: Sequence[int] = ()) -> None:
    """Compute what the first reset of an arm's environments needs, for the store to keep.

    Args:
        robot: a builtin arm.
        paths: numbers of the random paths to include.
    """
    sje = SingleJointExperiment(robot)
    base_torques(sje, configurations(sje.n))
    gte = GeneratedTrajectoryExperiment(robot)
    undithered(gte, [(t, k) for t in TRAJECTORIES for k in episode_settings().stiffness])
    found = random_paths.random_paths(gte.sticking, gte.start, gte.tool, paths)
    undithered(gte, [(p.path.name, p.stiffness) for p in found.values()])


def main() -> None:
    """Compute all results again; they replace the shipped ones."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["STICTION_CACHE"] = folder
        for old in store.SHIPPED.glob("*.jsonl"):
            old.unlink()
        store.forget()
        for robot in BUILTIN:
            simulate(robot, range(episode_settings().random_paths))
            print(robot)
        for path in Path(folder).iterdir():
            shipped = KeptRows(store.SHIPPED / path.name)
            for name, value in KeptRows(path, store.code_digest()).every.items():
                shipped.add(name, value)


if __name__ == "__main__":
    main()
