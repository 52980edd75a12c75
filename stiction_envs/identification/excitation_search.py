"""Search for the Fourier series with the best-conditioned regressor inside all limits.

Rows of the regressor are divided by the joints' torque limits, columns by their size over states
drawn from the whole allowed range: a parameter that a motion hardly excites is then a small column,
and not hidden by the motion's own scale. CMA-ES minimises the condition number's logarithm, with
penalties for limits that are broken; a motion that still breaks one in the end is made smaller (N.
Hansen, A. Ostermeier, "Completely derandomized self-adaptation in evolution strategies", 2001).
"""

from collections.abc import Callable

import numpy as np
from cmaes import CMA

from stiction_envs.arrays import Array
from stiction_envs.errors import ExperimentError
from stiction_envs.gap.signals.rigid_body import gravity_torque, inverse_dynamics
from stiction_envs.identification.excitation_limits import Clearance, MotionBounds, bounds_of
from stiction_envs.identification.excitation_motion import (
    FourierSeries,
    State,
    rest_basis,
)
from stiction_envs.identification.settings import ExcitationSettings
from stiction_envs.robots import Arm
from stiction_envs.robots.regressor import columns_of, structural_base

PENALTY = 10.0  # weight of a limit broken by all of itself, over log κ [-]; assumed
STEP = 0.15
"""First step of the search, over ranges and speed limits [-]; measured on the iiwa 14: after 250
generations κ is 14.9, but 17.8 with a third of this step, and 18.7 with twice the step."""
TIGHT = 0.98
"""Part of each limit at which the penalty begins, so that the end stays inside [-]; assumed."""
STATES = 300  # poses that are tried where the one at rest cannot be held; assumed
TRIES = 400  # random motions that are tried before the search fails; assumed
EASY = 0.8
"""Part of the usable torque that a pose may need to take the place of one at rest [-]; assumed."""
SHRINK, SHRINKS = 0.97, 40
"""A motion that breaks a limit is made smaller by this factor [-], so many times at most; assumed.
"""
SIGN_SPEED = 0.02  # speed at which dry friction's column is at 0.76 of its level [rad/s]; assumed
SAMPLES = 50
"""Per period in the search; assumed: five times the highest harmonic, and twice that of its
squares."""
FINE = 400  # per period in the check of the result; assumed


class ExcitationProblem:
    """One arm's regressor and limits."""

    def __init__(self, arm: Arm, settings: ExcitationSettings) -> None:
        """Find base parameters and the sizes of their columns."""
        self.arm, self.settings = arm, settings
        self.bounds: MotionBounds = bounds_of(arm, settings)
        self.clearance = Clearance(arm, settings)
        self.model = arm.pinocchio()
        carries = bool(arm.stated.gravcomp)
        self.carried = arm.pinocchio(compensated=True) if carries else None
        self.base, self.size = structural_base(arm, ("Fc", "Fv", "offset"))
        self.basis = rest_basis(settings.harmonics)
        self.coarse, self.fine = (np.arange(x) / x * settings.period for x in (SAMPLES, FINE))
        self._home: Array | None = None
        """(n,) where small motions fit if they do not about the pose at rest [rad]."""

    def condition(self, state: State, *, scaled: bool = True) -> float:
        """Return the condition number of the scaled regressor, or as it is in SI units."""
        dq = state[1]
        own = np.stack([np.tanh(dq / SIGN_SPEED), dq, np.ones_like(dq)], axis=2)
        columns = columns_of(self.model, *state, own)[:, :, self.base.kept]
        if scaled:
            columns = columns / self.arm.limits.torque[:, None] / self.size
        x = columns.reshape(-1, self.base.size)
        square = np.linalg.eigvalsh(x.T @ x)  # a third of the time that singular values take
        return float(np.sqrt(square[-1] / square[0])) if square[0] > 0 else np.inf

    def torque(self, state: State) -> Array:
        """Return (T, n) torque of the arm, rotors and springs of its file included [N·m]."""
        q, _, ddq = state
        s = self.arm.stated
        out = inverse_dynamics(self.model, *state) + s.armature * ddq
        out = out + s.stiffness * (q - s.springref)
        return out if self.carried is None else out - gravity_torque(self.carried, q)

    def series(self, x: Array) -> FourierSeries:
        """Return the series of a point (n (2 N − 1),): offsets, then free coefficients."""
        n, k = self.arm.n, self.settings.harmonics
        both = x[n:].reshape(n, -1) @ self.basis.T
        return FourierSeries(
            base_frequency=self.settings.base_frequency,
            offset=x[:n].copy(),
            sine=both[:, :k],
            cosine=both[:, k:],
        )

    def used(self, state: State) -> dict[str, float]:
        """Return the largest part of each limit that a motion uses, margins included [-]."""
        (q, dq, ddq), b = state, self.bounds
        half = (b.high - b.low) / 2
        return {
            "position": float(np.max(np.abs(q - b.low - half) / half)),
            "velocity": float(np.max(np.abs(dq) / b.velocity)),
            "acceleration": float(np.max(np.abs(ddq) / b.acceleration)),
            "torque": float(np.max(np.abs(self.torque(state)) / b.torque)),
        }

    def inside(self, state: State) -> bool:
        """Return whether a motion keeps every limit and distance."""
        if max(self.used(state).values()) > 1.0:
            return False
        return self.clearance.shortfall(state[0], self.settings.clearance) == 0.0

    def random(self, rng: np.random.Generator) -> Array:
        """Return a random point inside all limits, or raise an ExperimentError."""
        found = self._drawn(rng, self.arm.rest) if self._home is None else None
        if found is None:
            self._home = self._held() if self._home is None else self._home
            found = None if self._home is None else self._drawn(rng, self._home)
        if found is not None:
            return found
        b = self.bounds
        still = np.clip(self.arm.rest, b.low, b.high)[None]
        rest = still, np.zeros_like(still), np.zeros_like(still)
        name, most = max(self.used(rest).items(), key=lambda item: item[1])
        if most > 1:
            raise ExperimentError(
                f"{self.arm.name}: at rest the {name} is {most:.2f} of what may be used of its "
                "limit: give it another rest pose, or limits that it can be held with"
            )
        raise ExperimentError(
            f"{self.arm.name}: none of {TRIES} random motions keeps the limits and "
            f"{self.settings.clearance:g} m of clearance, not even small ones about the pose at "
            "rest: give it more room, or another rest pose"
        )

    def _held(self) -> Array | None:
        """Return the first easily held pose on random paths from rest, or None."""
        b = self.bounds
        drawn = np.random.default_rng(0).uniform(b.low, b.high, (STATES, self.arm.n))
        rest = np.clip(self.arm.rest, b.low, b.high)
        away = np.arange(1, STATES + 1)[:, None] / STATES
        for q in (rest + away * (drawn - rest))[:, None]:
            still = q, np.zeros_like(q), np.zeros_like(q)
            easy = np.abs(self.torque(still)) <= EASY * b.torque
            if easy.all() and self.inside(still):
                return np.asarray(q[0])
        return None

    def _drawn(self, rng: np.random.Generator, home: Array) -> Array | None:
        """Return a random point inside all limits, in the end one about a pose (n,), or None."""
        n, b = self.arm.n, self.bounds
        for trial in range(TRIES):
            c = rng.normal(size=(n, self.basis.shape[1]))
            about_zero = self.series(np.concatenate([np.zeros(n), c.ravel()]))
            q, dq, ddq = about_zero.state(self.coarse)
            reach = np.ptp(q, axis=0)
            late = max(0.0, 2 * trial / TRIES - 1)
            part = rng.uniform(0.3, 0.95, n) * (1 - 0.8 * trial / TRIES) * (1 - 0.95 * late)
            scale = np.min(
                [
                    part * (b.high - b.low) / reach,
                    0.95 * b.velocity / np.abs(dq).max(axis=0),
                    0.95 * b.acceleration / np.abs(ddq).max(axis=0),
                ],
                axis=0,
            )
            low = b.low - scale * q.min(axis=0)
            high = b.high - scale * q.max(axis=0)
            middle = rng.uniform(low, high)
            # in the end small ones
            middle += late * (np.clip(home, low, high) - middle)
            x = np.concatenate([middle, (scale[:, None] * c).ravel()])
            series = self.series(x)
            if all(self.inside(series.state(t)) for t in (self.coarse, self.fine)):
                return x
        return None

    def fitted(self, x: Array) -> Array | None:
        """Return a point inside all limits on the fine grid, made smaller if need be, or None."""
        out = x.copy()
        for _ in range(SHRINKS):
            if self.inside(self.series(out).state(self.fine)):
                return out
            out[self.arm.n :] *= SHRINK
        return None

    def cost(self, x: Array) -> float:
        """Return log κ of a point, and penalties where it breaks a limit or comes too near."""
        state = self.series(x).state(self.coarse)
        over = sum(max(0.0, part / TIGHT - 1) for part in self.used(state).values())
        short = self.clearance.shortfall(state[0], self.settings.clearance / TIGHT + 0.01)
        return float(np.log(self.condition(state)) + PENALTY * (over + short / SAMPLES))


def search(
    problem: ExcitationProblem, x: Array, progress: Callable[[], None]
) -> tuple[Array, float] | None:
    """Return the point that CMA-ES reaches from ``x``, inside all limits, and its κ."""
    b = problem.bounds
    step = np.repeat(STEP * b.velocity, problem.basis.shape[1])
    step = np.concatenate([STEP * (b.high - b.low), step])
    optimizer = CMA(mean=np.zeros(len(x)), sigma=1.0, seed=1)
    for _ in range(problem.settings.iterations):
        drawn = [optimizer.ask() for _ in range(optimizer.population_size)]
        optimizer.tell([(z, problem.cost(x + step * z)) for z in drawn])
        progress()
    inside = problem.fitted(x + step * optimizer.mean)
    if inside is None:
        return None
    return inside, problem.condition(problem.series(inside).state(problem.fine))
