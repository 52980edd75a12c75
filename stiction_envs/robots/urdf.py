"""Parts of a URDF that MuJoCo does not read: joint speeds, ``package://`` paths, fixed links."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

MESHES = (".stl", ".obj", ".msh")
"""Mesh files that MuJoCo reads; others (.dae) are left out and not shown."""


def velocities(root: ET.Element) -> dict[str, float]:
    """Speed limits of a ``robot`` element by joint name, rad/s; only those that are positive."""
    out = {}
    for joint in root.iter("joint"):
        limit = joint.find("limit")
        text = limit.get("velocity") if limit is not None else None
        if text is None:
            continue
        speed = float(text)
        if math.isfinite(speed) and speed > 0:
            out[joint.get("name", "")] = speed
    return out


def prepare(root: ET.Element, path: Path) -> str:
    """URDF text that MuJoCo reads without fusing fixed links and with absolute mesh paths.

    Args:
        root: the ``robot`` element; changed in place.
        path: file it came from; meshes are looked for next to it and in the folders above.
    """
    for link in root.iter("link"):
        for kind in ("visual", "collision"):
            for shape in link.findall(kind):
                mesh = shape.find("geometry/mesh")
                if mesh is None:
                    continue
                found = _find(mesh.get("filename", ""), path)
                if found is None:
                    link.remove(shape)
                else:
                    mesh.set("filename", str(found))
    for old in root.findall("mujoco"):
        root.remove(old)
    options = ET.SubElement(root, "mujoco")
    # Fused links would merge the base into the world, where it could not be tilted.
    ET.SubElement(options, "compiler", fusestatic="false", strippath="false", discardvisual="false")
    return ET.tostring(root, encoding="unicode")


def _find(name: str, path: Path) -> Path | None:
    """The mesh ``name`` of the URDF at ``path``; None where it is missing or not readable."""
    tail = name.removeprefix("package://").removeprefix("file://")
    if Path(tail).suffix.lower() not in MESHES:
        return None
    places = [Path(tail)] if Path(tail).is_absolute() else []
    inner = Path(*Path(tail).parts[1:]) if name.startswith("package://") else Path(tail)
    for folder in path.resolve().parents:
        places += [folder / tail, folder / inner]
    return next((p for p in places if p.is_file()), None)
