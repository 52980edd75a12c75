"""Experiments of short paths, with friction whose limit cases can be worked out."""

from functools import cache

import numpy as np

from stiction_envs.control.trajectory import Path
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import FLAGS, Case, Run, load_gte_protocol
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.experiments.rig import dither_arrays
from stiction_envs.friction.parameters import FrictionParameters, friction_path, load_friction
from stiction_envs.measured.tables import AmplitudeRow
from stiction_envs.robots import Arm

STILL = np.array([1.0, 0.0, 0.0, 0.0])
SOFT, STIFF = (200.0, 20.0, 0.0), (400.0, 40.0, 0.0)
FREQUENCIES, AMPLITUDES = (50, 30, 30, 50, 15, 15, 15), (0.9, 1.2, 1.6, 2.0, 0.9, 0.6, 0.8)
DITHER = tuple(map(AmplitudeRow, range(1, 8), FREQUENCIES, AMPLITUDES))


def through(name: str, *goals: tuple[float, float, float]) -> Path:
    """Positions relative to the start, orientation kept."""
    return Path(name, np.array(goals), np.tile(STILL, (len(goals), 1)))


PATHS = {
    "there": through("there", (0.03, 0.0, 0.0)),
    "corner": through("corner", (0.03, 0.0, 0.0), (0.0, 0.03, 0.0)),
    "stay": through("stay", (0.0, 0.0, 0.0)),
    "away": through("away", (0.2, 0.0, 0.0)),
}


@cache
def friction(robot: str = "panda", kind: str = "rigid") -> FrictionParameters:
    """The robot's without springs; or next to none at all."""
    p = load_friction(friction_path(robot), 7)
    zero = np.zeros(7)
    p = p.replace(joint_stiffness=zero + np.inf, offset=zero, gravity_error=zero)
    if kind == "rigid":
        return p
    return p.replace(
        stiction=np.full((7, 2), 1e-6),
        viscous=np.zeros((7, 2)),
        bristle_stiffness=zero + 1.0,
        load_coefficient=zero,
        ripple_amplitude=zero,
    )


def bench(
    robot: str | Arm = "panda", kind: str = "rigid", *, tail: float = 1.0, **options: object
) -> GeneratedTrajectoryExperiment:
    """A bench of short paths; ``tail`` is of the protocol."""
    name = robot if isinstance(robot, str) else robot.name
    usual = {"friction": friction(name, kind), "paths": PATHS}
    protocol = load_gte_protocol().replace(tail=tail)
    return GeneratedTrajectoryExperiment(robot, **{**usual, "protocol": protocol, **options})


def one(b: GeneratedTrajectoryExperiment, case: Case, iterations: int = 1) -> Run:
    return b.run([case], iterations=iterations)[0]


def following(b: GeneratedTrajectoryExperiment, case: Case, arms: int = 1) -> GTERig:
    """Arms that are about to follow the path of a case, with its dither."""
    rig, ids = b.rig(arms, 2), np.arange(arms)
    stiffness = np.tile(case.stiffness, (arms, 1))
    rig.begin(ids, [b.path(case.trajectory)] * arms, stiffness, [(i,) for i in ids])
    dither = dither_arrays(case.dither, b.n)
    rig.set_dither(ids, **{k: np.stack([v] * arms) for k, v in dither.items()})
    return rig


def assert_same(a: Run, b: Run) -> None:
    """Both are the same bits, as far as the shorter record goes."""
    k = min(len(a.time), len(b.time))
    assert k > 100
    for name in ("reference", "actual", "mean_square", "dither_power"):
        np.testing.assert_array_equal(getattr(a, name)[:, :k], getattr(b, name)[:, :k])
    for name in ("accepted", "reached", "torque_rate"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    for name in FLAGS:
        np.testing.assert_array_equal(a.flags[name], b.flags[name])
