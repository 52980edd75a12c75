"""Stock MuJoCo, the engine of the plant."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from stiction_envs.experiments.engines.base import Array, Drive, Engine
from stiction_envs.plant.any_model import rollout


class MuJoCo(Engine):
    """MuJoCo in C, float64."""

    name: ClassVar = "mujoco"
    packages: ClassVar = (("mujoco", "mujoco"),)
    single: ClassVar = False
    keep: ClassVar = 'nothing: `mujoco.MjModel.from_xml_path("scene.xml")`'

    def simulate(self, drive: Drive) -> Iterator[dict[str, Array]]:
        """See `Engine.simulate`."""
        torque, chunks = drive.torque, drive.chunks()
        return rollout(
            *(drive.bare.model, drive.qpos, torque, chunks),
            record=drive.record,
            threads=drive.threads,
        )
