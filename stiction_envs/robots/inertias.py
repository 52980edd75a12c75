"""Identified inertias put into an arm, so that plant, experiments and exports use them."""

import dataclasses
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from stiction_envs.errors import StictionError, checked_array
from stiction_envs.robots import Arm, mjcf
from stiction_envs.robots.regressor import (
    consistent,
    from_pseudo_inertia,
    inertial_parameters,
    pseudo_inertia,
)

CARRIED = 1e-3
"""Mass of a body that holds a link's gravity compensation, over the largest for which the rest of
the link exists [-]; assumed: any far below 1 and far above rounding gives the same motion."""


def with_inertias(arm: Arm, phi: ArrayLike) -> Arm:
    """Return an arm with other inertias; those of bodies fixed to a link are included in it.

    The gravity compensation of the robot's file carries the weight that it carried before: MuJoCo
    scales it with a body's mass, so a small body of each link holds it. ``phi`` (n, 10) are the
    links' parameters about their joints, as `inertial_parameters`.

    Raises:
        StictionError: parameters of another number of links, or physically inconsistent ones.
    """
    p = checked_array(phi, "inertias", (arm.n, 10))
    impossible = np.flatnonzero(~consistent(p))
    if len(impossible):
        names = ", ".join(arm.link_names[i] for i in impossible)
        raise StictionError(
            f"inertias of {names} are physically inconsistent: expected a positive mass and a "
            "positive-definite pseudo-inertia"
        )
    root = ET.fromstring(arm.xml)
    bodies = {b.get("name"): b for b in root.iter("body")}
    carried, shares = np.zeros_like(p), {}
    if arm.stated.gravcomp:
        carried = inertial_parameters(arm.pinocchio(compensated=True))
    for name, own, weight in zip(arm.link_names, p, carried, strict=True):
        body = bodies[name]
        _strip(body)
        joint = body.find("joint")
        at = np.zeros(3) if joint is None else mjcf.read_numbers(joint, "pos", (0.0, 0.0, 0.0))
        if weight[0]:
            j, centre = pseudo_inertia(own), np.append(weight[1:4] / weight[0], 1.0)
            held = CARRIED / float(centre @ np.linalg.solve(j, centre))
            own = from_pseudo_inertia(j - held * np.outer(centre, centre))
            holder = _holder(body, f"{name}_gravcomp")
            shares[holder.get("name", "")] = float(weight[0]) / held
            point = {"pos": mjcf.numbers(centre[:3] + at), "mass": repr(held)}
            ET.SubElement(holder, "inertial", point | {"diaginertia": "0 0 0"})
        link = pin.Inertia.FromDynamicParameters(own)
        mass, i = repr(float(link.mass)), link.inertia
        element = ET.Element("inertial", pos=mjcf.numbers(link.lever + at), mass=mass)
        full = (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
        element.set("fullinertia", mjcf.numbers(full))
        body.insert(0, element)
    stated = dataclasses.replace(arm.stated, gravcomp=shares)
    return dataclasses.replace(arm, xml=ET.tostring(root, encoding="unicode"), stated=stated)


def _holder(body: ET.Element, name: str) -> ET.Element:
    """Return the fixed body of a name in a link's body, made if it is not there."""
    found = [x for x in body.findall("body") if x.get("name") == name]
    return found[0] if found else ET.SubElement(body, "body", name=name)


def _strip(body: ET.Element) -> None:
    """Remove the inertia of a body and of all bodies fixed to it."""
    for old in body.findall("inertial"):
        body.remove(old)
    for child in body.findall("body"):
        if child.find("joint") is None:
            _strip(child)
