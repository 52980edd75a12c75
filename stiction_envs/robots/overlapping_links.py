"""Links of a user's arm that touch in every pose: their shapes overlap, they do not collide.

MoveIt's set-up assistant excludes such pairs in the same way: by poses drawn at random.
"""

import xml.etree.ElementTree as ET
from collections import Counter

import mujoco
import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.precomputed import store

POSES = 200  # poses that are drawn [-] (assumed)
SHARE = 0.95
"""Least share of poses in which a pair touches that is excluded [-] (MoveIt's default: 0.95)."""


def exclude_overlapping(root: ET.Element, position: Array) -> None:
    """Exclude contacts of links that touch in (nearly) all poses, in place.

    Poses are drawn from the ranges ``position`` (n, 2) [rad].
    """
    text = ET.tostring(root, encoding="unicode")
    of = store.digest(text, position, POSES, SHARE)
    found = store.recall("touching", of)
    if not found:
        model = mujoco.MjModel.from_xml_string(text)
        found = {"bodies": [list(pair) for pair in _overlapping(model, position)]}
        store.keep("touching", of, found)
    if not found["bodies"]:
        return
    model, contact = mujoco.MjModel.from_xml_string(text), root.find("contact")
    contact = ET.SubElement(root, "contact") if contact is None else contact
    for pair in found["bodies"]:
        one, two = (model.body(int(body)).name for body in pair)
        ET.SubElement(contact, "exclude", name=f"touching {one} {two}", body1=one, body2=two)


def excluded_pairs(xml: str) -> list[tuple[str, str]]:
    """Return the pairs that `exclude_overlapping` excluded in an MJCF."""
    excluded = ET.fromstring(xml).iter("exclude")
    mine = [e for e in excluded if e.get("name", "").startswith("touching ")]
    return [(e.get("body1", ""), e.get("body2", "")) for e in mine]


def _overlapping(model: mujoco.MjModel, position: Array) -> list[tuple[int, int]]:
    """Return the ids of the bodies of such pairs."""
    data, count = mujoco.MjData(model), Counter[tuple[int, int]]()
    low, high = position.T
    for q in np.random.default_rng(0).uniform(low, high, (POSES, model.nq)):
        data.qpos[:] = q
        mujoco.mj_fwdPosition(model, data)
        bodies = np.sort(model.geom_bodyid[data.contact.geom], axis=1)
        count.update({(int(a), int(b)) for a, b in bodies})
    return sorted(pair for pair, k in count.items() if k >= SHARE * POSES)
