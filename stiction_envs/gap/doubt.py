"""The doubt of causes that a model hands on, and that of an earlier model in later intervals.

A model's coefficients are c + F z, z being independent and standard normal. F has a row for each
coefficient; its columns are those of all diagnoses so far. A cause that is found again is the
difference from what the model has: the earlier doubt is in its interval, and, with the other sign,
in its own rows, so that it is gone from the sum of both.
"""

from collections.abc import Sequence

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.gap.causes import Part
from stiction_envs.gap.judge.problem import ARM, Term
from stiction_envs.gap.links import root_of

Draws = list[list[tuple[Array, tuple[float, ...]]]]
"""For each term its (coefficients, nonlinear parameters) of every draw."""


def found_factor(draws: Draws) -> list[Array]:
    """Return (k, K) rows of F of each term of a diagnosis, by draws of its posterior."""
    if not draws:
        return []
    stacked = [np.array([x for x, _ in each]) for each in draws]
    spread = np.atleast_2d(np.cov(np.concatenate(stacked, axis=1), rowvar=False))
    return np.split(root_of(spread), np.cumsum([x.shape[1] for x in stacked])[:-1])


def earlier_factor(parts: Sequence[Part], term: Term, size: int) -> Array:
    """Return (size, K) rows of F of what earlier diagnoses found of a term's cause on its joint."""
    width = max((len(row) for p in parts for row in p.doubt), default=0)
    out = np.zeros((size, width))
    joint = 0 if term.joint == ARM else term.joint + 1
    for part in parts:
        if (part.cause, part.joint) == (term.cause, joint):
            for row, more in zip(out, part.doubt, strict=False):  # a payload's spread may be new
                row[: len(more)] += more
    return out


def with_earlier(draws: Draws, terms: Sequence[Term], parts: Sequence[Part], seed: int) -> Draws:
    """Return resamples in which what the model had of the same causes is drawn too."""
    rng = np.random.default_rng([seed, 1])
    width = max((len(row) for p in parts for row in p.doubt), default=0)
    z = rng.normal(size=(len(draws[0]) if draws else 0, width))
    out = []
    for term, each in zip(terms, draws, strict=True):
        factor = earlier_factor(parts, term, len(each[0][0]))
        if factor.any():
            each = [(x - factor @ mine, shape) for (x, shape), mine in zip(each, z, strict=True)]
        out.append(each)
    return out
