"""Compare models as a whole: a search adds one term at a time.

Many small terms may be found before the one cause of the whole arm that explains them all. Models
are compared by their likelihood, or by their description length

    L = ½ Σ_j N_j log(1 + e_j) + ½ k log N

with the held-out squared error e_j of joint j in units of its noise, N_j independent observations
of it, and k parameters (J. Rissanen, "Modeling by shortest data description", 1978).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from stiction_envs.gap.causes.log.actuator_delay import ActuatorDelay
from stiction_envs.gap.selection.candidates import Candidate, RegressorLibrary
from stiction_envs.gap.selection.gain import gain, is_implausible, pruned


def with_or_without_random(
    library: RegressorLibrary,
    choose: Callable[[RegressorLibrary], list[Candidate]],
    refine: Callable[[RegressorLibrary, list[Candidate]], list[Candidate]],
) -> list[Candidate]:
    """Return the likelier model: a few bodies explain the arm, or small errors of all its links.

    The library keeps the noise and the size of the random effects under the one that is returned.
    Where a model without bodies leaves little, there is no question.

    Args:
        library: of the logs.
        choose: returns the significant terms.
        refine: returns terms with better nonlinear parameters.
    """
    if not library.random:
        return choose(library)
    if library.data.recording.link_factor is not None:
        # an earlier diagnosis says how well the links are known
        library.given(library.least_inflation, 1.0)
        dense = choose(library)
        library.given(library.noise_under(dense), 1.0)
        return dense
    usual = library.inflation
    # small errors of links would make up for what a first guess leaves
    sparse = prefer_joint_causes(library, refine(library, choose(library)))

    def has_body() -> bool:
        return any(library.causes[t.cause].changes_arm for t in sparse)

    if sparse and not has_body():  # offsets of many joints may be a body, which is in question too
        sparse = prefer_arm_causes(library, sparse)
    left = library.grams.held_out(library.model_columns(sparse)).sum(axis=1)
    most = float(np.sqrt(np.max(left / np.maximum(library.grams.counts, 1.0))))
    # a delay is exact only once it is applied to the whole model, and leaves more until then
    late = any(isinstance(library.causes[t.cause], ActuatorDelay) for t in sparse)
    if not has_body() and (late or most < library.data.settings.verdict.close):
        return sparse
    of_sparse = library.noise_under(sparse)
    library.given(library.least_inflation, 1.0)
    dense = choose(library)
    library.given(np.minimum(of_sparse, library.noise_under(dense)), 1.0)
    each = [_with_likely_bodies(library, x) for x in (sparse, dense)]
    terms = max(each, key=lambda x: _score(library, x))
    _, size = library.likeliest(terms)
    library.given(library.inflation if size else usual, size)
    return library.beside(terms)


def with_likely_size(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[Candidate]:
    """Return a model whose small errors of links, and noise, are as large as it says itself.

    Before what was found is given, what that leaves looks like either of them.
    """
    library.given(library.noise_under(terms), library.scale)
    _, size = library.likeliest(terms)
    library.given(library.inflation, size)
    return library.beside(terms)


def _with_likely_bodies(library: RegressorLibrary, terms: list[Candidate]) -> list[Candidate]:
    """Return a model with the bodies that stand out of small errors of all links.

    Of two bodies, one may be wrong and the other may stand in for the rest of the links; and what
    small errors of any size explain may be a body beside smaller ones. Where a model has neither,
    what it leaves is not of bodies.
    """
    bodies = [t for t in library.candidates if library.causes[t.cause].body]
    if not library.likeliest(terms)[1] and not any(library.causes[t.cause].body for t in terms):
        return terms
    while True:
        have = {(t.cause, t.joint) for t in terms}
        fewer = [[t for t in terms if t != x] for x in bodies if x in terms]
        more = [[*terms, x] for x in bodies if (x.cause, x.joint) not in have]
        likely = max((terms, *fewer, *more), key=lambda x: _score(library, x))
        if likely is terms:
            return terms
        terms = likely


def _score(library: RegressorLibrary, terms: Sequence[Candidate]) -> float:
    """Return the log evidence of a model less what each of its bodies must add to it [nats].

    That is what every cause must, as one of many candidates, and no less than `least_evidence`.
    """
    least = float(np.log(max(len(library.candidates), 1)))
    bodies = [x for x in (library.causes[t.cause] for t in terms) if x.body]
    return library.likeliest(terms)[0] - sum(max(x.least_evidence, least) for x in bodies)


def likelier(library: RegressorLibrary, *models: list[Candidate]) -> list[Candidate]:
    """Return the model with the largest evidence, the first of equals."""
    return max(models, key=lambda x: library.grams.log_evidence(library.model_columns(x)))


def with_set_up(library: RegressorLibrary, terms: list[Candidate]) -> list[Candidate]:
    """Return a model with small errors of the set-up, where that makes the logs likelier.

    They are added once causes are known: in a search that begins with nothing they would take what
    belongs to causes that are not found yet. A cause that they make superfluous goes.
    """
    if library.scale == 0:
        return terms
    grams = library.grams

    def evidence(model: Sequence[Candidate]) -> float:
        return grams.log_evidence(library.model_columns(model))

    out, before = library.add_set_up(terms), evidence(terms)
    if evidence(out) <= before:
        return terms
    least = float(np.log(max(len(library.candidates), 1)))
    while True:
        known = evidence(out)
        each = {
            t: known - evidence([x for x in out if x != t])
            for t in out
            if not t.small and not library.causes[t.cause].changes_arm
        }
        weakest = min(each, key=lambda t: each[t], default=None)
        if weakest is None or each[weakest] > least:
            return out
        out = library.add_set_up([t for t in out if t != weakest])


def description_length(library: RegressorLibrary, terms: Sequence[Candidate]) -> float:
    """Return the description length of the logs' torque under a model [nats]."""
    grams = library.grams
    left = grams.held_out(library.model_columns(terms)).sum(axis=1)
    rows = np.maximum(grams.counts, 1.0)
    seen = rows / library.independent_rows
    fit = 0.5 * float(np.sum(seen * np.log1p(left / rows)))
    return fit + 0.5 * library.complexity(terms) * float(np.log(max(seen.sum(), 2.0)))


def prefer_arm_causes(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[Candidate]:
    """Return a model in which causes of the whole arm replace terms that become unnecessary.

    Each cause that changes the arm (a payload, a tilt, a link) and is not in the model is added,
    and terms that are then no longer significant are removed. The shortest of these models is
    returned if it is shorter than the given one.
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
                is_implausible(library, model, [wide])
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


def prefer_joint_causes(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[Candidate]:
    """Return a model in which one cause on all joints replaces bodies, if it is shorter.

    Torque sensors that all show a fifth too little look like links that are all a fifth lighter,
    and a body is found before the last of them.
    """
    out, best = list(terms), description_length(library, terms)
    named = [t for t in terms if not t.small]
    rest = [t for t in named if not library.causes[t.cause].changes_arm]
    have = {(t.cause, t.joint) for t in rest}
    for cause in library.causes.values():
        if len(rest) == len(named) or cause.coupled or cause.arm_wide or not cause.is_linear:
            continue
        more = [t for t in library.candidates if t.cause == cause.name]
        model = library.beside([*rest, *(t for t in more if (t.cause, t.joint) not in have)])
        if description_length(library, model) < best:
            model = pruned(library, model)
            if (length := description_length(library, model)) < best:
                out, best = model, length
    return out
