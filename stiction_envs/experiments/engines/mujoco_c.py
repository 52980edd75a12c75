"""Stock MuJoCo: the plant's own engine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

from stiction_envs.any_model import rollout
from stiction_envs.experiments.engines.base import CHUNK, Array, Bare, Engine, Torque


class MuJoCo(Engine):
    """MuJoCo in C, float64."""

    name: ClassVar = "mujoco"
    packages: ClassVar = (("mujoco", "mujoco"),)
    single: ClassVar = False
    keep: ClassVar = 'nothing: `mujoco.MjModel.from_xml_path("scene.xml")`'

    def simulate(
        self,
        bare: Bare,
        qpos: Array,
        torque: Torque,
        steps: int,
        *,
        record: Sequence[str] = ("qpos",),
        threads: int = 0,
    ) -> Iterator[dict[str, Array]]:
        """See `Engine.simulate`."""
        return rollout(bare.model, qpos, torque, steps, record=record, chunk=CHUNK, threads=threads)
