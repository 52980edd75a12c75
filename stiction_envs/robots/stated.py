"""Joint physics that a robot's own file states beyond rigid links, and what of the file is left.

MuJoCo's armature, damping, frictionloss, springs and gravcomp, the LuGre friction of a ``dcmotor``;
those of an actuator on a joint and of a fixed tendon over one joint too. A constraint between
joints makes the arm another mechanism than a serial one, and is refused.
Source: MuJoCo 4, XML reference (joint, actuator, body, tendon, equality).
"""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.errors import StictionError
from stiction_envs.robots import mjcf

# columns of actuator_biasprm and actuator_dynprm that hold LuGre friction (sources.md 3.5)
COULOMB, STICTION, STRIBECK = 3, 4, 5
BRISTLE_STIFFNESS = 5
_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
DISABLING = tuple(
    f"mjDSBL_{x}" for x in ("GRAVITY", "SPRING", "DAMPER", "FRICTIONLOSS", "ACTUATION", "EQUALITY")
)
"""Flags of MuJoCo's option that switch off what this file reads."""
ROTORS, DRY, DAMPING, SPRINGS = "rotors", "dry friction", "damping", "springs"
"""What a file may state of joints; gravity compensation counts as springs."""
WITHOUT_FRICTION = ROTORS, SPRINGS
"""What is taken of a file where friction is fitted, or has a margin of the torque limits."""
URDF_TAGS = ("transmission", "ros2_control", "gazebo", "safety_controller", "calibration")
"""Elements of a URDF that MuJoCo does not read."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StatedJoints:
    """Physics that the file of n joints states; arrays (n,), zero where the file is silent."""

    armature: Array
    """Rotor inertia at the joint [kg·m²]; of actuators times their gear squared."""
    stiction: Array
    """Dry friction at rest: frictionloss and LuGre's F_s [N·m]."""
    coulomb: Array
    """Dry friction in motion: frictionloss and LuGre's F_c [N·m]."""
    stribeck: Array
    """LuGre's Stribeck velocity [rad/s]."""
    bristle: Array
    """LuGre's bristle stiffness σ0 [N·m/rad]."""
    damping: Array
    """Viscous friction [N·m·s/rad]."""
    stiffness: Array
    """Spring to the link before [N·m/rad]."""
    springref: Array
    """Angle at which that spring is at rest [rad]."""
    gravcomp: Mapping[str, float]
    """Share of its weight that a body's gravity compensation carries, by body [-]."""
    held: tuple[tuple[int, str], ...] = ()
    """Slides between base and flange that are held still: their place among the hinges and them,
    from 0, and their name."""
    changed: tuple[str, ...] = ()
    """Clauses on numbers that were changed."""
    left: tuple[str, ...] = ()
    """Clauses on parts of the file that were left out."""

    @property
    def dry(self) -> bool:
        """True if the file states dry friction."""
        return bool(self.stiction.any())

    @property
    def friction(self) -> bool:
        """True if the file states friction, dry or viscous."""
        return self.dry or bool(self.damping.any())

    @property
    def passive(self) -> bool:
        """True if the file states springs or gravity compensation."""
        return bool(self.stiffness.any()) or bool(self.gravcomp)

    def line(self, used: bool | Collection[str] = True) -> str:
        """Return one line on the numbers taken and left; empty where the file states nothing.

        ``used`` are the kinds that are taken; True for all, False for rotors alone.
        """
        if isinstance(used, bool):
            used = (ROTORS, DRY, DAMPING, SPRINGS) if used else (ROTORS,)
        found = [
            (kind, f"{name} {_each(x)} {unit}")
            for kind, name, x, unit in (
                (ROTORS, "rotor inertia", self.armature, "kg·m²"),
                (DRY, "dry friction", self.stiction, "N·m"),
                (DAMPING, "damping", self.damping, "N·m·s/rad"),
                (SPRINGS, "springs", self.stiffness, "N·m/rad"),
            )
            if x.any()
        ]
        if self.gravcomp:
            shares = _each(np.array(list(self.gravcomp.values())))
            text = f"gravity compensation {shares} of {len(self.gravcomp)} bodies"
            found.append((SPRINGS, text))
        taken = [text for kind, text in found if kind in used]
        left = [text for kind, text in found if kind not in used]
        parts = [f"taken from the file: {', '.join(taken)}"] if taken else []
        if self.passive and SPRINGS in used:
            parts.append("in simulated experiments the controller balances springs and gravity")
        left += self.left
        return "; ".join([*parts, *self.changed, *([f"left out: {', '.join(left)}"] * bool(left))])


def write_stated(stated: StatedJoints, joints: Sequence[str], root: ET.Element) -> None:
    """Write the stated physics of ``joints`` to the MJCF element ``root``.

    `read_stated` finds it there again. LuGre friction becomes frictionloss of its F_s.
    """
    compiler = root.find("compiler")
    degrees = compiler is None or compiler.get("angle", "degree") == "degree"
    found = {element.get("name"): element for element in root.iter("joint")}
    values = {
        "armature": stated.armature,
        "damping": stated.damping,
        "frictionloss": stated.stiction,
        "stiffness": stated.stiffness,
        "springref": np.degrees(stated.springref) if degrees else stated.springref,
    }
    for j, name in enumerate(joints):
        found[name].attrib |= {k: mjcf.numbers([x[j]]) for k, x in values.items() if x[j]}
    for body in root.iter("body"):
        if share := stated.gravcomp.get(body.get("name", "")):
            body.set("gravcomp", mjcf.numbers([share]))


def without_springs(stated: StatedJoints) -> StatedJoints:
    """Return the stated physics without springs and gravity compensation."""
    zero = np.zeros_like(stated.stiffness)
    return replace(stated, stiffness=zero, springref=zero, gravcomp={})


def nothing_stated(n: int) -> StatedJoints:
    """Return the stated physics of a bare rigid arm of n joints: none."""
    names = ("armature", "stiction", "coulomb", "stribeck", "bristle", "damping", "stiffness")
    zeros: dict[str, Any] = {k: np.zeros(n) for k in (*names, "springref")}
    return StatedJoints(**zeros, gravcomp={})


def dry_friction(
    model: mujoco.MjModel, ids: Sequence[int] | Index
) -> tuple[Array, Array, Array, Array]:
    """Return (n,) F_s and F_c [N·m], v_s [rad/s] and σ0 [N·m/rad] of some joints of a model.

    The file states LuGre friction in a ``dcmotor``, or frictionloss without v_s and σ0: both 0.
    """
    loss = model.dof_frictionloss[model.jnt_dofadr[ids]]
    stiction, coulomb, stribeck, bristle = loss.copy(), loss.copy(), 0 * loss, 0 * loss
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    motor = model.actuator_gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR
    for a in np.flatnonzero(on_joint & motor):
        sigma0, gear = model.actuator_dynprm[a, BRISTLE_STIFFNESS], abs(model.actuator_gear[a, 0])
        here = np.asarray(ids) == model.actuator_trnid[a, 0]
        if sigma0 > 0:
            stiction[here] += gear * model.actuator_biasprm[a, STICTION]
            coulomb[here] += gear * model.actuator_biasprm[a, COULOMB]
            stribeck[here] = model.actuator_biasprm[a, STRIBECK] / gear
            bristle[here] += gear**2 * sigma0
    return stiction, coulomb, stribeck, bristle


def read_stated(
    model: mujoco.MjModel,
    names: Sequence[str],
    held: Collection[str],
    changed: Sequence[str],
    left: Sequence[str],
) -> StatedJoints:
    """Return the physics that a file states of the joints ``names``, base to flange.

    Args:
        model: of the file, all its parts named; before anything is deleted.
        names: the arm's joints.
        held: slides that are held still between them.
        changed: clauses on numbers that were changed.
        left: clauses on what was left out before.
    """
    ids = [model.joint(name).id for name in names]
    dof = model.jnt_dofadr[ids]
    out = nothing_stated(len(ids))
    out.armature[:], out.damping[:] = model.dof_armature[dof], model.dof_damping[dof]
    dry = out.stiction, out.coulomb, out.stribeck, out.bristle
    for mine, found in zip(dry, dry_friction(model, ids), strict=True):
        mine[:] = found
    out.stiffness[:] = model.jnt_stiffness[ids]
    out.springref[:] = np.where(out.stiffness > 0, model.qpos_spring[model.jnt_qposadr[ids]], 0.0)
    actuators = []
    for a in range(model.nu):
        if model.actuator_trntype[a] in _JOINT and model.actuator_trnid[a, 0] in ids:
            actuators.append(a)
            j, gear = ids.index(model.actuator_trnid[a, 0]), float(model.actuator_gear[a, 0])
            out.armature[j] += gear**2 * model.actuator_armature[a]
            out.damping[j] += gear**2 * model.actuator_damping[a]
    said = [*left, *_add_tendons(out, model, ids), *_actuators(model, actuators)]
    higher = {
        "damping": (model.dof_dampingpoly[dof], model.actuator_dampingpoly[actuators]),
        "stiffness": (model.jnt_stiffnesspoly[ids],),
    }
    said += [f"the higher terms of {k}" for k, parts in higher.items() if any(map(np.any, parts))]
    said += _options(model.opt)
    own = _carried(model, ids)
    # a body that hangs on the world does not move: its compensation has no effect
    comp = {
        model.body(b).name: float(model.body_gravcomp[b])
        for b in range(1, model.nbody)
        if model.body_gravcomp[b] and own[b] >= 0
    }
    both = [model.joint(j).name for j in range(model.njnt)]
    both = [x for x in both if x in names or x in held]
    places = tuple((i, x) for i, x in enumerate(both) if x in held)
    return replace(out, gravcomp=comp, held=places, changed=tuple(changed), left=tuple(said))


def refuse_constraints(model: mujoco.MjModel, names: Sequence[str], path: Path) -> list[str]:
    """Return clauses on constraints that do not hold the arm's joints ``names``.

    Raises:
        StictionError: an active constraint between the arm's joints, or that closes a loop.
    """
    ids = [model.joint(name).id for name in names]
    own, out = _carried(model, ids), []
    kinds = mujoco.mjtEq
    for e in range(model.neq):
        kind, one, two = int(model.eq_type[e]), int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        label = kinds(kind).name.removeprefix("mjEQ_").lower()
        name = model.equality(e).name
        what = f"{label} equality {name!r}" if name else f"{label} equality"
        if kind == kinds.mjEQ_JOINT:
            both = [model.joint(x).name for x in (one, two) if x >= 0]
            ties = one in ids  # the joint that follows; another that follows the arm's is held
        elif kind == kinds.mjEQ_TENDON:
            both = [model.tendon(x).name for x in (one, two) if x >= 0]
            ties = any(j in ids for x in (one, two) if x >= 0 for j in _joints_of(model, x))
        elif kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
                one, two = (int(model.site_bodyid[x]) for x in (one, two))
            both = [model.body(x).name for x in (one, two)]
            mocap = any(model.body_mocapid[x] >= 0 for x in (one, two))
            ties = own[one] != own[two] and not mocap
        else:
            both, ties = [], False
        if not (ties and model.eq_active0[e]):
            out.append(what)
            continue
        raise StictionError(
            f"{path}: {what} (a mimic or closed loop) ties {' to '.join(both)}: expected joints "
            "that move independently; remove it from the file to simulate them so"
        )
    return out


def _carried(model: mujoco.MjModel, ids: Sequence[int]) -> list[int]:
    """Return for each body the last joint of ``ids`` that moves it, -1 for none."""
    of = {int(model.jnt_bodyid[j]): j for j in ids}
    out = [-1]
    for b in range(1, model.nbody):
        out.append(of.get(b, out[model.body_parentid[b]]))
    return out


def _joints_of(model: mujoco.MjModel, tendon: int) -> list[int]:
    """Return the joints of a fixed tendon; none of a spatial one."""
    first = int(model.tendon_adr[tendon])
    at = range(first, first + int(model.tendon_num[tendon]))
    kind = mujoco.mjtWrap.mjWRAP_JOINT
    return [int(model.wrap_objid[k]) for k in at if model.wrap_type[k] == kind]


def _add_tendons(out: StatedJoints, model: mujoco.MjModel, ids: Sequence[int]) -> list[str]:
    """Add the effects of fixed tendons over one joint; return clauses on other tendons."""
    said = []
    for t in range(model.ntendon):
        numbers = {
            "stiffness": float(model.tendon_stiffness[t]),
            "damping": float(model.tendon_damping[t]),
            "frictionloss": float(model.tendon_frictionloss[t]),
            "armature": float(model.tendon_armature[t]),
        }
        joints, (low, high) = _joints_of(model, t), model.tendon_lengthspring[t]
        simple = len(joints) == 1 and joints[0] in ids and low == high
        if simple:
            j, c = ids.index(joints[0]), float(model.wrap_prm[model.tendon_adr[t]])
            k = numbers["stiffness"] * c * c
            if k:
                rest = out.stiffness[j] * out.springref[j] + k * low / c
                out.stiffness[j] += k
                out.springref[j] = rest / out.stiffness[j]
            out.damping[j] += numbers["damping"] * c * c
            out.armature[j] += numbers["armature"] * c * c
            out.stiction[j] += numbers["frictionloss"] * abs(c)
            out.coulomb[j] += numbers["frictionloss"] * abs(c)
        elif any(numbers.values()):
            each = " ".join(f"{k} {v:g}" for k, v in numbers.items() if v)
            said.append(f"tendon {model.tendon(t).name!r} ({each})")
    return said


def _actuators(model: mujoco.MjModel, mine: Sequence[int]) -> list[str]:
    """Return a clause on what the arm's actuators do besides limiting torque."""
    servos = [
        model.actuator_biasprm[a, 1:3]
        for a in mine
        if model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_AFFINE
    ]
    out = []
    if servos:
        kp, kv = np.abs(np.array(servos, dtype=np.float64)).T
        gains = f"kp {_each(kp)}" + (f", kv {_each(kv)}" if kv.any() else "")
        out.append(f"position servos ({gains})")
    if others := len(mine) - len(servos):
        out.append(f"inputs of {others} motors")
    if elsewhere := model.nu - int(np.isin(model.actuator_trntype, _JOINT).sum()):
        out.append(f"{elsewhere} actuators that act on no joint")
    return out


def _options(option: mujoco.MjOption) -> list[str]:
    """Return a clause on a fluid around the arm, and on physics that the file switches off."""
    found = [k for k in ("density", "viscosity", "wind") if np.any(getattr(option, k))]
    off = (x for x in DISABLING if option.disableflags & int(getattr(mujoco.mjtDisableBit, x)))
    found += [f"{x.removeprefix('mjDSBL_').lower()} off" for x in off]
    return [f"option {', '.join(found)}"] if found else []


def _each(values: Array) -> str:
    """Return numbers, one where all are the same."""
    same = len(set(values.tolist())) == 1
    return " ".join(f"{x:.4g}" for x in (values[:1] if same else values))
