"""What a diagnosis says: the evidence of a cause, the verdict, and what to record next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.judge.judgement import NamedCause
from stiction_envs.gap.selection.candidates import Candidate, RegressorLibrary
from stiction_envs.gap.selection.confusion import other_links
from stiction_envs.gap.selection.gain import is_implausible

Array = NDArray[np.float64]
STRUCTURE_FROM = 2.0
"""Held-out error of a joint over its noise from which on it may have structure [-]; assumed."""
STRUCTURE = 0.5
"""Part of the squared error that one more cause may take before the rest has structure in speed,
angle, load or time [-]; assumed."""


def percent_gained(nominal: Array, extended: Array) -> float:
    """Return 100 (1 − mean over joints of extended over nominal error) [%]."""
    return float(100 * (1 - np.mean(extended / nominal)))


def percent_lost(without: Array, extended: Array, nominal: Array) -> float:
    """Return the loss when one cause is removed, mean over joints [%].

    A fit without it may be worse on a joint than the nominal model; the loss is limited to that.

    Args:
        without: (n,) error of the extended model without the cause [N·m].
        extended: (n,) error with it [N·m].
        nominal: (n,) error of the nominal model [N·m].
    """
    return float(100 * np.mean((np.minimum(without, nominal) - extended) / nominal))


def described(
    library: RegressorLibrary, terms: list[Candidate], mine: list[Candidate], c: Array
) -> str:
    """Return what is wrong, with the other links that may be the cause."""
    cause = library.causes[mine[0].cause]
    text = cause.describe(library.split(terms, c)[terms.index(mine[0])])
    if assumed := cause.assumption(library.data, mine[0].shape):
        text += f" ({assumed})"
    if not (cause.coupled and cause.body):
        return text
    links = ", ".join(str(t.joint + 1) for t in mine)
    also = ", ".join(map(str, other_links(library, terms, mine)))
    return f"{text} (link {links})" + (f"; link {also} would explain it as well" if also else "")


def evidence(what: str, joints: tuple[int, ...], without: Array, full: Array) -> str:
    """Return one sentence that can be checked against a plot."""
    if not joints:
        return f"{what}, on the arm as a whole"
    j = max(joints, key=lambda k: (without[k - 1] - full[k - 1]) / without[k - 1]) - 1
    return (
        f"{what}: without it joint {j + 1} is off by {without[j]:.3g} N·m "
        f"(held out, root mean square), with it by {full[j]:.3g} N·m"
    )


def verdict_of(
    named: Sequence[NamedCause],
    nominal: Array,
    extended: Array,
    noise: Array,
    library: RegressorLibrary,
    structured: NDArray[np.bool_],
) -> str:
    """Return the verdict of the contract.

    Args:
        named: significant causes that are not minor.
        nominal: (n,) held-out error of the nominal model [N·m].
        extended: (n,) of the model with the causes [N·m].
        noise: (n,) noise floor [N·m].
        library: of the logs.
        structured: (n,) as of `structured`.
    """
    size = np.sqrt(np.mean(np.square(library.data.tau), axis=0))
    own = library.data.settings
    enough = np.maximum(own.verdict.close * noise, own.verdict.small * size)
    far = extended > enough
    farthest = float(np.ptp(library.data.q, axis=0).max())
    seen = len(library.candidates) > 0 and farthest > own.motion.travel_span
    if not seen:
        return "cannot tell"
    if not named:
        if not (nominal > enough).any():
            return "no discrepancy"
        left = (far | structured).any()
        return "cannot tell" if left or library.scale == 0 else "explained"
    if len(named) == 1 and named[0].confused_with and far.any():
        return "cannot tell"
    return "partly explained" if (far | structured).any() else "explained"


def structured(
    library: RegressorLibrary, terms: Sequence[Candidate], left: Array
) -> NDArray[np.bool_]:
    """Return (n,) whether a cause that is not in the model takes much of what it leaves of a joint.

    Args:
        library: of the logs.
        terms: the model.
        left: (n,) held-out error over the noise [-].
    """
    grams, model = library.grams, library.model_columns(terms)
    near, squares = grams.around(model), grams.errors(model)
    have = {(t.cause, t.joint) for t in terms if not t.small}
    out = np.zeros(len(left), dtype=bool)
    for j in np.flatnonzero(left > STRUCTURE_FROM):
        others = [
            t
            for t in library.candidates
            if t.joint == j and not library.causes[t.cause].coupled and (t.cause, j) not in have
        ]
        taken = near.reductions([library.model_columns([t]) for t in others])
        out[j] = any(
            size * library.inflation[j] > STRUCTURE * squares[j]
            and not is_implausible(library, library.beside([*terms, term]), [term])
            for term, size in zip(others, taken, strict=True)
        )
    return out


def what_to_record(
    named: Sequence[NamedCause], not_identifiable: dict[str, str]
) -> tuple[str, ...]:
    """Return what to record next, most useful first."""
    out = []
    for c in named:
        mine = cause_named(c.name).what_to_record
        for other in c.confused_with:
            out.append(
                f"to tell {c.name} from {other}: {mine}; {cause_named(other).what_to_record}"
            )
    for name, reason in not_identifiable.items():
        out.append(f"to see {name} ({reason}): {cause_named(name).what_to_record}")
    return tuple(dict.fromkeys(out))
