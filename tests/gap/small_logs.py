"""Small logs with something hidden in them: RNEA of pinocchio plus what a test adds."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.causes import Part, cause_named
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs, model_of
from stiction_envs.gap.model_file import Nominal, dump
from stiction_envs.gap.signals.bristle import bristles
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.friction_state import PRESLIDING_DISTANCE
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.examples import log_csv
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm, load_arm

RATE = 200.0


def motion(n: int, seconds: float = 15.0, seed: int = 1, size: float = 0.6):
    """Time and Fourier angles, speeds, accelerations about zero."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    q, dq, ddq = (np.zeros((len(t), n)) for _ in range(3))
    for k in range(1, 5):
        w = 2 * np.pi * 0.1 * k
        a, b = rng.normal(size=(2, n)) / np.sqrt(k)
        s, c = np.sin(w * t)[:, None], np.cos(w * t)[:, None]
        q += a * s + b * c
        dq += w * (a * c - b * s)
        ddq += -(w**2) * (a * s + b * c)
    scale = size / np.abs(q).max(axis=0)  # within the joints' limits
    return t, q * scale, dq * scale, ddq * scale


def hidden(
    arm: Arm,
    add: Callable[..., np.ndarray] = lambda q, dq, ddq: np.zeros_like(q),
    *,
    true: Arm | None = None,
    noise: float = 0.01,
    seconds: float = 15.0,
    seed: int = 1,
    size: float = 0.6,
) -> JointLog:
    """A log of ``true`` (by default the arm itself) with ``add(q, dq, ddq)`` on top."""
    t, q, dq, ddq = motion(arm.n, seconds, seed, size)
    q = q + arm.rest
    tau = inverse_dynamics((true or arm).pinocchio(), q, dq, ddq) + add(q, dq, ddq)
    rng = np.random.default_rng(seed + 100)
    return JointLog(
        source="made.csv",
        t=t,
        q=q + 1e-6 * rng.normal(size=q.shape),
        dq=None,
        tau=tau + noise * rng.normal(size=q.shape),
    )


def sliding(q: np.ndarray) -> np.ndarray:
    """Direction of motion of joints whose dry friction bites within the engine's distance."""
    return bristles(q, [slice(0, len(q))], np.full((q.shape[1], 1), PRESLIDING_DISTANCE))[..., 0]


def data_of(arm: Arm, log: JointLog, friction: FrictionParameters | None = None) -> Data:
    """Return a log against the arm with a friction, by default none."""
    return assemble(arm, prepare([log]), friction=friction)


def with_torque(data: Data, torque: np.ndarray) -> Data:
    """Return data in which the arm asks for a torque (T, n) more [N·m]."""
    return replace(data, recording=replace(data.recording, tau=data.tau + torque))


def panda(**options) -> Arm:
    return load_arm("panda", **options)


def dry(q, dq, ddq):
    """Dry friction of 0.5 N·m, for `hidden`."""
    return 0.5 * sliding(q)


def sticky(q, dq, ddq):
    """Dry and viscous friction, for `hidden`."""
    return 0.5 * sliding(q) + 0.4 * dq


def found(arm: Arm, *logs: JointLog) -> Diagnosis:
    """Diagnose with a spring, dry friction and an offset as the only causes."""
    named = [replace(x, source=f"log{k}.csv") for k, x in enumerate(logs, 1)]
    names = ("coulomb_friction", "external_spring", "torque_offset")
    return diagnose_logs(named, arm, causes=[cause_named(x) for x in names])


def only(log: JointLog, joint: int) -> JointLog:
    """The log with one joint moving and the others at rest."""
    q = np.array(log.q)
    rest = np.arange(q.shape[1]) != joint
    q[:, rest] = q[0, rest]
    return replace(log, q=q)


def write_csv(path, log: JointLog) -> None:
    path.write_text(log_csv(log.t, digits=9, q=log.q, tau=log.tau))


def write_model(folder: Path, found: Diagnosis | Nominal) -> Path:
    """Write ``model.toml`` of a diagnosis into a folder; return its path."""
    path = folder / "model.toml"
    model = found if isinstance(found, Nominal) else model_of(found)
    path.write_text(dump(model), encoding="utf-8")
    return path


def part(name: str, joint: int, *coefficients: float, shape: tuple[float, ...] = ()) -> Part:
    numbers = tuple(map(float, coefficients))
    return Part(cause=name, joint=joint, shape=tuple(map(float, shape)), coefficients=numbers)
