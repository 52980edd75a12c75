"""Fit again given the causes that were found: columns given a payload, a tilt, a delay.

Friction, gaps and springs depend on the load of the gears. A delay shifts all torques, friction
too, and not only to first order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.causes import Cause, Shape
from stiction_envs.gap.causes.body.bodies import leaned
from stiction_envs.gap.causes.log.actuator_delay import ActuatorDelay
from stiction_envs.gap.links import with_found_links
from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.friction_state import presliding_distances

Array = NDArray[np.float64]
DELAY_ROUNDS = 3
"""Number of times that a delay is fitted again to the model that contains it [-]; assumed."""


def refit(
    library: RegressorLibrary,
    terms: list[Candidate],
    choose: Callable[[RegressorLibrary], list[Candidate]],
) -> tuple[RegressorLibrary, list[Candidate]]:
    """Return library and terms given the causes of the whole arm, those before where they differ.

    Args:
        library: of the logs; it cannot be used afterwards.
        terms: that were chosen.
        choose: returns the significant terms.
    """
    if (given := given_arm_causes(library, terms)) is None:
        return library, terms
    before, known, tried = library.data, (library.inflation, library.scale), library.candidates
    causes = list(library.causes.values())
    library = RegressorLibrary(*given, instead_of=library).given(*known)
    refitted = choose(library)
    if same_arm_causes(terms, refitted):
        return library, refitted
    library = RegressorLibrary(before, causes, instead_of=library).given(*known)
    library.refine(tried)  # with the nonlinear parameters that were tried since
    return library, terms


def given_arm_causes(
    library: RegressorLibrary, terms: Sequence[Candidate]
) -> tuple[Data, list[Cause]] | None:
    """Return data and causes given the causes of the whole arm; None without such causes.

    Small errors of links count where a cause that was named depends on the load.
    """
    data, causes = library.data, library.causes
    carried = [t for t in terms if causes[t.cause].changes_arm]
    if not any(causes[t.cause].depends_on_load for t in terms if not t.small):
        carried = []
    delay = _delay(library, terms)
    if not carried and delay is None:
        return None
    if delay is not None:
        late, shift = delay
        c = library.split(terms, library.grams.fit(library.model_columns(terms)))
        lengths = c[list(terms).index(late)].tolist()
        causes = {
            **causes,
            shift.name: shift.acting_on(data.nominal + _without_delays(library, terms), lengths),
        }
        if not data.has_friction:
            # while the delay was unknown, it made reversals look longer
            data = _presliding_given_delay(data, shift, late.shape, lengths[0])
    if carried:
        torque, gravity = _torque(library, terms, carried), _gravity(library, carried, terms)
        arm = None
        if any(t.small for t in carried):
            arm = with_found_links(library, terms, library.grams.fit(library.model_columns(terms)))
        data = data.carrying(torque, gravity, arm)
    return data, list(causes.values())


def _gravity(
    library: RegressorLibrary, carried: Sequence[Candidate], terms: Sequence[Candidate]
) -> tuple[float, ...]:
    """Return gravity with the tilt that was found, x, y, z [m/s²]; () without a tilt."""
    parts = library.split(terms, library.grams.fit(library.model_columns(terms)))
    found = dict(zip(terms, parts, strict=True))
    side = sum((library.causes[t.cause].lean(found[t]) for t in carried), np.zeros(2))
    if not side.any():
        return ()
    return tuple(float(x) for x in leaned(library.data.pinocchio.gravity.linear, side))


def _presliding_given_delay(data: Data, shift: ActuatorDelay, shape: Shape, length: float) -> Data:
    """Return data with presliding distances of dry friction, given the delay."""

    def late(torque: Array) -> Array:
        return torque + length * shift.shifted(data, torque, shape)

    logged = np.stack([late(x) for x in data.nominal.T], axis=1)
    return data.with_presliding(presliding_distances(data.recording, data.tau - logged, late))


def same_arm_causes(terms: Sequence[Candidate], refitted: Sequence[Candidate]) -> bool:
    """Whether all causes that were assumed are found again."""
    return {t.cause for t in terms if t.joint == ARM and not t.small} <= {t.cause for t in refitted}


def refine_delay(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[Candidate]:
    """Apply a delay to the torque of the model that contains it, where this fits better."""
    out, grams = list(terms), library.grams
    for _ in range(DELAY_ROUNDS):
        delay = _delay(library, out)
        if delay is None or not delay[1].acts_on_all:
            break
        late, cause = delay
        at = out.index(late)
        torque = library.data.nominal + _without_delays(library, out)
        tried = [Candidate(late.cause, late.joint, x) for x in cause.nearby(late.shape)]
        before = float(grams.errors(library.model_columns(out)).sum())
        library.causes[late.cause] = cause.acting_on(torque)
        library.refine(tried)
        grams = library.grams
        models = [[*out[:at], x, *out[at + 1 :]] for x in tried]
        left = [float(grams.errors(library.model_columns(x)).sum()) for x in models]
        if min(left, default=before) >= before:
            library.causes[late.cause] = cause
            break
        out = models[int(np.argmin(left))]
    return out


def _delay(
    library: RegressorLibrary, terms: Sequence[Candidate]
) -> tuple[Candidate, ActuatorDelay] | None:
    """Return the term that shifts all torques, and its cause; None without one."""
    for term in terms:
        if isinstance(cause := library.causes[term.cause], ActuatorDelay):
            return term, cause
    return None


def _without_delays(library: RegressorLibrary, terms: Sequence[Candidate]) -> Array:
    """Return (T, n) torque of a model without its delay and what may be part of it [N·m]."""
    causes = library.causes
    some = [
        t
        for t in terms
        if not isinstance(causes[t.cause], ActuatorDelay) and not causes[t.cause].resembles_delay
    ]
    return _torque(library, terms, some)


def _torque(
    library: RegressorLibrary, terms: Sequence[Candidate], some: Sequence[Candidate]
) -> Array:
    """Return (T, n) torque of some terms of a model [N·m]."""
    only = library.grams.fit(library.model_columns(terms)) * library.own(terms, some)
    return np.stack([library.torque(terms, only, j) for j in range(library.data.n)], axis=1)
