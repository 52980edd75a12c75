"""Parts of a URDF that MuJoCo does not read: joint speeds, ``package://`` paths, fixed links.

The ``<mujoco>`` element, such as ``<compiler balanceinertia="true"/>``, stays as the file has it.
"""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

MESHES = (".stl", ".obj", ".msh")
"""Mesh files that MuJoCo reads; others (.dae) are left out and not shown."""


def velocities(root: ET.Element) -> dict[str, float]:
    """Return the positive speed limits of a ``robot`` element by joint name [rad/s]."""
    out = {}
    for joint in root.iter("joint"):
        limit = joint.find("limit")
        speed = math.nan if limit is None else float(limit.get("velocity", "nan"))
        if 0 < speed < math.inf:
            out[joint.get("name", "")] = speed
    return out


def prepare(root: ET.Element, path: Path) -> str:
    """Return URDF text that MuJoCo reads without fusing fixed links and with absolute mesh paths.

    ``root`` is changed in place; meshes are looked for next to its ``path`` and in the folders
    above.
    """
    options = root.find("mujoco")
    options = ET.SubElement(root, "mujoco") if options is None else options
    compiler = options.find("compiler")
    compiler = ET.SubElement(options, "compiler") if compiler is None else compiler
    meshes = compiler.attrib.pop("meshdir", "")
    for link in root.iter("link"):
        for kind in ("visual", "collision"):
            for shape in link.findall(kind):
                mesh = shape.find("geometry/mesh")
                if mesh is None:
                    continue
                found = _find(mesh.get("filename", ""), path, meshes)
                if found is None:
                    link.remove(shape)
                else:
                    mesh.set("filename", str(found))
    # Fused links would merge the base into the world, where it could not be tilted.
    compiler.attrib |= {"fusestatic": "false", "strippath": "false", "discardvisual": "false"}
    return ET.tostring(root, encoding="unicode")


def _find(name: str, path: Path, meshes: str) -> Path | None:
    """Return the mesh ``name`` of the URDF at ``path`` with ``meshdir`` ``meshes``, or None."""
    tail = name.removeprefix("package://").removeprefix("file://")
    if Path(tail).suffix.lower() not in MESHES:
        return None
    places = [Path(tail)] if Path(tail).is_absolute() else []
    places += [path.parent / meshes / tail, path.parent / meshes / Path(tail).name]
    inner = Path(*Path(tail).parts[1:]) if name.startswith("package://") else Path(tail)
    for folder in path.resolve().parents:
        places += [folder / tail, folder / inner]
    return next((p for p in places if p.is_file()), None)
