"""The model file of a diagnosis, ``model.toml``: its exact causes, and their baseline.

`--nominal model.toml` reads it, so that the next diagnosis can start from this result.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.friction.from_file import file_friction, shipped_friction
from stiction_envs.friction.parameters import (
    QUANTITIES,
    FrictionParameters,
    check_possible,
    load_friction,
)
from stiction_envs.gap.causes import Part, cause_named
from stiction_envs.gap.causes.base import (
    ALL_LINKS,
    EITHER,
    FRICTION,
    OF_ARM,
    ROTOR,
    THE_ARM,
    torque_of,
)
from stiction_envs.gap.causes.log.actuator_delay import ActuatorDelay
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.sessions import Spans
from stiction_envs.gap.signals.torque_lag import Lag
from stiction_envs.reporting.toml import toml_text
from stiction_envs.robots import Arm, load_arm
from stiction_envs.robots.arm_toml import Table, check_range, largest, read_toml
from stiction_envs.robots.stated import without_springs

LEAST_UNIT = 1e-9
"""Least factor of another unit of torques [-]: it divides."""
FACTOR = "covariance_factor"
"""Key of F, F Fᵀ being the covariance of coefficients."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Nominal:
    """The baseline of a diagnosis: friction, and causes of earlier diagnoses."""

    friction: FrictionParameters | None = None
    """None for a rigid body without friction."""
    parts: tuple[Part, ...] = ()
    robot: str | None = None
    """Name of the arm on which the parts were found; None without parts."""
    payload: tuple[float, float, float, float] | None = None
    """The known body on its flange: mass [kg] and centre of mass in its frame [m]."""
    tilt: tuple[float, float] = (0.0, 0.0)
    """The known inclination of its base: roll and pitch [rad]."""
    distance: tuple[float, ...] | None = None
    """(n,) presliding distance of plain dry friction in that diagnosis [rad]."""
    torque_sign: int = 0
    """1 where logged torques of that robot drive the joints, -1 if opposite, 0 where unknown."""
    torque_unit: Array | None = None
    """(n,) or (1,) what 1 N·m is in the unit of its logged torques; None for N·m."""
    torque_lag: Lag | None = None
    """Delay and time constant of a low-pass by which logged torques come late [s], and which was
    undone; None for none. A shorter one is a part, an actuator delay."""
    sessions: Spans = ()
    """When the robot was recorded, as far as logs have dates."""
    file: bool = False
    """Whether springs and gravity compensation of the robot's file act; its rotors always do."""
    links: Array | None = None
    """(10 n, k) F, F Fᵀ being the covariance of the links' inertial parameters that the last
    diagnosis left; None where it left none."""

    def check(self, arm: Arm, where: str | Path = "nominal model") -> None:
        """Raise a StictionError if the arm is not that of the parts, or a body is impossible.

        The arm's known payload and tilt may differ: causes stay.
        """
        if self.robot is None:
            return
        if self.links is not None and len(self.links) != 10 * arm.n:
            raise StictionError(
                f"{where}: [links] has {len(self.links)} rows: expected {10 * arm.n} for {arm.name}"
            )
        if self.robot != arm.name:
            raise StictionError(
                f"{where}: of robot {self.robot}, but the arm is {arm.name}: expected the arm it "
                "was diagnosed on"
            )
        for part in self.parts:
            if part.joint > arm.n:
                raise StictionError(
                    f"{where}: cause {part.cause} on joint {part.joint}: {arm.name} has "
                    f"{arm.n} joints"
                )
        try:
            changed_arm(arm, self.parts)
        except StictionError as error:
            raise StictionError(f"{where}: {error}") from None

    def extend(self, data: Data) -> Data:
        """Return data against the nominal model with its causes, added level by level."""
        if not self.parts:
            return data
        own = data.friction.presliding_distance
        if self.distance is not None:
            data = data.with_presliding(np.array(self.distance))
        for level in sorted({p.level for p in self.parts}):
            causes = [(p, cause_named(p.cause)) for p in self.parts if p.level == level]
            arm = changed_arm(data.arm, [p for p, _ in causes])
            changed = data if arm is data.arm else data.on(arm)
            torque = changed.recording.rigid - data.recording.rigid
            small = any(cause.adds_to == ALL_LINKS for _, cause in causes)
            loaded = data.carrying(torque, arm=arm if small else None)
            added = sound = torque
            for p, cause in causes:
                if not isinstance(cause, ActuatorDelay) and cause.adds_to not in OF_ARM:
                    more = torque_of(cause, loaded if p.carried else data, p)
                    added = added + more
                    if not cause.resembles_delay:
                        sound = sound + more
            for p, cause in causes:
                if isinstance(cause, ActuatorDelay):
                    whole = cause.acting_on(data.nominal + sound) if p.carried else cause
                    added = added + torque_of(whole, data, p)
            friction, rotor = any(c.adds_to in FRICTION for _, c in causes), np.zeros(data.n)
            for p in (p for p, c in causes if c.adds_to == ROTOR):
                rotor[p.joint - 1] += p.coefficients[0]
            data = loaded.corrected(added, friction=friction, rotor=rotor).on(arm)
        return data.with_presliding(own)


def changed_arm(arm: Arm, parts: Sequence[Part]) -> Arm:
    """Return the rigid arm with the bodies and the gravity of parts, level by level.

    Raises:
        StictionError: a part that makes a body physically impossible.
    """
    for part in sorted(parts, key=lambda p: p.level):
        arm = cause_named(part.cause).changed(arm, part)
    return arm


def nominal_of(
    robot: str | Path | Arm,
    nominal: str | Path | FrictionParameters | Nominal,
    *,
    payload: Sequence[float] | None = None,
    tilt: Sequence[float] | None = None,
    chain: Sequence[str] | None = None,
) -> tuple[Arm, Nominal]:
    """Return the rigid arm with its known payload and tilt, and its nominal model.

    An arm has its payload [kg, m], tilt [rad] and chain; for a name or a file they are as of
    `load_model`.

    Raises:
        StictionError: an unknown name, an unreadable file, or a model of another arm.
    """
    is_toml = isinstance(nominal, str | Path) and Path(nominal).suffix == ".toml"
    found = read(Path(str(nominal))) if is_toml else nominal
    if not isinstance(robot, Arm):
        before = found if isinstance(found, Nominal) else Nominal()
        payload = before.payload if payload is None else payload
        robot = load_arm(robot, payload=payload, tilt=tilt or before.tilt, chain=chain)
    if isinstance(found, FrictionParameters):
        found = Nominal(friction=found)
    elif found == "rigid":
        found = Nominal()
    elif found == "file":
        found = Nominal(friction=file_friction(robot) if robot.stated.friction else None, file=True)
    elif found == "shipped":
        found = Nominal(friction=shipped_friction(robot))
    elif not isinstance(found, Nominal):
        raise StictionError(f"nominal {nominal}: expected rigid, shipped, file or a .toml")
    if is_toml:
        found.check(robot, f"nominal {nominal}")
        if found.friction is None and found.robot is None:
            found = Nominal(friction=load_friction(Path(str(nominal)), robot.n))
    if not found.file:
        robot = replace(robot, stated=without_springs(robot.stated))
    return robot, found


def read(path: Path) -> Nominal:
    """Read a ``model.toml``; one without ``[arm]`` (a friction TOML) is empty.

    Raises:
        StictionError: unreadable, not TOML, or not as `stiction diagnose` writes it.
    """
    where = f"nominal {path}"
    try:
        table = read_toml(path)
    except StictionError as error:
        raise StictionError(f"nominal {error}") from None
    if "arm" not in table:
        return Nominal()
    try:
        return _parsed(table, where)
    except (KeyError, TypeError, ValueError, OverflowError, IndexError, AttributeError) as error:
        raise StictionError(
            f"{where}: [arm] or [[cause]] is not as stiction diagnose writes it ({error!r})"
        ) from None


def _parsed(table: Table, where: str) -> Nominal:
    arm, base = table["arm"], table["arm"].get("friction")
    own = f"{where}: [arm]"
    friction = FrictionParameters(**{k: np.array(base[k]) for k in QUANTITIES}) if base else None
    if friction:
        check_possible(friction, own)
    payload = _numbers(arm["payload"], f"{own} payload", sizes=(0, 4))
    check_range(payload[:1], "kg", f"{own} payload", low=0.0)
    check_range(payload[1:], "m", f"{own} payload")
    lag = _numbers(arm.get("torque_lag", ()), f"{own} torque_lag", "s", low=0.0, sizes=(0, 2))
    tilt = _numbers(arm["tilt"], f"{own} tilt", "rad", sizes=(2,))
    spans = tuple((float(a), float(b)) for a, b in arm.get("sessions", ()))
    for a, b in spans:
        if not 0 <= a <= b <= largest():
            raise StictionError(f"{own} sessions: {a:g} to {b:g} s: expected increasing dates")
    if (sign := int(arm.get("torque_sign", 0))) not in (-1, 0, 1):
        raise StictionError(f"{own} torque_sign is {sign}: expected 1, -1, or 0 where unknown")
    unit = _numbers(arm.get("torque_unit", ()), f"{own} torque_unit", low=LEAST_UNIT)
    links = table["links"][FACTOR] if "links" in table else None
    return Nominal(
        friction=friction,
        parts=tuple(_part(c, where) for c in table.get("cause", ())),
        robot=str(arm["robot"]),
        payload=(payload[0], payload[1], payload[2], payload[3]) if payload else None,
        tilt=(tilt[0], tilt[1]),
        distance=_numbers(arm["distance"], f"{own} distance", "rad", low=0.0) or None,
        file=bool(arm.get("file", False)),
        torque_sign=sign,
        torque_unit=np.array(unit) if unit else None,
        torque_lag=(lag[0], lag[1]) if lag else None,
        sessions=spans,
        links=None if links is None else _matrix(links, f"{where}: [links]"),
    )


def _part(table: Table, where: str) -> Part:
    name, joint = str(table["name"]), int(table["joint"])
    at = f"{where}: cause {name} on joint {joint}"
    coefficients = _numbers(table["coefficients"], at)
    try:
        cause = cause_named(name)
    except StictionError as error:
        raise StictionError(f"{where}: {error}") from None
    if joint != 0 and cause.acts_on == THE_ARM:
        raise StictionError(f"{at}: expected 0, the whole arm")
    if joint < (0 if cause.acts_on in (THE_ARM, EITHER) else 1):
        raise StictionError(f"{at}: expected 1 or more")
    doubt = _matrix(table[FACTOR], at).tolist() if table.get(FACTOR) else []
    if len(doubt) > len(coefficients):
        raise StictionError(f"{at}: {FACTOR}: expected up to {len(coefficients)} rows")
    return Part(
        cause=name,
        joint=joint,
        shape=_numbers(table["shape"], at),
        coefficients=coefficients,
        level=int(table["level"]),
        carried=bool(table.get("carried", False)),
        doubt=tuple(map(tuple, doubt)),
    )


def _numbers(
    values: Sequence[Any], where: str, unit: str = "", *, low: float = -np.inf, sizes: Any = None
) -> tuple[float, ...]:
    """Return numbers that a joint can have in a unit; "" for the largest of all units."""
    out = tuple(float(x) for x in values)
    if sizes and len(out) not in sizes:
        raise StictionError(f"{where} has {len(out)} numbers: expected {max(sizes)}")
    check_range(out, unit, where, low=low)
    return out


def _matrix(rows: Any, where: str) -> Array:
    """Return rows of as many numbers."""
    try:
        out = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        out = np.empty(0)
    if out.ndim != 2 or not (np.abs(out) <= largest()).all():
        raise StictionError(f"{where} {FACTOR}: expected rows of as many finite numbers")
    return out


def dump(nominal: Nominal) -> str:
    """Return the TOML tables ``[arm]`` and ``[[cause]]``; floats read back exactly."""
    unit, friction = nominal.torque_unit, nominal.friction
    known = {
        "file": nominal.file,
        "torque_sign": nominal.torque_sign,
        "torque_unit": () if unit is None else unit.tolist(),
        "torque_lag": list(nominal.torque_lag or ()),
        "sessions": [list(x) for x in nominal.sessions],
        "friction": friction and {k: getattr(friction, k).tolist() for k in QUANTITIES},
    }
    arm: dict[str, object] = {
        "robot": nominal.robot or "",
        "payload": [float(x) for x in nominal.payload or ()],
        "tilt": [float(x) for x in nominal.tilt],
        "distance": [float(x) for x in nominal.distance or ()],
        **{k: x for k, x in known.items() if x},
    }
    causes = [
        {
            "name": part.cause,
            "joint": part.joint,
            "shape": list(part.shape),
            "coefficients": list(part.coefficients),
            "level": part.level,
            "carried": part.carried,
            **({FACTOR: [list(row) for row in part.doubt]} if part.doubt else {}),
        }
        for part in nominal.parts
    ]
    tables: dict[str, object] = {"arm": arm} | ({"cause": causes} if causes else {})
    if nominal.links is not None:
        tables["links"] = {FACTOR: nominal.links.tolist()}
    what = "Baseline of the causes, and the causes exactly: for --nominal of stiction diagnose."
    doubt = "F of the covariance F Fᵀ of the links' parameters (m, m c, I), link after link."
    return "\n" + toml_text(tables, comments={"arm": what, "links": doubt})
