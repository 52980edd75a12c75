"""Bodies of an arm as causes change them: torque per parameter of a body, and the changed arm.

A body is its pseudo-inertia J = [[Σ, h], [hᵀ, m]] with Σ = ∫ρ x xᵀ dV about the joint's origin
(P. Wensing, S. Kim, J.-J. Slotine, "Linear matrix inequalities for physically consistent inertial
parameter identification", IEEE RA-L 2018): torque is linear in J, and a body can exist where J is
positive definite. Two families of four parameters each keep it so:

* a link that is heavier by a factor and moved: J' = (1 + s) T(δ) J T(δ)ᵀ;
* a payload, a solid sphere of `load_arm`'s small radius about its centre, with six more parameters
  for a larger inertia where the motion shows it.

Parameters that the motion does not excite stay at the nominal, or at the sphere's.
"""

import dataclasses
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from stiction_envs.arrays import Array
from stiction_envs.gap.signals.recording import Recording
from stiction_envs.gap.signals.rigid_body import under
from stiction_envs.robots import Arm, mjcf
from stiction_envs.robots.arm_toml import payload_radius
from stiction_envs.robots.consistent import tolerances
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import (
    from_pseudo_inertia,
    inertial_parameters,
    pseudo_inertia,
    torque_regressor,
)

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_SPREADS = np.zeros((6, 3, 3))
for _k, (_a, _b) in enumerate(_PAIRS):
    _SPREADS[_k, _a, _b] = _SPREADS[_k, _b, _a] = 1.0
LEAST_EFFECT = 1e-3
"""Torque of one standard deviation of the prior, root mean square over the motion and summed over
joints, below which a direction is left out [N·m]; assumed: below any sensor's noise."""
BASIS_ROWS = 1000
"""Number of rows from which these directions are found [-]; assumed: hundreds of poses show all."""
ROWS = 4000
"""Number of rows that are computed at once: all of them would fill the memory; assumed."""


def body_columns(recording: Recording, *gravity: float) -> NDArray[np.float32]:
    """Return (T, n, 4 n + 10 + r): torque per `link_directions` of each link, per parameter of the
    last one, and per direction of `link_basis`.

    Args:
        recording: motion of the arm.
        gravity: x, y, z of the acceleration [m/s²]; none for the arm's.
    """
    model, n = under(recording.pinocchio, gravity), recording.n
    each = [link_directions(phi) for phi in inertial_parameters(model)]
    basis = recording.derived(link_basis)
    # the columns of a joint are neighbours in memory, as `JointColumns` keeps them: none is copied
    memory = np.empty((n, 4 * n + 10 + basis.shape[1], len(recording.t)), dtype=np.float32)
    out = np.moveaxis(memory, 2, 0)
    for start in range(0, len(out), ROWS):
        rows = slice(start, start + ROWS)
        w = torque_regressor(model, *(x[rows] for x in (recording.q, recording.dq, recording.ddq)))
        for k, directions in enumerate(each):
            out[rows, :, 4 * k : 4 * k + 4] = w[..., 10 * k : 10 * k + 10] @ directions
        out[rows, :, 4 * n : 4 * n + 10] = w[..., -10:]
        out[rows, :, 4 * n + 10 :] = w @ basis
    return out


def link_basis(recording: Recording) -> Array:
    """Return (10 n, r) changes of all links' parameters, of one standard deviation each.

    They are the principal directions, by the torque along the motion, of the prior's covariance
    F Fᵀ (`Recording.link_factor`). Those that hardly change any torque are left out.
    """
    factor = link_factor(recording)
    squares = recording.derived(link_squares).sum(axis=0)
    square, v = np.linalg.eigh(factor.T @ squares @ factor)
    return np.asarray(factor @ v[:, square > LEAST_EFFECT**2])


def link_factor(recording: Recording) -> Array:
    """Return (10 n, k) F, F Fᵀ being the covariance of the links' parameters before the logs."""
    if recording.link_factor is not None:
        return recording.link_factor
    return tolerances(inertial_parameters(recording.pinocchio))


def link_squares(recording: Recording) -> Array:
    """Return (n, 10 n, 10 n) mean products of each joint's torques per unit of link parameters."""
    thin = slice(None, None, max(1, len(recording.t) // BASIS_ROWS))
    motion = (x[thin] for x in (recording.q, recording.dq, recording.ddq))
    w = np.swapaxes(torque_regressor(recording.pinocchio, *motion), 0, 1)
    return np.asarray(np.swapaxes(w, 1, 2) @ w / w.shape[1])


def link_masses(recording: Recording) -> Array:
    """Return (n,) mass of each link and of what is fixed to it [kg]."""
    return inertial_parameters(recording.pinocchio)[:, 0]


def link_directions(phi: Array) -> Array:
    """Return (10, 4) change of a link's parameters per kilogram, and per kg·m that it is moved.

    First order: mass scales the whole body; a shift by δ adds the moment d = m' δ.
    """
    _, h, m = _parts(phi)
    return np.stack([np.asarray(phi) / m, *_moments(h / m)], axis=1)


def changed_link(phi: Array, coefficients: Array) -> Array:
    """Return (10,) a link with other mass and centre, J' = (1 + s) T(δ) J T(δ)ᵀ.

    Args:
        phi: (10,) parameters of the link.
        coefficients: (4,) mass [kg] and moment d = m' δ [kg·m] that are added.
    """
    more, d = float(coefficients[0]), np.asarray(coefficients[1:])
    _, _, m = _parts(phi)
    factor, shift = 1.0 + more / m, np.eye(4)
    shift[:3, 3] = d / (m + more)
    return np.asarray(from_pseudo_inertia(factor * shift @ pseudo_inertia(phi) @ shift.T))


def payload_directions(centre: Array) -> Array:
    """Return (10, 10) parameters of a payload per kilogram, per kg·m of moment, and per kg·m² of Σ.

    Σ = h hᵀ/m of a sphere, plus its own, is linearised in (m, h) about a centre (3,) [m], and exact
    for a payload with that centre. The last six are additions to Σ: xx, yy, zz, xy, xz, yz.
    """
    c = np.asarray(centre, float)
    mass = _parameters(_sphere() - np.outer(c, c), np.zeros(3), 1.0)
    spreads = [_parameters(unit, np.zeros(3), 0.0) for unit in _SPREADS]
    return np.stack([mass, *_moments(c), *spreads], axis=1)


def _moments(c: Array) -> list[Array]:
    """Return (10,) parameters per kg·m of moment along x, y and z, of a centre (3,) [m]."""
    return [_parameters(np.outer(c, axis) + np.outer(axis, c), axis, 0.0) for axis in np.eye(3)]


def payload_of(coefficients: Array, least: float) -> Array:
    """Return (10,) parameters about the flange of a possible payload, or of a negative mass.

    Args:
        coefficients: (10,) factors of `payload_directions`.
        least: as of `possible`.
    """
    mass, more = float(coefficients[0]), np.tensordot(coefficients[4:], _SPREADS, axes=1)
    phi = sphere(mass, coefficients[1:4] / mass) + _parameters(more, np.zeros(3), 0.0)
    return possible(phi, sphere(mass, np.zeros(3)), least) if mass > 0 else phi


def sphere(mass: float, centre: Array) -> Array:
    """Return (10,) parameters of a payload with its centre at (3,) [m]."""
    c = np.asarray(centre, float)
    return mass * _parameters(_sphere() + np.outer(c, c), c, 1.0)


def _sphere() -> Array:
    """Return (3, 3) Σ of a kilogram about its centre [m²]."""
    return 0.2 * payload_radius() ** 2 * np.eye(3)


def from_flange(model: pin.Model, arm: Arm) -> Array:
    """Return (10, 10) map of a body's parameters about the flange to those about the last joint."""
    to_joint = model.frames[model.getFrameId(arm.end_effector)].placement.homogeneous
    return np.stack(
        [from_pseudo_inertia(to_joint @ pseudo_inertia(x) @ to_joint.T) for x in np.eye(10)], axis=1
    )


def with_payload(arm: Arm, phi: Array, least: float) -> Arm:
    """Return an arm with a body on its flange; a negative mass is subtracted from the last link.

    Args:
        arm: the arm.
        phi: (10,) parameters of the body about the flange.
        least: as of `possible`.
    """
    if phi[0] > 0:
        root, body = ET.fromstring(arm.xml), pin.Inertia.FromDynamicParameters(phi)
        before = set(root.iter("body"))
        x, y, z = (float(v) for v in body.lever)
        mjcf.add_payload(root, arm.end_effector, (float(body.mass), x, y, z), payload_radius())
        (new,) = set(root.iter("body")) - before
        element, i = new.find("inertial"), body.inertia
        assert element is not None
        del element.attrib["diaginertia"]
        element.set("fullinertia", mjcf.numbers([i[a, b] for a, b in _PAIRS]))
        return dataclasses.replace(arm, xml=ET.tostring(root, encoding="unicode"))
    model = arm.pinocchio()
    links = inertial_parameters(model)
    links[-1] = possible(links[-1] + from_flange(model, arm) @ phi, links[-1], least)
    return with_inertias(arm, links)


def possible(phi: Array, was: Array, least: float) -> Array:
    """Return a physically consistent body of the same mass and centre as (10,) ``phi``.

    Args:
        phi: parameters of positive mass, consistent or not.
        was: parameters of a reference body.
        least: least eigenvalue of the inertia about the centre, over the mean of the reference's
            [-].
    """
    sigma, h, m = _parts(phi)
    before, moment, mass = _parts(was)
    smallest = least * float(np.trace(before - np.outer(moment, moment) / mass)) / 3
    values, vectors = np.linalg.eigh(sigma - np.outer(h, h) / m)
    if values[0] >= smallest:
        return np.asarray(phi)
    own = (vectors * np.maximum(values, smallest)) @ vectors.T
    return _parameters(own + np.outer(h, h) / m, h, m)


def leaning(arm: Arm, side: Array) -> Arm:
    """Return an arm whose gravity has a share (2,) of its size along x and y [-]."""
    root = ET.fromstring(arm.xml)
    option = root.find("option")
    if option is None:
        option = ET.Element("option")
        root.insert(0, option)
    was = np.array(mjcf.read_numbers(option, "gravity", (0.0, 0.0, -9.81)))
    option.set("gravity", mjcf.numbers(leaned(was, side)))
    return dataclasses.replace(arm, xml=ET.tostring(root, encoding="unicode"))


def leaned(gravity: Array, side: Array) -> Array:
    """Return gravity (3,) [m/s²] of the same size with a share (2,) of it added along x and y."""
    g = float(np.linalg.norm(gravity))
    xy = gravity[:2] + g * np.asarray(side)
    return np.array([*xy, np.sign(gravity[2]) * np.sqrt(max(g * g - float(xy @ xy), 0.0))])


def _parts(phi: Array) -> tuple[Array, Array, float]:
    """Return Σ (3, 3), h (3,) and m of parameters (10,)."""
    j = pseudo_inertia(phi)
    return j[:3, :3], j[:3, 3], float(j[3, 3])


def _parameters(sigma: Array, h: Array, m: float) -> Array:
    """Return (10,) of Σ (3, 3), h (3,) and m."""
    j = np.empty((4, 4))
    j[:3, :3], j[:3, 3], j[3, :3], j[3, 3] = sigma, h, h, m
    return np.asarray(from_pseudo_inertia(j))
