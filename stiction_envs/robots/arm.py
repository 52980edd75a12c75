"""A robot arm as data: rigid MJCF, limits, rest pose, interface of its controller."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError, checked_array, unknown
from stiction_envs.precomputed.store import digest
from stiction_envs.reporting.atomic import naming
from stiction_envs.robots import mjcf
from stiction_envs.robots.arm_toml import (
    Limits,
    Table,
    hand_yaw,
    lookup,
    on_floor,
    payload_radius,
    per_joint,
)
from stiction_envs.robots.chain import Chain
from stiction_envs.robots.overlapping_links import excluded_pairs
from stiction_envs.robots.registry import ARMS, ENDS, ArmFiles, find_model, known_arm
from stiction_envs.robots.stated import StatedJoints, nothing_stated, write_stated
from stiction_envs.robots.user_arm import read_user_arm

if TYPE_CHECKING:
    import pinocchio as pin


@dataclass(frozen=True, kw_only=True)
class Arm:
    """A serial arm of n hinges, without friction, rotors or actuators.

    All angles in rad, torques in N·m; arrays are float64, read-only and ordered base to flange.
    """

    name: str
    """A registered name, or the stem of the user's file, its whole name where the stem is an arm of
    `registry.ARMS`; of a chain its ends too."""
    xml: str
    """MJCF of the rigid arm with tilt and payload; asset paths, if any, are absolute."""
    joint_names: tuple[str, ...]
    """Joints, base to flange."""
    link_names: tuple[str, ...]
    """Body that each joint moves."""
    end_effector: str
    """Name of the flange site."""
    hand_yaw: float
    """Turn of the hand's frame from the flange's about the flange's z, rad."""
    limits: Limits
    """Position, velocity, torque and torque rate."""
    rest: Array
    """Rest pose, (n,), rad."""
    controller_rate_hz: float
    """Rate at which the robot takes torque commands, Hz."""
    lowpass_hz: float
    """Cutoff of the first-order filter on the commanded torque, Hz; 0 = off."""
    payload: tuple[float, float, float, float] | None
    """Mass [kg] and centre of mass x, y, z [m] in the flange frame, or None."""
    tilt: tuple[float, float]
    """Roll, then pitch, of the base about the world's x and y, rad."""
    on_floor: bool
    """Whether the base stands on a floor, at z = 0 of the untilted world."""
    stated: StatedJoints
    """Physics of the joints that the robot's own file states beyond rigid links."""
    registered: bool
    """Whether the arm is one of `registry.ARMS`, by the content of its files."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def registered_name(self) -> str | None:
        """Name of this arm in `registry.ARMS`; None for a user's own arm.

        Data of an arm are selected by it, never by `name`, which a user's file may share.
        """
        return self.name if self.registered else None

    @property
    def fingerprint(self) -> str:
        """Hash of everything that defines the rigid arm, and the files that its MJCF names."""
        own = [getattr(self, f.name) for f in fields(self) if f.name != "stated"]
        root = ET.fromstring(self.xml)
        files = [Path(e.get("file", "")) for e in root.iter() if e.get("file")]
        return digest(own, [path.read_bytes() for path in files])

    def notes(self, used: bool | Collection[str] = True) -> list[str]:
        """Return how the arm was read, one line each; ``used`` as in `StatedJoints.line`."""
        pairs = [f"{one} and {two}" for one, two in excluded_pairs(self.xml)]
        touching = f"links that touch in every pose are not called collisions: {', '.join(pairs)}"
        said = [self.stated.line(used), touching if pairs else ""]
        return [f"{self.name}: {words}" for words in said if words]

    @property
    def whole(self) -> tuple[str, ...]:
        """All joints of the robot that this arm is a chain of, in its file's order; else ()."""
        text = ET.fromstring(self.xml).find(f"custom/text[@name='{mjcf.WHOLE}']")
        return () if text is None else tuple(text.get("data", "").split("\n"))

    def carrying_xml(self) -> str:
        """Return MJCF with limits, rest pose and stated joint physics for `load_arm`."""
        root = ET.fromstring(self.xml)
        write_stated(self.stated, self.joint_names, root)
        self.carry_into(root)
        return ET.tostring(root, encoding="unicode")

    def carry_into(self, root: ET.Element) -> None:
        """Write limits and rest pose, where finite, to the MJCF element ``root``."""
        custom = root.find("custom")
        custom = ET.SubElement(root, "custom") if custom is None else custom
        for name, key in mjcf.CARRIED.items():
            values = attrgetter(key)(self)
            if np.isfinite(values).all():
                ET.SubElement(custom, "numeric", name=name, data=mjcf.numbers(values))

    def spec(self) -> mujoco.MjSpec:
        """Return a new MuJoCo spec; the caller may add actuators, armature, elastic joints."""
        return mujoco.MjSpec.from_string(self.xml)

    def model(self) -> mujoco.MjModel:
        """Return the MuJoCo model of the rigid arm: nq = nv = n, joint i has dof i."""
        return self.spec().compile()

    def bare_model(self) -> mujoco.MjModel:
        """Return `model` without geometry: the same dynamics in two thirds of the time."""
        xml = ET.tostring(mjcf.skeleton(ET.fromstring(self.xml)), encoding="unicode")
        return mujoco.MjModel.from_xml_string(xml)

    def pinocchio(self, *, compensated: bool = False) -> pin.Model:
        """Return the same arm for pinocchio: joint i + 1 is ``joint_names[i]``, same gravity.

        Frames have the names of bodies, joints and sites. If ``compensated``, bodies have only the
        share of their mass whose weight the gravity compensation of the robot's file carries.
        """
        import pinocchio as pin  # only identification needs it: not loaded with an environment

        root = ET.fromstring(self.xml)
        for body in root.iter("body") if compensated else ():
            share = self.stated.gravcomp.get(body.get("name", ""), 0.0)
            for inertial in body.findall("inertial"):
                inertial.set("mass", repr(share * float(inertial.get("mass", 0.0))))
        with tempfile.TemporaryDirectory() as folder:
            # Pinocchio reads MJCF from files only, and needs no geometry.
            path = Path(folder) / "arm.xml"
            with naming(path):
                ET.ElementTree(mjcf.skeleton(root)).write(path, encoding="unicode")
            model = pin.buildModelFromMJCF(str(path))
        option = root.find("option")
        gravity = np.array((0.0, 0.0, -9.81))
        if option is not None:
            gravity = mjcf.read_numbers(option, "gravity", tuple(gravity))
        model.gravity.linear = gravity
        if tuple(model.names)[1:] != self.joint_names:
            raise StictionError(
                f"{self.name}: pinocchio reads joints {list(model.names)[1:]}, "
                f"MuJoCo {list(self.joint_names)}"
            )
        return model


def load_arm(
    robot: str | Path,
    *,
    payload: Sequence[float] | None = None,
    tilt: Sequence[float] = (0.0, 0.0),
    chain: Sequence[str] | None = None,
) -> Arm:
    """Load an arm by its name, or a user's MJCF or URDF.

    Args:
        robot: a name in `registry.ARMS`, a folder of MuJoCo Menagerie, a name of
            robot_descriptions (extra), or a path to an ``.xml``, ``.mjcf`` or ``.urdf``
            with one serial chain of 1 to 9 hinges. A TOML of the same stem may give
            limits, rest pose and interface, in the tables of ``panda.toml``; other
            numbers are assumed (``generic.toml``). A copy of an arm of the package is that arm.
        payload: mass [kg] and centre of mass x, y, z [m] in the flange frame; its inertia is that
            of a solid sphere of 0.03 m radius (assumed). Mass 0 adds nothing.
        tilt: roll about the world's x, then pitch about the world's y [rad] of the base body,
            about its own origin. Gravity stays along the world's -z.
        chain: names of two links (the second may be a site), base and tip of the arm in a file of
            a bigger robot; its other joints are locked in the rest pose. None if the file is one
            arm.

    Raises:
        StictionError: unknown name, unreadable file, not a serial arm of 1 to 9 hinges, a moving
            link without mass, a payload or tilt that is not a finite number, or no such chain.
    """
    load: tuple[float, float, float, float] | None = None
    if payload is not None:
        expected = "4 finite numbers, mass in kg, centre of mass x y z in m"
        mass, x, y, z = checked_array(payload, "payload", (4,), expected=expected).tolist()
        checked_array(mass, "payload mass", low=0, unit="kg")
        load = mass, x, y, z
    expected = "2 finite numbers, roll and pitch in rad"
    roll, pitch = checked_array(tilt, "tilt", (2,), expected=expected).tolist()
    ends = check_chain(robot, chain)
    known = known_arm(robot) if ends is None else None
    if known is None:
        fields = _user_arm(robot, ends)
    else:
        fields = _shipped(known) if known.shipped else read_user_arm(known.model)

    root = ET.fromstring(fields["xml"])
    if roll or pitch:
        mjcf.tilt_base(root, fields["link_names"][0], (roll, pitch))
    if load is not None and load[0] > 0:
        mjcf.add_payload(root, fields["end_effector"], load, payload_radius())
    if roll or pitch or load is not None:
        fields["xml"] = ET.tostring(root, encoding="unicode")
    fields["rest"].flags.writeable = False
    registered = known is not None
    return Arm(**fields, registered=registered, payload=load, tilt=(roll, pitch))


def _shipped(files: ArmFiles) -> Table:
    """Return fields as `read_user_arm`; the package's MJCF is used bit for bit."""
    xml = files.model.read_text("utf-8")
    links = [body for body in ET.fromstring(xml).iter("body") if body.find("joint") is not None]
    joints = [str(link.find("joint").get("name")) for link in links]  # type: ignore[union-attr]
    n = len(joints)

    def numbers(key: str, shape: tuple[int, ...]) -> Array:
        return per_joint(lookup(files.table, key), shape, f"{files.toml.name}, {key}")

    shapes = {"position": (n, 2), "velocity": (n,), "torque": (n,), "torque_rate": (n,)}
    limits = {key: numbers(f"limits.{key}", shape) for key, shape in shapes.items()}
    return {
        "name": files.name,
        "xml": xml,
        "joint_names": tuple(joints),
        "link_names": tuple(str(link.get("name")) for link in links),
        "end_effector": files.table["end_effector"],
        "hand_yaw": hand_yaw(files.table, files.toml.name),
        "limits": Limits(**limits),
        "rest": numbers("rest", (n,)),
        "controller_rate_hz": lookup(files.table, "interface.controller_rate_hz"),
        "lowpass_hz": lookup(files.table, "interface.lowpass_hz"),
        "on_floor": on_floor(files.table, files.toml.name),
        "stated": nothing_stated(n),
    }


def check_chain(robot: str | Path, chain: Sequence[str] | None) -> Chain | None:
    """Return the chain; raise where it is not two names, or the robot is one arm by its name."""
    if chain is None:
        return None
    if str(robot) in ARMS:
        raise StictionError(
            f"chain: {robot} is one arm: expected the path of a bigger robot's file"
        )
    if isinstance(chain, str) or len(chain) != 2 or not all(isinstance(x, str) for x in chain):
        raise StictionError(f"chain {chain!r}: expected two links, base and tip")
    return chain[0], chain[1]


def _user_arm(robot: str | Path, chain: Chain | None) -> Table:
    """Return the fields of an arm that is not registered, by `read_user_arm`."""
    path = Path(find_model(robot)).expanduser()
    if path.suffix.lower() not in ENDS:
        raise unknown("robot", str(robot), [*ARMS, "a path to an .xml, .mjcf or .urdf"])
    if not path.is_file():
        raise StictionError(f"{path}: no such file")
    files = (path, path.with_suffix(".toml"))
    content = [x.read_bytes() if x.is_file() else b"" for x in files]
    fields = dict(_read_once(path, chain, *content))
    if fields["name"] in ARMS:  # tables, models and headings identify arms by name
        fields["name"] = path.name
    return fields


@lru_cache(maxsize=4)
def _read_once(path: Path, chain: Chain | None, *content: bytes) -> Table:
    """Return `read_user_arm` of a file with some content: a command asks for its arm repeatedly."""
    return read_user_arm(path, chain)
