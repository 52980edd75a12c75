"""Export an arm with its friction as plain MJCF: `export("panda").save("runs/panda-model")`.

The folder is laid out as in MuJoCo Menagerie: ``model.xml``, ``scene.xml``, ``README.md`` with the
sources, ``CHANGELOG.md``.
"""

import textwrap
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.friction.model import StickingModel, sticking_tree
from stiction_envs.friction.parameters import FrictionParameters, friction_sources
from stiction_envs.friction.sticking import (
    Friction,
    Robot,
    friction_origin,
    model_sha256,
    sticking_model,
)
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.markdown import aligned, table_text
from stiction_envs.reporting.provenance import Provenance, provenance
from stiction_envs.reporting.result import Result
from stiction_envs.reporting.templates import render
from stiction_envs.robots.arm_toml import read_toml
from stiction_envs.robots.mjcf import numbers
from stiction_envs.robots.registry import ARMS, arm_title
from stiction_envs.robots.stated import BRISTLE_STIFFNESS, COULOMB, STICTION
from stiction_envs.version import __version__

Kind = Literal["dcmotor", "frictionloss"]
"""How a model carries dry friction: a LuGre bristle, or MuJoCo's soft constraint."""
MotorInput = Literal["ff", "voltage"]
"""Input of a ``dcmotor`` whose control is joint torque. Newton takes ``voltage`` only."""
WINDING = "1e-06"
"""Torque constant [N·m/A] and resistance [Ω] of a motor whose voltage is its torque: the ratio is
1, and what the back-EMF damps, their product over it, is 1e-6 N·m·s/rad (assumed to be nothing)."""
HARDEST = {"solreffriction": "{:g} 1", "solimpfriction": "0.9999 0.9999 0.001"}
"""``frictionloss`` that creeps least without `NOSLIP`: MuJoCo's largest impedance, and the shortest
time constant that a step allows, twice its length (benchmarks/engines/engines.md)."""
NOSLIP = 5
"""Iterations of MuJoCo's noslip solver, which then leaves a creep under 1e-12 rad/s (the same)."""

TEMPLATE = Path(__file__).parent / "templates" / "model.txt.j2"
INDENT = " " * 5


def plain_mjcf(
    sticking: StickingModel, *, friction_name: str, kind: Kind = "dcmotor", motor: MotorInput = "ff"
) -> str:
    """Return MJCF with all digits (``MjSpec.to_xml`` writes six) that compiles to the same model.

    Args:
        sticking: the model.
        friction_name: name of the friction in the comment at the top.
        kind: element that carries dry friction; ``frictionloss`` has the breakaway torque.
        motor: input of the ``dcmotor``.

    Raises:
        StictionError: MuJoCo does not read the text.
    """
    arm, model = sticking.arm, sticking.model
    own = sticking.parameters
    root = sticking_tree(arm, own, sticking.bristle_damping_of(own), sticking.timestep)
    joints = {j.get("name"): j for j in root.iter("joint")}
    motors = list(root.iter("dcmotor"))
    for name, limit, element in zip(arm.joint_names, arm.limits.torque, motors, strict=True):
        if kind == "frictionloss":
            element.tag, element.attrib = "motor", {"name": f"{name}_torque", "joint": name}
            actuator = model.actuator(f"{name}_torque").id
            level = repr(float(model.actuator_biasprm[actuator, STICTION]))
            joints[name].set("frictionloss", level)
            for key, value in HARDEST.items():
                joints[name].set(key, value.format(2 * sticking.timestep))
        elif motor != "ff":
            element.attrib |= {"input": motor, "motorconst": WINDING, "resistance": WINDING}
        if np.isfinite(limit):
            element.set("ctrlrange", numbers([-float(limit), float(limit)]))
    if kind == "frictionloss":
        option = root.find("option")
        assert option is not None
        option.set("noslip_iterations", str(NOSLIP))
    rest = np.zeros(model.nq)
    rest[sticking.motor] = arm.rest
    keys = ET.SubElement(root, "keyframe")
    ET.SubElement(keys, "key", name="home", qpos=numbers(rest))

    arm.carry_into(root)

    bias = model.actuator_biasprm[sticking.torque_actuator]
    bristle = model.actuator_dynprm[sticking.torque_actuator, BRISTLE_STIFFNESS]
    words = render(
        TEMPLATE,
        name=arm.name,
        friction=friction_name,
        kind=kind,
        motor=motor,
        timestep=f"{sticking.timestep:g}",
        presliding=f"{float((bias[:, STICTION] / bristle).max()):.2g}",
        stribeck=f"{float((bias[:, STICTION] / bias[:, COULOMB]).max() - 1):.0%}",
        offsets=bool(own.offset.any() or own.gravity_error.any()),
        springs=bool(arm.stated.stiffness.any()),
    )
    paragraphs = words.replace("--", "- -").strip().split("\n\n")
    wrap = textwrap.TextWrapper(
        100, initial_indent=INDENT, subsequent_indent=INDENT, break_on_hyphens=False
    )
    comment = "\n".join(wrap.fill(p) for p in paragraphs)
    return mjcf_text(root, f" {comment.strip()} ", f"{arm.name}: cannot be exported")


def mjcf_text(root: ET.Element, comment: str, wrong: str) -> str:
    """Return a tree as text below a comment.

    Raises:
        StictionError: MuJoCo does not read it, beginning with ``wrong``.
    """
    ET.indent(root)
    comment = comment.replace("--", "- -")
    text = f"<!--{comment}-->\n{ET.tostring(root, encoding='unicode')}\n"
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise StictionError(f"{wrong}: {error}") from None
    return text


JOINTS = ("joint", "stiction [N·m]", "Coulomb [N·m]", "gear")
TEMPLATES = Path(__file__).with_name("templates")
SOURCES = ("model.toml", "friction.toml")
"""Files that hold the friction of an earlier run; the first that exists is used."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ExportedModel(Result):
    """Plain MJCF, and the model from which it was made."""

    sticking: StickingModel
    xml: str
    kind: Kind  # Element that carries the dry friction
    motor: MotorInput  # Input of the ``dcmotor``
    origin: Path | FrictionParameters  # Where the friction is from
    provenance: Provenance

    def to_json(self) -> dict[str, list[dict[str, Any]]]:
        """Return friction [N·m] of every joint, and whether it is elastic."""
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
        """Write ``model.xml``, ``scene.xml``, ``README.md`` and ``CHANGELOG.md``."""
        write_text_atomic(folder / "model.xml", self.xml)
        for name, template in (
            ("scene.xml", "scene.xml.j2"),
            ("README.md", "readme.md.j2"),
            ("CHANGELOG.md", "changelog.md.j2"),
        ):
            write_text_atomic(folder / name, render(TEMPLATES / template, **self._words()))

    def _words(self) -> dict[str, object]:
        """Return the values of the templates."""
        arm, rows = self.sticking.arm, self.to_json()["joints"]
        files = ARMS.get(str(arm.registered_name))
        sources = {} if files is None else read_toml(files.toml).get("sources", {})
        found, _ = friction_sources(self.origin)
        return {
            "name": arm.name,
            "title": arm_title(arm.name),
            "version": __version__,
            "kind": self.kind,
            "motor": self.motor if self.kind == "dcmotor" else "",
            "joints": table_text(JOINTS, self._cells()),
            "elastic": any(r["elastic"] for r in rows),
            "model": f"`{arm.name}` of stiction-envs" if files else f"a user's file, `{arm.name}`",
            "arm_sources": [f"{key}: {value}" for key, value in sources.items()],
            "friction": _origin_name(self.origin),
            "friction_sources": [f"{key}: {value}" for key, value in found.items()],
        }

    def __repr__(self) -> str:
        return f"<ExportedModel of {self.sticking.arm.name}, {self.sticking.n} joints>"

    def __str__(self) -> str:
        return aligned(JOINTS, self._cells())

    def _cells(self) -> list[list[str]]:
        """Return a row of `JOINTS` per joint."""
        return [
            [
                r["name"],
                f"{r['stiction_nm']:.4f}",
                f"{r['coulomb_nm']:.4f}",
                "elastic" if r["elastic"] else "rigid",
            ]
            for r in self.to_json()["joints"]
        ]


def _origin_name(origin: Path | FrictionParameters) -> str:
    return origin.name if isinstance(origin, Path) else "an arm with its friction"


def export(
    robot: Robot,
    friction: Friction | None = None,
    *,
    kind: Kind | None = None,
    motor: MotorInput | None = "ff",
) -> ExportedModel:
    """Return an arm with its friction as plain MJCF.

    Args:
        robot: name, model file, arm, or an arm with its friction (`load_model`).
        friction: of one arm, or its TOML; None for the robot's friction.
        kind: what carries the dry friction; None for ``dcmotor`` where it can.
        motor: input of the ``dcmotor`` that an engine takes; None: it takes none.

    Raises:
        StictionError: an arm or friction that cannot be loaded, or that do not match; a
            ``dcmotor`` for an engine that takes none.
    """
    if kind is None:
        kind = "frictionloss" if motor is None else "dcmotor"
    if kind == "dcmotor" and motor is None:
        raise StictionError("the engine has no dcmotor: expected friction frictionloss")
    motor = motor or "ff"
    sticking = sticking_model(robot, friction)
    origin = friction_origin(robot, friction)
    return ExportedModel(
        sticking=sticking,
        xml=plain_mjcf(sticking, friction_name=_origin_name(origin), kind=kind, motor=motor),
        kind=kind,
        motor=motor,
        origin=origin,
        provenance=provenance(
            "export",
            {
                "robot": sticking.arm.name,
                "model_sha256": model_sha256(sticking),
                "kind": kind,
                "motor": motor,
            },
            seed=0,
        ),
    )


def friction_in(folder: Path) -> Path:
    """Return the friction TOML of an earlier run's folder; raise a StictionError if it has none."""
    for name in SOURCES:
        if (folder / name).is_file():
            return folder / name
    raise StictionError(f"{folder}: holds neither {' nor '.join(SOURCES)}")
