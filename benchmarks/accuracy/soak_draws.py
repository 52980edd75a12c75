"""What a round of `soak` draws: an arm, its model, a friction and a dither per simulation."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.dither.dither import Dither
from stiction_envs.dither.waveforms import WAVEFORMS
from stiction_envs.errors import StictionError
from stiction_envs.friction.model import StickingModel, build
from stiction_envs.friction.parameters import FrictionParameters, load_friction, scaled
from stiction_envs.robots import ARMS, Arm, load_arm

Array = NDArray[np.float64]
NSIM = 64
"""Simulations of an arm; assumed."""
SHIPPED = 0.2
"""Share of rounds on a shipped arm [-]; assumed, as are all ranges below."""


def random_mjcf(rng: np.random.Generator) -> str:
    """Return MJCF of 2 to 9 hinges; second moments are drawn, so that its inertias can exist."""
    n = int(rng.integers(2, 10))
    root = ET.Element("mujoco")
    ET.SubElement(root, "compiler", angle="radian")
    body, at = ET.SubElement(root, "worldbody"), np.array([0.0, 0.0, 0.2])
    torque = np.exp(rng.uniform(np.log(10), np.log(200)))

    def text(x: Any) -> str:
        return " ".join(repr(float(v)) for v in np.ravel(x))

    for i in range(n):
        body = ET.SubElement(body, "body", name=f"l{i + 1}", pos=text(at))
        axis = rng.normal(size=3) if rng.random() < 0.3 else np.eye(3)[rng.integers(3)]
        low, high = -rng.uniform(0.5, 3.1), rng.uniform(0.5, 3.1)
        limit = max(torque * 0.75**i, 5.0)
        ET.SubElement(
            *(body, "joint"),
            name=f"j{i + 1}",
            axis=text(axis / np.linalg.norm(axis)),
            range=text([low, high]),
            actuatorfrcrange=text([-limit, limit]),
        )
        at = rng.normal(size=3)
        at *= rng.uniform(0.05, 0.35) / np.linalg.norm(at)
        mass = np.exp(rng.uniform(np.log(0.2), np.log(5.0))) * 0.85**i
        a, b, c = mass * rng.uniform(0.01, 0.1, 3) ** 2
        turn = rng.normal(size=4)
        ET.SubElement(
            *(body, "inertial"),
            pos=text(at * rng.uniform(0, 1)),
            mass=text(mass),
            quat=text(turn / np.linalg.norm(turn)),
            diaginertia=text([b + c, a + c, a + b]),
        )
    return ET.tostring(root, encoding="unicode")


def draw_arm(rng: np.random.Generator) -> Arm:
    """Return a shipped arm, or one of our own."""
    if rng.random() < SHIPPED:
        return load_arm(str(rng.choice(list(ARMS))))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "own.xml"
        path.write_text(random_mjcf(rng), encoding="utf-8")
        return load_arm(path)


def draw_model(rng: np.random.Generator, arm: Arm) -> StickingModel:
    """Return the arm with generic friction, on some with springs, ripple or load dependence."""
    base, n = load_friction("generic", arm.n), arm.n
    if rng.random() < 0.3:
        some = rng.random(n) < 0.5
        base = base.replace(joint_stiffness=np.where(some, rng.uniform(5e3, 2e4, n), np.inf))
    if rng.random() < 0.5:
        base = base.replace(load_coefficient=rng.uniform(0, 0.02, n), load_high=np.full(n, 30.0))
    base = scaled(base, {"ripple_amplitude": rng.uniform(0, 3, n)})
    while True:  # softer until the bristles are stable on this arm
        try:
            return build(arm, base)
        except StictionError:
            base = scaled(base, {"bristle_stiffness": 0.7})


def draw_friction(rng: np.random.Generator, model: StickingModel) -> FrictionParameters:
    """Return friction (NSIM, n): scaled as far as `check_stability` allows."""
    shape = (NSIM, model.n)

    def factor(most: float) -> Array:
        return np.exp(rng.uniform(-np.log(most), np.log(most), shape))

    wide = {"stiction": 5, "viscous": 5, "stribeck_velocity": 3, "bristle_stiffness": 3}
    p = scaled(model.parameters.tile(NSIM), {k: factor(v) for k, v in wide.items()})
    p = scaled(p, {"rotor_inertia": factor(2), "coulomb_ratio": rng.uniform(0.6, 1.1, shape)})
    if rng.random() < 0.15:  # friction by direction is written in every step: slower
        p = p.replace(stiction=p.stiction * rng.uniform(0.8, 1.2, (*shape, 2)))
    while True:
        try:
            model.bristle_damping_of(p)
            return p
        except StictionError:
            p = scaled(p, {"bristle_stiffness": 0.7})


def draw_dither(rng: np.random.Generator, arm: Arm) -> Dither:
    """Return dither of all waveforms up to the joints' limits, gated on a third of the joints."""
    shape = (NSIM, arm.n)
    gate = np.where(rng.random(shape) < 1 / 3, rng.uniform(0.01, 1.0, shape), np.inf)
    return Dither(
        amplitude=arm.limits.torque * rng.random(shape) ** 3,
        frequency=np.exp(rng.uniform(np.log(2), np.log(200), shape)),
        phase=rng.uniform(0, 2 * np.pi, shape),
        waveform=rng.choice(list(WAVEFORMS), shape),
        gate_velocity=gate,
        seed=rng.integers(2**31, size=NSIM),
    )
