"""One serial arm out of a bigger robot: the joints between a base and a tip stay.

All other joints are locked where the robot rests: at the keyframe ``home`` (else the first), else
at zero, or at the nearer end of a range without zero; a floating base at its place in the file.
Their links keep mass and shape. Other trees of the world that can move are removed.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.robots.mjcf import free_name

Chain = tuple[str, str]
"""Link at the base, which does not move, and link or site at the tip, which is the flange."""

_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_ROUNDING = 1e-14  # by which MuJoCo lets A + B < C of principal moments pass [kg·m²]
_MOST = 6  # arms of a bigger robot that a message names [-] (assumed)


def chain_title(stem: str, chain: Chain | None) -> str:
    """Return the name of an arm: the stem of its file and the ends of its chain."""
    if chain is None:
        return stem
    names = [stem, *chain]
    return "-".join("".join(c if c.isalnum() or c in "-_" else "_" for c in x) for x in names)


def one_line(error: Exception) -> str:
    """Return the text of an error."""
    return "; ".join(line.strip() for line in str(error).splitlines() if line.strip())


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """Return the model of a spec; errors name its file."""
    try:
        return spec.compile()
    except ValueError as error:
        text = one_line(error)
        if "mass and inertia of moving bodies" in text:
            found = re.search(r"name '([^']*)'", text)
            link = found.group(1) if found else "?"
            raise StictionError(f"{path}: moving link {link!r} has no mass or inertia") from None
        raise StictionError(f"{path}: MuJoCo cannot build it: {text}") from None


def lock_other_joints(spec: mujoco.MjSpec, chain: Chain, path: Path) -> tuple[str, mujoco.MjModel]:
    """Lock every joint of a named ``spec`` that is not between base and tip, in place.

    Return the name of the flange site, and the model before any joint was locked.

    Raises:
        StictionError: an unknown name, a tip that is not behind the base, or a joint between them
            that neither turns nor slides.
    """
    base, tip = _ends(spec, chain, path)
    links = [tip, *_above(tip)]
    if base not in [b.name for b in links[1:]]:
        raise StictionError(f"{path}: chain: link {tip.name!r} is not behind link {base!r}")
    links = links[: [b.name for b in links].index(base)]
    for body in links:
        for joint in body.joints:
            if int(joint.type) not in (_HINGE, _SLIDE):
                kind = joint.type.name.removeprefix("mjJNT_").lower()
                raise StictionError(
                    f"{path}: chain: joint {joint.name!r} is a {kind} joint: expected hinges only "
                    "between base and tip"
                )
    kept = {joint.name for body in links for joint in body.joints}
    _drop_other_trees(spec, links[0])
    first = next((body for body in reversed(links) if body.joints), links[0])
    moved = {first.name, *(b.name for b in first.find_all("body"))}
    for body in spec.bodies[1:]:
        if body.explicitinertial and body.name not in moved:
            _make_round(body)
    model = compile_spec(spec, path)
    _lock(spec, model, kept)
    if chain[1] not in {site.name for site in spec.sites}:
        name = free_name("flange", {site.name for site in spec.sites})
        tip.add_site(name=name)
        return name, model
    return chain[1], model


def lock_slides(spec: mujoco.MjSpec, model: mujoco.MjModel) -> set[str]:
    """Hold slides of an arm that are not behind its last hinge, in place; return their names."""
    hinged = {b.name for b in spec.bodies if any(int(j.type) == _HINGE for j in b.joints)}
    held = {
        joint.name
        for joint in spec.joints
        if int(joint.type) == _SLIDE
        and hinged & {joint.parent.name, *(b.name for b in joint.parent.find_all("body"))}
    }
    if held:
        _lock(spec, model, {joint.name for joint in spec.joints} - held)
    return held


def _lock(spec: mujoco.MjSpec, model: mujoco.MjModel, kept: set[str]) -> None:
    """Lock all joints but the kept ones where the robot rests."""
    rest = _rest(model)
    for joint in list(spec.joints):
        if joint.name not in kept:
            _move_to_rest(spec, model, joint, rest)
    _delete_other_joints(spec, model, kept, rest)


def suggest_chains(spec: mujoco.MjSpec, joints: tuple[int, int]) -> str:
    """Return how to choose one arm of a bigger, named robot; empty where there is none.

    An arm is a chain of hinges without a branch; ``joints`` are their least and largest number.
    """
    moving = {body.name: body for body in spec.bodies if body.joints}
    above = {
        name: next((b.name for b in _above(body) if b.joints), "") for name, body in moving.items()
    }
    behind = {name: [x for x in moving if above[x] == name] for name in moving}
    single = {x for x, b in moving.items() if [int(j.type) for j in b.joints] == [_HINGE]}
    found = []
    for first in moving:
        if first not in single or (above[first] in single and len(behind[above[first]]) == 1):
            continue  # not where one begins
        links = [first]
        while len(behind[links[-1]]) == 1 and behind[links[-1]][0] in single:
            links += behind[links[-1]]
        if joints[0] <= len(links) <= joints[1]:
            found.append((len(links), f"{moving[first].parent.name} {links[-1]}"))
    if not found or len(spec.joints) <= joints[0]:
        return ""
    longest, *others = (chain for _, chain in sorted(found, key=lambda x: -x[0])[:_MOST])
    more = f" (or {', '.join(others)})" if others else ""
    return f"; of a bigger robot take one arm: chain {longest}{more}"


def balance_inertias(spec: mujoco.MjSpec) -> list[str]:
    """Balance inertias that no body can have as MuJoCo's ``balanceinertia``; return clauses.

    Principal moments A ≤ B ≤ C with A + B < C become their mean. Bodies that do not move become
    round without a word: their inertia has no effect.
    """
    out = []
    for body in spec.bodies[1:]:
        if not body.explicitinertial:
            continue
        xx, yy, zz, xy, xz, yz = body.fullinertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        a, b, c = np.sort(body.inertia if np.isnan(xx) else np.linalg.eigvalsh(tensor))
        moves = any(x.joints for x in (body, *_above(body)))
        if a + b >= c - _ROUNDING and (a > 0 or moves):
            continue
        if not moves:
            _make_round(body)
        elif a > 0:
            mean = (a + b + c) / 3
            body.fullinertia, body.inertia = np.full(6, np.nan), np.full(3, mean)
            text = f"{a:.4g} {b:.4g} {c:.4g} becomes {mean:.4g} kg·m² about each axis"
            out.append(f"inertia of {body.name} balanced: {text}")
    return out


def _make_round(body: mujoco.MjsBody) -> None:
    """Give a fixed body the inertia of a sphere, which has no effect."""
    body.fullinertia = np.full(6, np.nan)
    body.inertia = np.full(3, max(float(body.mass), 1e-3))  # any consistent one


def _ends(spec: mujoco.MjSpec, chain: Chain, path: Path) -> tuple[str, mujoco.MjsBody]:
    """Return the name of the base and the body of the tip."""
    base, tip = chain
    bodies = {body.name: body for body in spec.bodies}
    sites = {site.name: site.parent for site in spec.sites if site.name}
    for name, known in ((base, bodies), (tip, {**sites, **bodies})):
        if name not in known:
            names = ", ".join(body.name for body in spec.bodies[1:])
            raise StictionError(f"{path}: chain: no link {name!r}: expected one of {names}")
    return base, {**sites, **bodies}[tip]


def _above(body: mujoco.MjsBody) -> Iterator[mujoco.MjsBody]:
    """Return the bodies above one, up to the world."""
    while body.name != "world":
        body = body.parent
        yield body


def _drop_other_trees(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
    """Remove what can move and is not in the same tree of the world as ``body``."""
    own = [body.name, *(b.name for b in _above(body))][-2]
    for other in list(spec.worldbody.bodies):
        moves = bool(other.joints) or any(b.joints for b in other.find_all("body"))
        if other.name != own and moves:
            spec.delete(other)


def rest_key(model: mujoco.MjModel) -> Array | None:
    """Return (nq,) angles of the keyframe ``home``, else of the first; None without any."""
    if not model.nkey:
        return None
    names = [model.key(k).name for k in range(model.nkey)]
    return np.array(model.key_qpos[names.index("home") if "home" in names else 0])


def _rest(model: mujoco.MjModel) -> Array:
    """Return (nq,) where the robot rests."""
    key = rest_key(model)
    if key is not None:
        return key
    out = np.array(model.qpos0)
    for j in np.flatnonzero(model.jnt_limited):
        if int(model.jnt_type[j]) in (_HINGE, _SLIDE):
            at = model.jnt_qposadr[j]
            out[at] = np.clip(out[at], *model.jnt_range[j])
    return out


def _move_to_rest(
    spec: mujoco.MjSpec, model: mujoco.MjModel, joint: mujoco.MjsJoint, rest: Array
) -> None:
    """Move a joint's link to where the joint rests, before the joint is deleted."""
    body, found = joint.parent, model.joint(joint.name)
    kind, at = int(found.type[0]), int(found.qposadr[0])
    by = rest[at] - model.qpos0[at]
    if kind not in (_HINGE, _SLIDE) or by == 0:
        return
    orientation = np.array(body.quat)
    if body.alt.type != mujoco.mjtOrientation.mjORIENTATION_QUAT:
        compiler = body.compiler
        orientation = np.array(
            mujoco.MjSpec.resolve_orientation(
                degree=compiler.degree, sequence=compiler.eulerseq, orientation=body.alt
            )
        )
        body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    orientation /= np.linalg.norm(orientation)
    axis, anchor = np.array(found.axis), np.array(found.pos)
    turn, turned, shift = np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3)
    if kind == _HINGE:
        mujoco.mju_axisAngle2Quat(turn, axis, by)
        mujoco.mju_rotVecQuat(turned, anchor, turn)
        inner = anchor - turned
    else:
        inner = by * axis
    mujoco.mju_rotVecQuat(shift, inner, orientation)
    body.pos = np.array(body.pos) + shift
    whole = np.empty(4)
    mujoco.mju_mulQuat(whole, orientation, turn)
    body.quat = whole


def _delete_other_joints(
    spec: mujoco.MjSpec, model: mujoco.MjModel, kept: set[str], rest: Array
) -> None:
    """Delete the other joints and what may name them; keep one keyframe of the arm's joints."""
    at = sorted(int(model.joint(j.name).qposadr[0]) for j in spec.joints if j.name in kept)
    # MuJoCo keeps some references to a deleted joint, and then does not compile
    of_joint = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    idle = [a for a in spec.actuators if a.trntype not in of_joint or a.target not in kept]
    for items in (spec.keys, spec.sensors, spec.tuples, idle, spec.equalities, spec.tendons):
        for item in list(items):
            spec.delete(item)
    for joint in list(spec.joints):
        if joint.name not in kept:
            spec.delete(joint)
    if model.nkey:
        spec.add_key(name="home", qpos=rest[at])
