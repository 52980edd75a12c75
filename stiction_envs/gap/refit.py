"""What was found is taken for granted: columns given a payload, a tilt, a delay.

Friction, gaps and springs feel what the gears carry. A delay is one of all torques, friction's too,
and not its first order.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.causes import Cause, Shape, TorqueShift
from stiction_envs.gap.causes.bodies import leaned
from stiction_envs.gap.signals.dataset import Data

Array = NDArray[np.float64]


def given_what_was_found(
    library: RegressorLibrary, terms: Sequence[Candidate]
) -> tuple[Data, list[Cause]] | None:
    """Return data and causes as they are given what the whole arm has, None if that is nothing."""
    data, causes = library.data, library.causes
    carried = [t for t in terms if causes[t.cause].changes_arm]
    late = _late(library, terms)
    if not carried and late is None:
        return None
    if late is not None:
        c = library.split(terms, library.grams.fit(library.model_columns(terms)))
        lengths = c[list(terms).index(late)].tolist()
        shift = _shift(library, late)
        causes = {
            **causes,
            shift.name: shift.acting_on(data.nominal + _sound(library, terms), lengths),
        }
        if not data.has_friction:
            # as long as the delay was not known, it made reversals look longer
            data = _presliding_given_delay(data, shift, late.shape, lengths[0])
    if carried:
        data = data.carrying(_torque(library, terms, carried), _gravity(library, carried, terms))
    return data, list(causes.values())


def _gravity(
    library: RegressorLibrary, carried: Sequence[Candidate], terms: Sequence[Candidate]
) -> tuple[float, ...]:
    """Return gravity with the lean that was found, x, y, z [m/s²]; () where there is none."""
    parts = library.split(terms, library.grams.fit(library.model_columns(terms)))
    found = dict(zip(terms, parts, strict=True))
    side = sum((library.causes[t.cause].lean(found[t]) for t in carried), np.zeros(2))
    if not side.any():
        return ()
    return tuple(float(x) for x in leaned(library.data.pinocchio.gravity.linear, side))


def _presliding_given_delay(data: Data, shift: TorqueShift, shape: Shape, length: float) -> Data:
    """Return data with the presliding distances that a delay leaves to dry friction."""

    def late(torque: Array) -> Array:
        return torque + length * shift.shifted(data, torque, shape)

    logged = np.stack([late(x) for x in data.nominal.T], axis=1)
    return data.with_presliding_of(data.tau - logged, late)


def found_again(terms: Sequence[Candidate], refitted: Sequence[Candidate]) -> bool:
    """Whether everything that was taken for granted is found again."""
    return {t.cause for t in terms if t.joint == ARM} <= {t.cause for t in refitted}


def settle(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[Candidate]:
    """Let a delay shift the torque of the very model it is a part of, as far as it fits better."""
    out, grams = list(terms), library.grams
    late = _late(library, out)
    if late is None:
        return out
    at = out.index(late)
    for _ in range(library.data.settings.estimates.delay_rounds):
        cause = _shift(library, late)
        if not cause.acts_on_all:
            break
        torque = library.data.nominal + _sound(library, out)
        tried = [Candidate(late.cause, late.joint, x) for x in cause.nearby(out[at].shape)]
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


def _late(library: RegressorLibrary, terms: Sequence[Candidate]) -> Candidate | None:
    """Return the term that shifts all torque, if there is one."""
    return next((t for t in terms if isinstance(library.causes[t.cause], TorqueShift)), None)


def _shift(library: RegressorLibrary, term: Candidate) -> TorqueShift:
    cause = library.causes[term.cause]
    assert isinstance(cause, TorqueShift)
    return cause


def _sound(library: RegressorLibrary, terms: Sequence[Candidate]) -> Array:
    """Return (T, n) torque of a model but for its delay and what may be a part of one [N·m]."""
    causes = library.causes
    some = [
        t
        for t in terms
        if not isinstance(causes[t.cause], TorqueShift) and not causes[t.cause].resembles_delay
    ]
    return _torque(library, terms, some)


def _torque(
    library: RegressorLibrary, terms: Sequence[Candidate], some: Sequence[Candidate]
) -> Array:
    """Return (T, n) torque of some terms of a model [N·m]."""
    only = library.grams.fit(library.model_columns(terms)) * library.own(terms, some)
    return np.stack([library.torque(terms, only, j) for j in range(library.data.n)], axis=1)
