"""The identification that failed in the thesis (section 4.1, Table 4.1).

What RosDyn does, written anew after its source (github.com/CNR-STIIMA-IRAS/rosdyn, file
rosdyn_par_estim.cpp, commit 449201e): an orthonormal basis of the base parameters from the singular
vectors of the regressor at random states within ±1, every joint's torque weighing the same, plain
least squares on raw signals, then the ten parameters of each link that lie nearest to the nominal
ones. Nothing asks whether a link with these parameters can exist. Accelerations are differences of
logged speeds, as in the thesis (section 5.1: "the acceleration was quite noisy").
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm
from stiction_envs.robots.regressor import consistent, inertial_parameters, torque_regressor

Array = NDArray[np.float64]
MOST_ROWS = 10_000
"""Samples of all logs together; more are thinned out evenly; assumed."""
STATES = 1000
"""Random states, as there."""
ZERO = 1e-10
"""Singular values below this part of the largest are zero (there: below this number);
assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Unconstrained:
    """Links as least squares gives them."""

    phi: Array
    """(n, 10) about the joints."""
    coulomb: Array
    """(n,) [N·m]."""
    viscous: Array
    """(n,) [N·m·s/rad]."""

    @property
    def negative_masses(self) -> NDArray[np.int64]:
        """Links (from 1) with a negative mass."""
        return np.flatnonzero(self.phi[:, 0] < 0) + 1

    @property
    def impossible(self) -> NDArray[np.int64]:
        """Links (from 1) that no body can be."""
        return np.flatnonzero(~consistent(self.phi)) + 1

    def parameters(self) -> Array:
        """Return (12 n,): links, Coulomb, viscous."""
        return np.concatenate([self.phi.ravel(), self.coulomb, self.viscous])


def _columns(arm: Arm, q: Array, dq: Array, ddq: Array) -> Array:
    """Return (T n, 12 n) columns of links, Coulomb and viscous friction."""
    links = torque_regressor(arm.pinocchio(), q, dq, ddq)
    own = np.zeros((len(q), arm.n, 2, arm.n))
    j = np.arange(arm.n)
    own[:, j, 0, j], own[:, j, 1, j] = np.sign(dq), dq
    whole = np.concatenate([links, own.reshape(len(q), arm.n, -1)], axis=2)
    return np.asarray(whole.reshape(-1, 12 * arm.n))


def rosdyn(logs: Sequence[JointLog], arm: Arm) -> Unconstrained:
    """Return links and friction of an arm by RosDyn's least squares on raw signals.

    Args:
        logs: of the arm.
        arm: its nominal links fill up what the torques do not show.
    """
    rng = np.random.default_rng(0)
    states = rng.uniform(-1, 1, (3, STATES, arm.n))
    triangle = np.linalg.qr(_columns(arm, *states), mode="r")
    _, sizes, vectors = np.linalg.svd(triangle)
    seen = vectors[: int((sizes > ZERO * sizes[0]).sum())].T
    step = max(1, sum(len(x.t) for x in logs) // MOST_ROWS)
    rows, torques = [], []
    for log in logs:
        for part in log.segments:
            if part.stop - part.start < 3:
                continue
            t, q = log.t[part], log.q[part]
            dq = np.gradient(q, t, axis=0) if log.dq is None else log.dq[part]
            ddq = np.gradient(dq, t, axis=0)
            rows.append(_columns(arm, q[::step], dq[::step], ddq[::step]) @ seen)
            torques.append(log.tau[part][::step].ravel())
    x, y = np.concatenate(rows), np.concatenate(torques)
    both = np.asarray(np.linalg.qr(np.column_stack([x, y]), mode="r"))
    u, s, v = np.linalg.svd(both[:-1, :-1])
    base = v.T @ ((u.T @ both[:-1, -1]) / s)
    nominal = np.concatenate([inertial_parameters(arm.pinocchio()).ravel(), np.zeros(2 * arm.n)])
    full = nominal + seen @ (base - seen.T @ nominal)
    n = arm.n
    return Unconstrained(
        phi=full[: 10 * n].reshape(n, 10),
        coulomb=full[10 * n : 11 * n],
        viscous=full[11 * n :],
    )
