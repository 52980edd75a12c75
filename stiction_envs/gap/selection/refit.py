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
from stiction_envs.gap.selection.whole_models import likelier, with_likely_size
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.friction_state import presliding_distances

Array = NDArray[np.float64]
ROUNDS = 4
"""Largest number of refits while the tilt that is found still changes [-]; assumed: each leaves a
tenth of the error of the one before."""
SAME_LEAN = 1e-3
"""Change of gravity's direction that needs no refit [-]; assumed: 0.01 N·m of 1 kg at 1 m."""
DELAY_ROUNDS = 3
"""Number of times that a delay is fitted again to the model that contains it [-]; assumed."""


def refit(
    library: RegressorLibrary,
    terms: list[Candidate],
    choose: Callable[..., list[Candidate]],
) -> tuple[RegressorLibrary, list[Candidate]]:
    """Return library and terms given the causes of the whole arm, those before where these fail.

    What a payload weighs on a tilted base depends on the tilt, and the tilt that is found on the
    payload: they are found in turn until they stay. A cause of the whole arm that is not found
    again was a stand-in if the logs are likelier without it.

    Args:
        library: of the logs; it cannot be used afterwards.
        terms: that were chosen.
        choose: returns the significant terms of a library; a search may begin with some terms.
    """
    before, causes, least = library.data, library.causes, evidence(library, terms)
    known, tried, found = (library.inflation, library.scale), library.candidates, terms
    again = False
    for _ in range(ROUNDS):
        if (given := given_arm_causes(library, found, before, causes)) is None:
            break
        library = RegressorLibrary(*given, instead_of=library).given(*known)
        refitted = choose(library)
        have = {(t.cause, t.joint) for t in refitted}
        if any((t.cause, t.joint) not in have for t in _of_arm(library, found)):
            # neither of two causes may stand out before the other is found
            library.refine(found)
            refitted = likelier(library, refitted, choose(library, found))
        if not same_arm_causes(terms, refitted) and evidence(library, refitted) < least:
            library = RegressorLibrary(before, list(causes.values()), instead_of=library)
            library = library.given(*known)
            library.refine(tried)  # with the nonlinear parameters that were tried since
            return library, terms
        same = same_arm_causes(found, refitted) and _leans_as_given(library, refitted)
        found = refitted
        if same:
            break
        again = True
    if again and library.scale > 0:
        # what was not given yet looked like noise, and like larger errors of links
        found = with_likely_size(library, found)
    return library, found


def evidence(library: RegressorLibrary, terms: Sequence[Candidate]) -> float:
    """Return the log evidence of a model [nats]."""
    return library.grams.log_evidence(library.model_columns(library.beside(terms)))


def given_arm_causes(
    library: RegressorLibrary,
    terms: Sequence[Candidate],
    data: Data,
    causes: dict[str, Cause],
) -> tuple[Data, list[Cause]] | None:
    """Return data and causes given the causes of the whole arm; None without such causes.

    Small errors of links count where a cause that was named depends on the load.

    Args:
        library: in which the terms were found.
        terms: of the model.
        data: before anything was given.
        causes: likewise, by name.
    """
    carried = _of_arm(library, terms)
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


def _of_arm(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[Candidate]:
    """Return the terms that change the rigid arm."""
    return [t for t in terms if library.causes[t.cause].changes_arm]


def _leans_as_given(library: RegressorLibrary, terms: Sequence[Candidate]) -> bool:
    """Whether gravity in a model is that which its columns assume, but for `SAME_LEAN`."""
    given = library.data.gravity_found
    if not given:
        return True
    change = np.subtract(_gravity(library, _of_arm(library, terms), terms) or given, given)
    return bool(np.linalg.norm(change) < SAME_LEAN * np.linalg.norm(given))


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
