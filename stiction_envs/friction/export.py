"""Export an arm with its friction as plain MJCF: `export("panda").save("runs/panda-model")`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stiction_envs.errors import StictionError
from stiction_envs.friction.model import COULOMB, STICTION, StickingModel
from stiction_envs.friction.plain_mjcf import plain_mjcf
from stiction_envs.friction.sticking import (
    Friction,
    Robot,
    friction_origin,
    model_sha256,
    sticking_model,
)
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.provenance import provenance
from stiction_envs.reporting.result import Result

SOURCES = ("model.toml", "friction.toml")
"""Files that hold the friction of an earlier run; the first that exists is used."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ExportedModel(Result):
    """Plain MJCF, and the model from which it was made."""

    sticking: StickingModel
    xml: str
    provenance: dict[str, Any]

    def to_json(self) -> dict[str, Any]:
        """Return friction [N·m] and kind of every joint."""
        s = self.sticking
        return {
            "joints": [
                {
                    "name": name,
                    "stiction_nm": s.model.actuator_biasprm[a, STICTION],
                    "coulomb_nm": s.model.actuator_biasprm[a, COULOMB],
                    "elastic": bool(s.spring[i] >= 0),
                }
                for i, (name, a) in enumerate(
                    zip(s.arm.joint_names, s.torque_actuator, strict=True)
                )
            ]
        }

    def write(self, folder: Path) -> None:
        """Write ``model.xml``."""
        write_text_atomic(folder / "model.xml", self.xml)

    def __repr__(self) -> str:
        return f"<ExportedModel of {self.sticking.arm.name}, {self.sticking.n} joints>"

    def __str__(self) -> str:
        return describe(self.to_json()["joints"])


def export(robot: Robot, friction: Friction | None = None) -> ExportedModel:
    """Return an arm with its friction as plain MJCF.

    Args:
        robot: name, model file, arm, or an arm with its friction (`load_model`).
        friction: of one arm, or its TOML; None for the robot's own.

    Raises:
        StictionError: an arm or friction that cannot be loaded, or that do not match.
    """
    sticking = sticking_model(robot, friction)
    origin = friction_origin(robot, friction)
    name = origin.name if isinstance(origin, Path) else "an arm with its friction"
    return ExportedModel(
        sticking=sticking,
        xml=plain_mjcf(sticking, friction_name=name),
        provenance=provenance(
            "export",
            {"robot": sticking.arm.name, "model_sha256": model_sha256(sticking)},
            seed=0,
        ),
    )


def friction_in(folder: Path) -> Path:
    """Return the friction TOML of an earlier run's folder.

    Raises:
        StictionError: it has none of `SOURCES`.
    """
    for name in SOURCES:
        if (folder / name).is_file():
            return folder / name
    raise StictionError(f"{folder}: holds neither {' nor '.join(SOURCES)}")


def describe(joints: Sequence[Mapping[str, Any]]) -> str:
    """Return a text table, one line per joint."""
    lines = [f"{'joint':<24}{'stiction [N·m]':>16}{'Coulomb [N·m]':>16}"]
    for j in joints:
        kind = "  with elastic gear" if j["elastic"] else ""
        lines.append(f"{j['name']:<24}{j['stiction_nm']:>16.4f}{j['coulomb_nm']:>16.4f}{kind}")
    return "\n".join(lines)
