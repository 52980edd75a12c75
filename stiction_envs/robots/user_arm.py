"""Read a rigid serial arm from a user's MJCF or URDF.

Limits, a rest pose and the physics of the joints (`stated`) are read first. Then everything that is
not the rigid arm is removed: actuators, sensors, tendons, equalities, keyframes, joint damping,
armature, springs and dry friction, gravity compensation, and slides, whose links stay as rigid mass
where the robot rests. Of a bigger robot all joints outside one arm are locked (`chain`).
"""

import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Index
from stiction_envs.errors import StictionError
from stiction_envs.robots import mjcf, urdf
from stiction_envs.robots.arm_toml import (
    Limits,
    Table,
    check_range,
    generic,
    hand_yaw,
    lookup,
    on_floor,
    per_joint,
    read_toml,
)
from stiction_envs.robots.chain import (
    Chain,
    balance_inertias,
    chain_title,
    compile_spec,
    lock_other_joints,
    lock_slides,
    one_line,
    rest_key,
    suggest_chains,
)
from stiction_envs.robots.mjcf import free_name
from stiction_envs.robots.overlapping_links import exclude_overlapping
from stiction_envs.robots.stated import URDF_TAGS, read_stated, refuse_constraints

JOINTS = (1, 9)  # smallest and largest number of hinges of an arm [-] (assumed)

CHAIN_JOINTS = 2
"""Smallest number of hinges of an arm that is suggested in a bigger robot [-] (assumed)."""

FLANGE_NAMES = ("flange", "attachment_site", "tool0", "tcp", "end_effector", "ee", "link8")
"""Names of sites or links that are taken for the flange, most likely first; also after ``_``."""

_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


def read_user_arm(path: Path, chain: Chain | None = None) -> Table:
    """Return fields of an ``Arm`` from a user's MJCF or URDF, and a TOML of the same stem.

    ``chain`` are the links at the base and the tip of the arm, in a file of a bigger robot.

    Raises:
        StictionError: not readable, or not one serial chain of 1 to 9 hinges with massive links.
    """
    spec, speeds, changed, left = _named(path)
    before, end = spec.copy(), None
    try:
        if chain is None:
            whole = compile_spec(spec, path)
        else:
            end, whole = lock_other_joints(spec, chain, path)
        model = whole if chain is None else compile_spec(spec, path)
        held = lock_slides(spec, model)
        model = compile_spec(spec, path) if held else model
        hinges = _hinges(model, path)
    except StictionError as error:
        hint = "" if chain else suggest_chains(_named(path)[0], (CHAIN_JOINTS, JOINTS[1]))
        raise StictionError(f"{error}{hint}") from None
    joints = tuple(model.joint(int(j)).name for j in hinges)
    links = tuple(model.body(int(model.jnt_bodyid[j])).name for j in hinges)
    n = len(joints)
    left += refuse_constraints(whole, joints, path)
    locked = [whole.joint(j).name for j in range(whole.njnt) if whole.joint(j).name not in joints]
    if locked:
        changed.append(f"joints held still: {', '.join(locked)}")
    stated = read_stated(whole, joints, held, changed, left)

    table_file = path.with_suffix(".toml")
    table = read_toml(table_file) if table_file.is_file() else {}
    carried = {mjcf.CARRIED[x.name]: list(x.data) for x in spec.numerics if x.name in mjcf.CARRIED}

    def choose(
        key: str,
        unit: str,
        in_model: ArrayLike | None = None,
        *,
        shape: tuple[int, ...] = (n,),
        low: float = -np.inf,
        allow_inf: bool = False,
    ) -> Array:
        """Return the TOML's numbers, else the model's custom ones, its joints', or the default."""
        given = lookup(table, key)
        where = f"{path if given is None else table_file}, {key}"
        default = lookup(generic(), key) if in_model is None else in_model
        out = per_joint(carried.get(key, default) if given is None else given, shape, where)
        check_range(out, unit, where, low=low, allow_inf=allow_inf)
        return out

    keys = ("smallest", "limits.velocity", "limits.position")
    least, speed, half = (lookup(generic(), key) for key in keys)
    limited = model.jnt_limited[hinges].astype(bool)
    ranges = np.where(limited[:, None], model.jnt_range[hinges], (-half, half))
    fastest = [speeds.get(name, speed) for name in joints]
    limits = Limits(
        position=choose("limits.position", "rad", ranges, shape=(n, 2)),
        velocity=choose("limits.velocity", "rad/s", fastest, low=least),
        torque=choose("limits.torque", "N·m", _torques(model, hinges), low=least),
        torque_rate=choose("limits.torque_rate", "N·m/s", low=least, allow_inf=True),
    )
    rate, cutoff = (
        float(choose(f"interface.{key}", "Hz", shape=(), low=low))
        for key, low in (("controller_rate_hz", least), ("lowpass_hz", 0.0))
    )
    rest = choose("rest", "rad", _rest(model, hinges, limits.position))
    root, end_effector = _rigid_xml(spec, model, hinges, path, end)
    exclude_overlapping(root, limits.position)
    if chain is not None:
        every = [j.name for j in before.joints if int(j.type) in (_HINGE, _SLIDE)]
        custom = ET.SubElement(root, "custom")
        ET.SubElement(custom, "text", name=mjcf.WHOLE, data="\n".join(every))
    return {
        "name": chain_title(path.stem, chain),
        "xml": ET.tostring(root, encoding="unicode"),
        "joint_names": joints,
        "link_names": links,
        "end_effector": end_effector,
        "hand_yaw": hand_yaw(table, str(table_file)),
        "limits": limits,
        "rest": rest,
        "controller_rate_hz": rate,
        "lowpass_hz": cutoff,
        "on_floor": on_floor(table, str(table_file)),
        "stated": stated,
    }


def compile_file(path: Path, chain: Chain | None = None) -> mujoco.MjModel:
    """Return the compiled model of a user's file, friction and actuators included.

    ``chain`` are base and tip of the arm whose joints are not locked; None for all.
    """
    spec = _named(path)[0]
    if chain is not None:
        lock_other_joints(spec, chain, path)
    return compile_spec(spec, path)


def _named(path: Path) -> tuple[mujoco.MjSpec, dict[str, float], list[str], list[str]]:
    """Return the file's spec, joint speeds [rad/s] of a URDF, and clauses on changes and gaps.

    Unnamed bodies and joints get a name, so that XML and compiled model can be matched.
    """
    speeds: dict[str, float] = {}
    left: list[str] = []
    try:
        root = ET.parse(path).getroot()
        if root.tag == "robot":
            speeds = urdf.velocities(root)
            left = [f"<{tag}>" for tag in URDF_TAGS if root.find(f".//{tag}") is not None]
            spec = mujoco.MjSpec.from_string(urdf.prepare(root, path))
        else:
            spec = mujoco.MjSpec.from_file(str(path))
    except (ET.ParseError, ValueError, OSError) as error:
        raise StictionError(f"{path}: not a readable MJCF or URDF: {one_line(error)}") from None
    for kind, items in (("link", spec.bodies[1:]), ("joint", spec.joints)):
        taken = {item.name for item in items}
        for i, item in enumerate(items):
            if not item.name:
                item.name = free_name(f"{kind}{i + 1}", taken)
                taken.add(item.name)
    return spec, speeds, balance_inertias(spec), left


def _above(model: mujoco.MjModel, body: int) -> list[int]:
    """Return ``body`` and the bodies between it and the world, tip to base."""
    out = []
    while body:
        out.append(body)
        body = int(model.body_parentid[body])
    return out


def _hinges(model: mujoco.MjModel, path: Path) -> Index:
    """Return the ids of the hinges, base to tip; raise if they are not one serial chain."""
    for j in range(model.njnt):
        if int(model.jnt_type[j]) not in (_HINGE, _SLIDE):
            kind = mujoco.mjtJoint(model.jnt_type[j]).name.removeprefix("mjJNT_").lower()
            raise StictionError(
                f"{path}: joint {model.joint(j).name!r} is a {kind} joint: expected hinges only"
            )
    # Ids grow from parent to child, so within one chain they are already in order.
    hinges = np.flatnonzero(model.jnt_type == _HINGE)
    low, high = JOINTS
    if not low <= len(hinges) <= high:
        raise StictionError(f"{path}: {len(hinges)} hinge joints: expected {low} to {high}")
    bodies = model.jnt_bodyid[hinges]
    for one, two in pairwise(hinges):
        if model.jnt_bodyid[one] == model.jnt_bodyid[two]:
            link = model.body(int(model.jnt_bodyid[one])).name
            raise StictionError(f"{path}: link {link!r} has two joints: give each its own link")
        if int(model.jnt_bodyid[one]) not in _above(model, int(model.jnt_bodyid[two])):
            raise StictionError(
                f"{path}: the chain branches: joint {model.joint(int(two)).name!r} is not behind "
                f"joint {model.joint(int(one)).name!r}"
            )
    tip = int(bodies[-1])
    for slide in np.flatnonzero(model.jnt_type == _SLIDE):
        body = int(model.jnt_bodyid[slide])
        if body == tip or tip not in _above(model, body):
            raise StictionError(
                f"{path}: slide joint {model.joint(int(slide)).name!r} is not behind the last "
                "hinge: only fingers may slide"
            )
    for hinge in hinges:
        if model.qpos0[model.jnt_qposadr[hinge]] != 0:
            raise StictionError(
                f"{path}: joint {model.joint(int(hinge)).name!r} has a ref angle: "
                "draw the arm at zero angles instead"
            )
    return hinges


def _torques(model: mujoco.MjModel, chain: Index) -> list[float]:
    """Return the largest torque of each hinge [N·m]: the least limit of joint and actuators."""
    out = []
    for j in chain:
        found = []
        if model.jnt_actfrclimited[j]:
            found.append(np.abs(model.jnt_actfrcrange[j]).max())
        for a in range(model.nu):
            kind = mujoco.mjtTrn(model.actuator_trntype[a])
            if kind != mujoco.mjtTrn.mjTRN_JOINT or model.actuator_trnid[a, 0] != j:
                continue
            gear = abs(model.actuator_gear[a, 0])
            if model.actuator_forcelimited[a]:
                found.append(gear * np.abs(model.actuator_forcerange[a]).max())
            elif (
                model.actuator_ctrllimited[a]
                and model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE
                and model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED
            ):
                # A motor: its control is a torque. A position servo's is an angle.
                gain = abs(model.actuator_gainprm[a, 0])
                found.append(gear * gain * np.abs(model.actuator_ctrlrange[a]).max())
        found = [float(f) for f in found if f > 0]
        out.append(min(found) if found else lookup(generic(), "limits.torque"))
    return out


def _rest(model: mujoco.MjModel, chain: Index, position: Array) -> Array:
    """Return the rest pose [rad]: keyframe ``home``, the first one, zero, or mid-range.

    Zero only where it is a twentieth of the range (assumed) or more away from both ends: an arm
    that rests against a stop cannot follow a path.
    """
    low, high = position.T
    key = rest_key(model)
    if key is not None:
        return np.clip(key[model.jnt_qposadr[chain]], low, high)
    least = (high - low) / 20
    return np.where((low <= -least) & (high >= least), 0.0, (low + high) / 2)


def _absolute_assets(spec: mujoco.MjSpec) -> None:
    """Make file paths absolute, so that the text works from any folder."""
    here = Path(spec.modelfiledir or ".").resolve()
    kinds = ((spec.meshes, spec.meshdir), (spec.hfields, spec.meshdir))
    for items, folder in (*kinds, (spec.textures, spec.texturedir)):
        for item in items:
            if item.file:
                item.file = str(here / (folder or "") / item.file)
    spec.meshdir = spec.texturedir = ""


def _known(names: list[str]) -> str | None:
    """Return the first of ``names`` that is a usual flange name, or ends on ``_`` and one."""
    found = (x for end in FLANGE_NAMES for x in names if f"_{x.lower()}".endswith(f"_{end}"))
    return next(found, None)


def _flange(
    spec: mujoco.MjSpec, model: mujoco.MjModel, tip: int, fingers: set[int]
) -> tuple[str, str | None]:
    """Return the flange's site name, and the body that needs it if the site is new.

    A well-known site name on the last link or a body fixed to it wins, then a fixed link of such a
    name (URDF), then any site of the last link, then the last link's own frame.
    """
    tail = [
        b
        for b in range(1, model.nbody)
        if tip in _above(model, b) and not fingers & set(_above(model, b))
    ]
    sites = [
        s for s in range(model.nsite) if int(model.site_bodyid[s]) in tail and model.site(s).name
    ]
    known = _known([model.site(s).name for s in sites])
    if known is not None:
        return known, None
    new = free_name("flange", {site.name for site in spec.sites})
    known = _known([model.body(b).name for b in tail])
    if known is not None:
        return new, known
    on_tip = [s for s in sites if int(model.site_bodyid[s]) == tip]
    if on_tip:
        return model.site(on_tip[0]).name, None
    return new, model.body(tip).name


def _rigid_xml(
    spec: mujoco.MjSpec, model: mujoco.MjModel, chain: Index, path: Path, end: str | None
) -> tuple[ET.Element, str]:
    """Return MJCF of the bare rigid arm with all digits, and the name of its flange site."""
    fingers = {int(model.jnt_bodyid[j]) for j in np.flatnonzero(model.jnt_type == _SLIDE)}
    tip = int(model.jnt_bodyid[chain[-1]])
    end_effector, add_to = (end, None) if end else _flange(spec, model, tip, fingers)
    if add_to is not None:
        spec.body(add_to).add_site(name=end_effector)
    for kind in ("actuators", "sensors", "tendons", "equalities", "keys", "tuples", "skins"):
        for item in list(getattr(spec, kind)):
            spec.delete(item)
    keep = {model.joint(int(j)).name for j in chain}
    for joint in list(spec.joints):
        if joint.name not in keep:
            spec.delete(joint)
    _absolute_assets(spec)
    # The compiled model has the numbers that to_xml rounds or leaves to defaults and frames.
    model = compile_spec(spec, path)
    root = ET.fromstring(spec.to_xml())
    for section in ("option", "size", "custom", "extension", "deformable", "keyframe"):
        for child in root.findall(section):
            root.remove(child)
    for child in root.findall("compiler"):
        child.attrib.clear()
        child.attrib.update(angle="radian", autolimits="true")
    gravity = mjcf.numbers(model.opt.gravity)
    root.insert(1, ET.Element("option", gravity=gravity, timestep="0.001"))
    for default in root.iter("default"):
        for joint in default.findall("joint"):
            default.remove(joint)
    mjcf.bodies_out_of_frames(root)
    for body in root.iter("body"):
        _exact(body, model, keep)
    return root, end_effector


def _exact(body: ET.Element, model: mujoco.MjModel, joints: set[str]) -> None:
    """Rewrite pose, inertia, joint and named sites of one body from the compiled model."""
    found = model.body(body.get("name"))
    for key in ("euler", "axisangle", "xyaxes", "zaxis", "gravcomp"):
        body.attrib.pop(key, None)
    body.set("pos", mjcf.numbers(found.pos))
    body.set("quat", mjcf.numbers(found.quat))
    for old in [*body.findall("inertial"), *body.findall("joint")]:
        body.remove(old)
    for geom in body.iter("geom"):
        geom.attrib.pop("density", None)
        geom.set("mass", "0")
    front = []
    for j in range(model.njnt):
        joint = model.joint(j)
        if int(model.jnt_bodyid[j]) == found.id and joint.name in joints:
            element = ET.Element("joint", name=joint.name, type="hinge")
            element.set("pos", mjcf.numbers(joint.pos))
            element.set("axis", mjcf.numbers(joint.axis))
            if model.jnt_limited[j]:
                element.set("range", mjcf.numbers(joint.range))
            front.append(element)
    mass = float(found.mass[0])
    if mass > 0:
        inertial = ET.Element("inertial", mass=repr(mass), pos=mjcf.numbers(found.ipos))
        inertial.set("quat", mjcf.numbers(found.iquat))
        inertial.set("diaginertia", mjcf.numbers(found.inertia))
        front.append(inertial)
    for element in reversed(front):
        body.insert(0, element)
    for site in body.findall("site"):
        if site.get("name"):
            at = model.site(site.get("name"))
            site.set("pos", mjcf.numbers(at.pos))
            site.set("quat", mjcf.numbers(at.quat))
