"""Which causes these data cannot distinguish from one that was found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.selection.gain import Gain, gain

Array = NDArray[np.float64]


def confused_with(
    library: RegressorLibrary,
    terms: list[Candidate],
    mine: list[Candidate],
    joints: tuple[int, ...],
    own: Gain,
) -> tuple[str, ...]:
    """Return the causes that explain the same part: the held-out gain of one given the other."""
    name, rest = mine[0].cause, [t for t in terms if t not in mine]
    data, cause = library.data, library.causes[name]
    c = library.grams.fit(library.model_columns(terms))
    out = list(dict.fromkeys(x for t in mine for x in cause.indistinguishable_from(data, t.joint)))
    taken = {t.cause for t in rest}
    for other in library.causes:
        if other == name or other in out or name in library.needs(other):
            continue
        if other in taken:
            if _hardly_two(library, other, terms, mine, c):
                out.append(other)
            continue
        swap = _best_swap(library, other, {j - 1 for j in joints}, rest)
        if swap is None:
            if _looks_the_same(library, other, terms, mine, c):
                out.append(other)
            continue
        still = gain(library, [*rest, *swap, *mine], mine)
        if not still.significant or still.total < data.settings.estimates.hardly_own * own.total:
            out.append(other)
    return tuple(out)


def _looks_the_same(
    library: RegressorLibrary, other: str, terms: list[Candidate], mine: list[Candidate], c: Array
) -> bool:
    """Whether a cause that these data cannot show would look like the one that was found."""
    cause, most = library.causes[other], library.data.settings.estimates.hardly_own
    if cause.arm_wide or cause.coupled:
        return False
    parts = dict(zip(terms, library.split(terms, c), strict=True))
    for term in mine:
        j = term.joint
        if (other, j) not in library.not_identifiable or not cause.is_linear:
            return False
        others = [
            library.columns(t, j)
            for t in terms
            if t not in mine and j in library.affected_joints(t)
        ]
        target, unseen = library.columns(term, j) @ parts[term], Candidate(other, j, ())
        if _own_share(library, j, target, [library.columns(unseen, j), *others]) > most:
            return False
    return True


def _hardly_two(
    library: RegressorLibrary, other: str, terms: list[Candidate], mine: list[Candidate], c: Array
) -> bool:
    """Whether two causes of a model on the same joints can hardly be distinguished here."""
    most = library.data.settings.estimates.hardly_own
    parts = dict(zip(terms, library.split(terms, c), strict=True))
    for term in mine:
        j = term.joint
        if j == ARM or not any((t.cause, t.joint) == (other, j) for t in terms):
            return False
        rest = [t for t in terms if t not in mine and j in library.affected_joints(t)]
        target = library.columns(term, j) @ parts[term]
        with_it, without = (
            _own_share(library, j, target, [library.columns(t, j) for t in some])
            for some in (rest, [t for t in rest if t.cause != other])
        )
        if with_it > most or without <= most:
            return False
    return True


def _own_share(library: RegressorLibrary, joint: int, torque: Array, columns: list[Array]) -> float:
    """Return the part of a torque (T,) that columns (T, ...) on its joint do not explain [-]."""
    weight = np.sqrt(library.weight[:, joint] * (library.data.block >= 0))
    target = torque * weight
    x = np.concatenate([np.zeros((len(target), 1)), *columns], axis=1) * weight[:, None]
    left = target - x @ np.linalg.lstsq(x, target, rcond=None)[0]
    return float(left @ left) / max(float(target @ target), 1e-300)


def _best_swap(
    library: RegressorLibrary, other: str, joints: set[int], rest: list[Candidate]
) -> list[Candidate] | None:
    """Return the terms of another cause, with its best parameters, on the same joints."""
    swap: list[Candidate] = []
    cause = library.causes[other]
    mine = [t for t in library.candidates if t.cause == other and t not in rest]
    if cause.changes_arm and not cause.arm_wide:
        return _best(library, rest, mine)  # a link's torque acts on other joints than its own
    for joint in [ARM] if cause.arm_wide else sorted(joints):
        best = _best(library, [*rest, *swap], [t for t in mine if t.joint == joint])
        if best is None:
            return None
        swap += best
    return swap or None


def _best(
    library: RegressorLibrary, terms: list[Candidate], options: list[Candidate]
) -> list[Candidate] | None:
    """Return the candidate that leaves the least; None without candidates."""
    if not options:
        return None
    left = [float(library.grams.errors(library.model_columns([*terms, x])).sum()) for x in options]
    return [options[int(np.argmin(left))]]


def other_links(
    library: RegressorLibrary, terms: list[Candidate], mine: list[Candidate]
) -> tuple[int, ...]:
    """Return links (from 1) whose mass and centre explain the torque of one of ``mine`` as well.

    Torques show sums of neighbours' masses and moments (base parameters), not each of them.
    """
    have = {(t.cause, t.joint) for t in terms}
    out = set()
    for term in mine:
        rest = [t for t in terms if t != term]
        own = gain(library, terms, [term])
        for link in library.candidates:
            if link.cause != term.cause or (link.cause, link.joint) in have:
                continue
            still = gain(library, [*rest, link, term], [term])
            least = library.data.settings.estimates.hardly_own * own.total
            if not still.significant or still.total < least:
                out.add(link.joint + 1)
    return tuple(sorted(out))
