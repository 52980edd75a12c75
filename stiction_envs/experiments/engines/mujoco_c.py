"""Stock MuJoCo: the plant's own engine."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from stiction_envs.experiments.engines.base import CHUNK, Array, Drive, Engine
from stiction_envs.plant.any_model import rollout


class MuJoCo(Engine):
    """MuJoCo in C, float64."""

    name: ClassVar = "mujoco"
    packages: ClassVar = (("mujoco", "mujoco"),)
    single: ClassVar = False
    keep: ClassVar = 'nothing: `mujoco.MjModel.from_xml_path("scene.xml")`'

    def simulate(self, drive: Drive) -> Iterator[dict[str, Array]]:
        """See `Engine.simulate`."""
        d = drive
        return rollout(
            *(d.bare.model, d.qpos, d.torque, d.steps),
            record=d.record,
            chunk=CHUNK,
            threads=d.threads,
        )
