"""Every possible ``model.toml`` runs an SJE: no simulation diverges."""

from pathlib import Path

import numpy as np
import pytest

from stiction_envs import load_model
from stiction_envs.friction.model import StickingModel
from stiction_envs.friction.parameters import load_friction
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.gap.causes import Part
from stiction_envs.gap.extended_model import Extension, extend
from stiction_envs.gap.model_file import Nominal
from stiction_envs.hidden.worlds import scattered
from stiction_envs.plant import Plant
from stiction_envs.robots import Arm, load_arm
from stiction_envs.robots.regressor import inertial_parameters
from tests.gap.small_logs import data_of, hidden, part
from tests.robots.arms import write_arms

ROBOTS = ("panda", "iiwa14", "two")
SIMULATIONS = 16


def arm_of(robot: str, folder: Path) -> tuple[Arm, str]:
    name = str(write_arms(folder) / "two.urdf") if robot == "two" else robot
    return load_arm(name), name


def drawn(rng: np.random.Generator, arm: Arm) -> tuple[Part, ...]:
    """Draw causes that a diagnosis could name; friction never drives a joint, bodies exist."""

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    links = inertial_parameters(arm.pinocchio())
    parts = [part("link_tolerances", 0, *(scattered(links, 0.1, rng) - links).ravel())]
    mass, c, radius = log(0.1, 0.3 * links[:, 0].sum()), rng.normal(0, 0.05, 3), 0.05
    about = mass * (0.4 * radius**2 * np.eye(3) + c @ c * np.eye(3) - np.outer(c, c))
    body = (mass, *(mass * c), *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]])
    parts.append(part("payload", 0, *body))
    for j, limit in enumerate(arm.limits.torque, start=1):
        dry = log(2e-3, 0.05) * min(limit, 100.0)
        side = rng.choice([rng.uniform(-1, 1), 1.0, -1.0])
        some: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
            "viscous_friction": ((dry * log(0.05, 3),), ()),
            "direction_asymmetry": ((dry * side,), ()),
            "stribeck_friction": ((dry * rng.uniform(0, 1),), (log(1e-3, 0.5),)),
            "load_dependent_friction": ((rng.uniform(0, 0.2),), ()),
            "presliding_hysteresis": ((dry,), (log(1e-6, 0.1),)),
            "position_dependent_friction": (
                tuple(dry * rng.uniform(-0.3, 0.3, 2)),
                (float(rng.integers(1, 300)),),
            ),
            "torque_offset": ((dry * rng.normal(),), ()),
            "link_inertia": ((log(1e-3, 1.0),), ()),
            "joint_elasticity": ((1.0,), (log(300, 6e4),)),
            "external_spring": ((log(0.1, 10), rng.normal()), ()),
        }
        parts.append(part("coulomb_friction", j, dry))
        for cause, (coefficients, shape) in some.items():
            if rng.random() < 0.5:
                parts.append(part(cause, j, *coefficients, shape=shape))
    return tuple(parts)


def written(arm: Arm, nominal: Nominal, path: Path) -> Extension:
    """Write the model file of a log."""
    made = extend(data_of(arm, hidden(arm, seconds=3.0), nominal.friction), nominal)
    path.write_text(made.toml(meta={"title": "made up"}, provenance={}), encoding="utf-8")
    return made


def shaken(model: StickingModel, rng: np.random.Generator) -> np.ndarray:
    """Angles in 0.4 s under torques of a few times the friction, from random poses."""
    plant = Plant(model, SIMULATIONS, threads=1)
    low, high = np.clip(model.arm.limits.position.T, -np.pi, np.pi)
    plant.reset(np.arange(SIMULATIONS), rng.uniform(low, high, (SIMULATIONS, model.n)))
    speed = rng.uniform(0.5, 60, (SIMULATIONS, 1, model.n))
    p = model.parameters
    size = (p.stiction.max(axis=1) + np.abs(p.offset)) * rng.uniform(0, 3, speed.shape)
    return plant.run(size * np.sin(speed * np.arange(400)[None, :, None] * 1e-3))


@pytest.mark.parametrize(
    ("robot", "seeds"),
    [
        *((robot, range(1)) for robot in ROBOTS),
        *(pytest.param(robot, range(1, 16), marks=pytest.mark.slow) for robot in ROBOTS),
    ],
)
def test_no_joint_shakes_in_any_pose(robot, seeds, tmp_path):
    """With the arm's own rotors and without; on the arm that was found and on the nominal one."""
    arm, name = arm_of(robot, tmp_path)
    for seed in seeds:
        rng = np.random.default_rng(seed)
        friction = load_friction(arm.registered_name, arm.n) if seed % 3 == 2 else None
        nominal = Nominal(robot=arm.name, friction=friction, parts=drawn(rng, arm))
        path = tmp_path / "model.toml"
        written(arm, nominal, path)
        found = load_model(path, name)
        for model in (found, sticking_model(arm, path), sticking_model(found.arm, path)):
            assert np.isfinite(shaken(model, rng)).all(), (robot, seed)


def test_friction_that_would_drive_a_joint_is_bounded_and_said(tmp_path):
    """More asymmetry than Coulomb friction, as an offset looks to a diagnosis without one."""
    arm = load_arm("panda")
    parts = [part("coulomb_friction", j, 0.32) for j in range(1, 8)]
    parts.append(part("direction_asymmetry", 7, -0.60))
    path = tmp_path / "model.toml"
    nominal = Nominal(robot="panda", parts=tuple(parts))
    made = written(arm, nominal, path)
    np.testing.assert_allclose(made.friction.stiction[6], [0.032, 0.608])
    said = "asymmetry of joint 7: nine tenths of its Coulomb friction, more would drive it"
    assert said in made.friction_missing
    assert said in path.read_text(encoding="utf-8")
    assert said in made.xml
    assert np.isfinite(shaken(sticking_model("panda", path), np.random.default_rng(0))).all()
