"""Edits of MJCF text that lose no digits (``MjSpec.to_xml`` writes six)."""

import xml.etree.ElementTree as ET
from collections.abc import Container, Iterable

import numpy as np


def numbers(values: Iterable[float]) -> str:
    """Return numbers as an MJCF attribute, with all digits of a float64."""
    return " ".join(repr(float(v)) for v in values)


def parents(root: ET.Element) -> dict[ET.Element, ET.Element]:
    """Return the parent of every element below ``root``."""
    return {child: parent for parent in root.iter() for child in parent}


def read_numbers(element: ET.Element, key: str, default: tuple[float, ...]) -> np.ndarray:
    """Return attribute ``key`` of ``element`` as float64 array; ``default`` if it is missing."""
    text = element.get(key)
    return np.array(default if text is None else [float(v) for v in text.split()])


CARRIED = {
    "stiction_velocity_limits": "limits.velocity",
    "stiction_torque_limits": "limits.torque",
    "stiction_torque_rate_limits": "limits.torque_rate",
    "stiction_rest": "rest",
}
"""Custom numbers of an MJCF for what its joints and actuators cannot hold, by key of an arm's TOML:
an arm that is written and read again keeps them (`Arm.carry_into`)."""


WHOLE = "stiction_whole_robot"
"""Custom text of an MJCF: the joints of the robot that the arm is a chain of, one a line."""


def free_name(name: str, taken: Container[str | None]) -> str:
    """Return a name that is not taken, with ``_`` appended where needed."""
    while name in taken:
        name += "_"
    return name


def tilt_base(root: ET.Element, first_link: str, tilt: tuple[float, float]) -> None:
    """Turn the top-level body that holds ``first_link`` about its own origin, in place.

    ``tilt`` is roll about the world's x, then pitch about the world's y [rad]. Gravity stays.
    """
    # scipy.spatial takes longer to import than an arm to load
    from scipy.spatial.transform import Rotation

    up = parents(root)
    body = next(b for b in root.iter("body") if b.get("name") == first_link)
    while up[body].tag != "worldbody":
        body = up[body]
    quat = read_numbers(body, "quat", (1.0, 0.0, 0.0, 0.0))
    # Extrinsic "xy": roll first, then pitch about the fixed y axis, i.e. R_y(pitch) R_x(roll).
    turned = Rotation.from_euler("xy", tilt) * Rotation.from_quat(quat, scalar_first=True)
    body.set("quat", numbers(turned.as_quat(scalar_first=True)))


def add_payload(
    root: ET.Element, site: str, payload: tuple[float, float, float, float], radius: float
) -> None:
    """Fix a point mass to the flange, in place.

    ``payload`` is mass [kg] and centre of mass x, y, z [m] in the frame of ``site``; ``radius`` [m]
    is that of the solid sphere that lends the mass its inertia 2/5·m·r².
    """
    mass, *com = payload
    flange = next(s for s in root.iter("site") if s.get("name") == site)
    name = free_name("payload", {b.get("name") for b in root.iter("body")})
    body = ET.SubElement(parents(root)[flange], "body", name=name)
    for key in ("pos", "quat"):
        if flange.get(key) is not None:
            body.set(key, str(flange.get(key)))
    inertia = numbers([0.4 * mass * radius**2] * 3)
    ET.SubElement(body, "inertial", pos=numbers(com), mass=repr(mass), diaginertia=inertia)
    shape = {"type": "sphere", "pos": numbers(com), "size": repr(radius), "mass": "0", "group": "2"}
    look = {"contype": "0", "conaffinity": "0", "rgba": "0.85 0.45 0.1 1"}
    ET.SubElement(body, "geom", shape | look)


def bodies_out_of_frames(root: ET.Element) -> None:
    """Lift bodies, joints and sites out of ``frame`` elements; geometry stays in its frame.

    The caller must rewrite their poses afterwards: poses of a compiled model include the frame.
    """
    moved = True
    while moved:
        moved = False
        up = parents(root)
        for frame in list(root.iter("frame")):
            home = up[frame]
            for child in list(frame):
                if child.tag in ("body", "joint", "site"):
                    frame.remove(child)
                    home.append(child)
                    style = frame.get("childclass")
                    if style is not None and child.tag == "body" and not child.get("childclass"):
                        child.set("childclass", style)
                    moved = True


def skeleton(root: ET.Element) -> ET.Element:
    """Copy of ``root`` with bodies, inertia, joints and sites only, as pinocchio reads it.

    Everything hangs on one more body, "mount": pinocchio 4.1 ignores pos and quat of a jointless
    top-level body, so a tilted base would stand upright.
    """
    copy = _bare(root)
    for world in copy.findall("worldbody"):
        content = list(world)
        for child in content:
            world.remove(child)
        ET.SubElement(world, "body", name="mount").extend(content)
    return copy


def _bare(element: ET.Element) -> ET.Element:
    keep = {"compiler", "option", "worldbody", "body", "inertial", "joint", "site"}
    copy = ET.Element(element.tag, element.attrib)
    # Classes carry looks only, and their defaults are gone here.
    for key in ("class", "childclass"):
        copy.attrib.pop(key, None)
    copy.extend(_bare(child) for child in element if child.tag in keep)
    return copy
