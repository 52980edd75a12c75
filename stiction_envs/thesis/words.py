"""Names and units that every page about the thesis's tables uses."""

from __future__ import annotations

from stiction_envs.experiments.sje.protocol import Configuration

POSES = {"load": "load", "no_load": "no load"}
UNITS = {
    "rotor_inertia": "kg·m²",
    "bristle_stiffness": "N·m/rad",
    "coulomb_ratio": "F_c/F_s",
    "stribeck_velocity": "rad/s",
    "joint_stiffness": "N·m/rad",
}
"""Unit of every fitted parameter."""


def place(where: Configuration) -> str:
    """Return ``load +`` and the like, with a true minus."""
    return f"{POSES[where.load]} {'+' if where.direction == '+' else '−'}"
