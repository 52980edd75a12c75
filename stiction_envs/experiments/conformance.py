"""Does a model stick? A joint must hold a load under its stiction, and move under one above it.

    report = conformance("panda")    # or a path, MJCF text, an MjModel, a StickingModel
    print(report)
    report.save("runs/conformance-panda")

Per joint that carries friction, in both directions, with gravity, contacts and joint limits off:

* **hold**: the torque rises smoothly to 90 % of stiction and stays, 60 s in all. The joint moves by
  its presliding deflection; over the last 30 s it may not move by more than 1e-6 rad;
* **go**: the same with 110 %; the joint must move by more than 0.1 rad within 20 s;
* **ramp**: the torque grows at a few constant rates; the largest dry friction torque on the way to
  0.1 rad is the breakaway torque. It is reported, not judged: that it falls with the rate is LuGre.

MuJoCo's ``frictionloss`` with default solver settings fails: it creeps (sources.md 3.5).

``engine="warp"`` asks the same inside another engine (`engines`). There a robot's name means what
``stiction export ROBOT --engine warp`` writes, ramps are left out unless their rates are given, and
an engine of float32 may move by 1e-5 rad instead of 1e-6.
"""

import copy
import dataclasses
import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Index
from stiction_envs.errors import StictionError, checked_array
from stiction_envs.experiments.conformance_report import ConformanceSettings, JointResult, Report
from stiction_envs.experiments.engines import ENGINES, Bare, Drive, Engine, Refused, engine_named
from stiction_envs.experiments.rig import minimum_jerk
from stiction_envs.friction.export import Kind, plain_mjcf
from stiction_envs.friction.model import StickingModel, build
from stiction_envs.reporting.provenance import provenance
from stiction_envs.robots import ARMS, load_arm
from stiction_envs.robots.arm import check_chain
from stiction_envs.robots.registry import find_model, robot_files
from stiction_envs.robots.stated import dry_friction
from stiction_envs.robots.user_arm import compile_file

USUAL = ConformanceSettings()
STILL_SINGLE = 1e-5  # Largest motion of a joint that holds in an engine of float32 [rad]; assumed
_SILENT = 30  # actuator group that is switched off


def conformance(
    model: str | Path | mujoco.MjModel | StickingModel,
    stiction: ArrayLike | None = None,
    *,
    engine: str = "mujoco",
    rates: Sequence[float] | None = None,
    chain: Sequence[str] | None = None,
    threads: int = 0,
    settings: ConformanceSettings | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Report:
    """Test every hinge that carries friction.

    The test uses a copy of the model without anything but friction that could hold a joint:
    gravity, contacts, joint limits, actuators other than ``dcmotor``, the controller of a
    ``dcmotor`` and the spring of a tested hinge are off, and controls are zero.

    Args:
        model: robot name, path of an MJCF, MJCF text, compiled model, or a sticking model.
        stiction: F_s of every hinge of the model in its order [N·m], 0 for one not to be tested.
            None reads it: LuGre F_s of a ``dcmotor`` (times gear) plus ``frictionloss``.
        engine: where the joints are tested, one of `engines.ENGINES`.
        rates: ramp rates [N·m/s]; None for those of the settings, in MuJoCo alone.
        chain: base and tip link of one arm in a bigger robot's file, whose other joints are locked.
        threads: threads, 0 for all processors.
        settings: numbers of the test; None for `USUAL`.
        progress: called with the tests done and their number.

    Raises:
        StictionError: an unreadable model, no hinge with friction, a bad argument, or an engine
            that is unknown or not installed.
        ExperimentError: a simulation that the engine stopped (NaN, divergence).
    """
    where = engine_named(engine)
    s = settings or USUAL
    s = dataclasses.replace(s, still=STILL_SINGLE) if where.single else s
    stock = where is ENGINES["mujoco"]
    if rates is None:
        rates = s.ramp_rates if stock else ()
    if any(not (np.isfinite(r) and r > 0) for r in rates):
        raise StictionError(f"ramp rates {list(rates)} N·m/s must be positive")
    compiled, mjcf = _read(model, where, chain)
    bare = _bare(compiled)
    hinges = np.flatnonzero(bare.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    read, _, _, stiffness = dry_friction(bare, hinges)
    bare.jnt_stiffness[hinges[read > 0]] = 0.0
    stiffness, level = np.where(stiffness > 0, stiffness, np.nan), read
    if stiction is not None:
        expected = f"finite numbers from 0 N·m, one for each of {len(hinges)} hinges"
        level = checked_array(stiction, "stiction", hinges.shape, expected=expected, low=0.0)
    tested = level > 0
    if not tested.any():
        raise StictionError("no hinge of the model carries friction: give stiction per hinge")
    joints, level, stiffness = hinges[tested], level[tested], stiffness[tested]
    whole = Bare(model=bare, mjcf=mjcf, released=hinges[read > 0])
    bench = _Bench(where, whole, joints, level, _start(bare), threads, s)
    say = progress or (lambda *_: None)
    # NaN stays where an engine refuses the model
    deflection, still, creep, go = np.full((4, len(joints)), np.nan)
    breakaway, refused = np.full((len(rates), len(joints)), np.nan), ""
    try:
        deflection, still, creep = bench.hold()
        say(1, len(rates) + 2)
        go = bench.go()
        for k, rate in enumerate(rates):
            say(k + 2, len(rates) + 2)
            breakaway[k] = bench.breakaway(rate)
    except Refused as error:
        refused = str(error)
    results = tuple(
        JointResult(
            name=bare.joint(int(j)).name or f"hinge {j}",
            stiction=float(level[k]),
            presliding=float(-np.log(1 - s.under) * level[k] / stiffness[k]),
            deflection=float(deflection[k]),
            still=float(still[k]),
            creep=float(creep[k]),
            go_time=float(go[k]),
            breakaway=tuple(breakaway[:, k].tolist()),
            holds=bool(still[k] < s.still and deflection[k] < s.gone),
        )
        for k, j in enumerate(joints)
    )
    content = np.empty(mujoco.mj_sizeModel(bare), np.uint8)
    mujoco.mj_saveModel(bare, None, content)
    path = Path(model) if isinstance(model, str | Path) and "<" not in str(model) else None
    made = provenance(
        "conformance",
        {
            "robot": None if path is None else str(path),
            "model_sha256": hashlib.sha256(content.tobytes()).hexdigest(),
            "stiction": stiction,
            "rates": list(rates),
            **({} if chain is None else {"chain": list(chain)}),
            **({} if stock else {"engine": {"name": where.name, **where.versions()}}),
            "settings": dataclasses.asdict(s),
        },
        seed=0,
        inputs={} if path is None else robot_files(path),
    )
    return Report(
        joints=results,
        rates=tuple(float(r) for r in rates),
        settings=s,
        engine="" if stock else f"{where.name} {next(iter(where.versions().values()))}",
        refused=refused,
        provenance=made,
    )


@dataclass(frozen=True)
class _Bench:
    """One simulation per joint and direction: first all joints +, then all −."""

    engine: Engine
    bare: Bare
    joints: Index  # (joints,) the tested ones
    level: Array  # (joints,) stiction [N·m]
    qpos: Array  # (nq,) start positions
    threads: int
    settings: ConformanceSettings

    @property
    def n(self) -> int:
        """Number of tested joints."""
        return len(self.joints)

    def run(
        self,
        torque: Callable[[Array], Array],
        time: float,
        signs: tuple[int, ...],
        record: tuple[str, ...] = ("qpos",),
    ) -> Iterator[tuple[dict[str, Array], Array]]:
        """Yield chunks and (M, K) motion along the torque [rad].

        ``torque`` of times (K,) is (joints, K); it is applied with each of the signs in turn.
        """
        m, model = len(signs) * self.n, self.bare.model
        dof = np.tile(model.jnt_dofadr[self.joints], len(signs))
        sign = np.repeat(np.array(signs, float), self.n)

        def applied(t: Array) -> Array:
            out = np.zeros((m, len(t), model.nv))
            out[np.arange(m), :, dof] = sign[:, None] * np.tile(torque(t), (len(signs), 1))
            return out

        adr = np.tile(model.jnt_qposadr[self.joints], len(signs))
        drive = Drive(
            bare=self.bare,
            qpos=np.tile(self.qpos, (m, 1)),
            torque=applied,
            steps=round(time / model.opt.timestep),
            record=record,
            threads=self.threads,
        )
        for part in self.engine.simulate(drive):
            q = part["qpos"][np.arange(m), :, adr] - self.qpos[adr][:, None]
            yield part, sign[:, None] * q

    def worse(self, values: Array) -> Array:
        """Return (joints,) the largest of both directions; NaN if either is."""
        return values.reshape(2, self.n).max(axis=0)

    def hold(self) -> tuple[Array, Array, Array]:
        """Return deflection [rad], motion at the end [rad], creep [rad/s] under the small load."""
        s = self.settings

        def torque(t: Array) -> Array:
            return s.under * self.level[:, None] * minimum_jerk(t / s.rise_time)

        late = np.concatenate(
            [
                moved[:, part["time"] >= s.hold_time - s.watched_time]
                for part, moved in self.run(torque, s.hold_time, (1, -1))
            ],
            axis=1,
        )
        creep = np.abs(late[:, -1] - late[:, 0]) / s.watched_time
        still = np.ptp(late, axis=1)
        return self.worse(np.abs(late[:, -1])), self.worse(still), self.worse(creep)

    def go(self) -> Array:
        """Return the time to `gone` under the larger load [s], NaN if that is not reached."""
        s = self.settings

        def torque(t: Array) -> Array:
            # none for a joint that has gone both ways
            factor = np.where(np.isnan(gone).reshape(2, self.n).any(axis=0), s.over, 0.0)
            return (factor * self.level)[:, None] * minimum_jerk(t / s.go_rise_time)

        gone = np.full(2 * self.n, np.nan)
        for part, moved in self.run(torque, s.go_time, (1, -1)):
            over = moved > s.gone
            new = over.any(axis=1) & np.isnan(gone)
            gone[new] = part["time"][over.argmax(axis=1)[new]]
            if not np.isnan(gone).any():
                break
        return self.worse(gone)

    def breakaway(self, rate: float) -> Array:
        """Return the largest dry friction torque of a ramp on its way to 0.1 rad [N·m]."""

        def torque(t: Array) -> Array:
            return np.where(gone, 0.0, rate)[:, None] * t

        gone = np.zeros(self.n, dtype=bool)
        peak = np.full(self.n, -np.inf)
        fields = ("qpos", "qfrc_actuator", "qfrc_constraint")
        time = 2 * float(self.level.max()) / rate + self.settings.go_time
        for part, moved in self.run(torque, time, (1,), fields):
            friction = -(part["qfrc_actuator"] + part["qfrc_constraint"])
            mine = friction[np.arange(self.n), :, self.bare.model.jnt_dofadr[self.joints]]
            before = np.cumsum(moved > self.settings.gone, axis=1) == 0
            top = np.where(before & ~gone[:, None], mine, -np.inf).max(axis=1)
            peak = np.maximum(peak, top)
            gone |= ~before[:, -1]
            if gone.all():
                break
        return np.where(gone, peak, np.nan)


def _read(
    model: str | Path | mujoco.MjModel | StickingModel, engine: Engine, chain: Sequence[str] | None
) -> tuple[mujoco.MjModel, str | Path | None]:
    """Return a compiled model, and its MJCF for an engine that reads MJCF itself.

    A named arm or a sticking model is what export writes for the engine.
    """
    text = str(model) if isinstance(model, str | Path) else ""
    if chain is not None and (not text or "<" in text):
        raise StictionError("chain: expected with the path of a model")
    ends = check_chain(text, chain)
    if isinstance(model, mujoco.MjModel):
        return model, None
    if text in ARMS:
        model = build(load_arm(text))
    if isinstance(model, StickingModel):
        if engine is ENGINES["mujoco"]:
            return model.model, None
        kind: Kind = "frictionloss" if engine.motor is None else "dcmotor"
        motor, name = engine.motor or "ff", model.arm.name
        text = plain_mjcf(model, friction_name=name, kind=kind, motor=motor)
    if "<" not in text:
        path = Path(find_model(text)) if text else Path()
        if not path.is_file():
            raise StictionError(
                f"{path}: no such file, and no robot of that name: expected one of "
                f"{', '.join(ARMS)}, or a path"
            )
        return compile_file(path, ends), path if ends is None else None
    try:
        return mujoco.MjModel.from_xml_string(text), text
    except ValueError as error:
        line = str(error).strip().splitlines()[0]
        raise StictionError(f"MuJoCo cannot read the model: {line}") from None


def _bare(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy in which nothing but friction and elastic joints acts."""
    out = copy.copy(model)
    off = mujoco.mjtDisableBit
    out.opt.gravity[:] = 0.0
    out.opt.disableflags |= int(off.mjDSBL_CONTACT) | int(off.mjDSBL_LIMIT)
    motor = out.actuator_gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR
    out.actuator_group[~motor] = _SILENT
    out.opt.disableactuator |= 1 << _SILENT
    out.actuator_gainprm[motor, 4:7] = 0.0  # kp, ki, kd (sources.md 3.5)
    return out


def _start(model: mujoco.MjModel) -> Array:
    """Return the position to test at, (nq,): the middle of limited joints' ranges."""
    scalar = np.isin(
        model.jnt_type, [int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)]
    )
    limited = np.flatnonzero(model.jnt_limited.astype(bool) & scalar)
    middle = np.array(model.qpos0)
    middle[model.jnt_qposadr[limited]] = model.jnt_range[limited].mean(axis=1)
    return middle
