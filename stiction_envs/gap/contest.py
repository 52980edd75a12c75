"""One thing before many: a cause of the whole arm against the crowd of small ones it may stand for.

Forward selection adds one term at a time, and a crowd may have gathered before the one thing that
explains it was worth its place. Models as a whole then compete by their description length,

    L = ½ Σ_j N_j log(1 + e_j) + ½ k log N

with the held-out squared error e_j of joint j in units of its noise, N_j independent observations
of it, and k parameters (J. Rissanen, "Modeling by shortest data description", 1978): a parameter
costs half the logarithm of the observations, however good it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stiction_envs.gap.candidates import Candidate, RegressorLibrary
from stiction_envs.gap.selection import gain, means_nothing, pruned


def description_length(library: RegressorLibrary, terms: Sequence[Candidate]) -> float:
    """Return the description length of the logs' torque under a model [nats]."""
    grams = library.grams
    left = grams.held_out(library.model_columns(terms)).sum(axis=1)
    rows = np.array([max(float(g.count.sum()), 1.0) for g in grams.joints])
    seen = rows / library.independent_rows
    fit = 0.5 * float(np.sum(seen * np.log1p(left / rows)))
    return fit + 0.5 * library.complexity(terms) * float(np.log(max(seen.sum(), 2.0)))


def contested(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[Candidate]:
    """Return a model in which a wide cause has taken the place of what it makes needless.

    Every cause that changes the arm (a payload, a tilt, a link), and is not in the model, is put
    into it and all that is then no longer significant taken out; the shortest of these models
    stands, if it is shorter than the one that was given.
    """
    out, best = list(terms), description_length(library, terms)
    while True:
        have = {(t.cause, t.joint) for t in out}
        found: list[Candidate] | None = None
        for wide in library.candidates:
            if (wide.cause, wide.joint) in have or not library.causes[wide.cause].changes_arm:
                continue
            model = [*out, wide]
            if (
                means_nothing(library, model, [wide])
                or not gain(library, model, [wide]).significant
            ):
                continue
            model = pruned(library, model)
            length = description_length(library, model)
            if len(model) <= len(out) and wide in model and length < best:
                found, best = model, length
        if found is None:
            return out
        out = found
