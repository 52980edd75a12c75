"""Name what the simulation gets wrong: `diagnose(logs, robot) -> Diagnosis`.

logs -> signals -> residual of the nominal model -> significant causes -> parameters
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.causes import TOLERANCES, Cause, Part, cause_named, registered
from stiction_envs.gap.causes.log.actuator_delay import ActuatorDelay
from stiction_envs.gap.doubt import earlier_factor, found_factor, with_earlier
from stiction_envs.gap.estimates import draw, estimates, sharpen
from stiction_envs.gap.judge.judgement import Judgement, NamedCause
from stiction_envs.gap.links import LinkErrors, link_errors
from stiction_envs.gap.model_file import Nominal, nominal_of
from stiction_envs.gap.noise_left import noise_left
from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.selection.chooser import Chooser
from stiction_envs.gap.selection.confusion import confused_with
from stiction_envs.gap.selection.gain import gain, pruned
from stiction_envs.gap.selection.refit import refine_delay, refit
from stiction_envs.gap.selection.whole_models import (
    likelier,
    prefer_arm_causes,
    with_or_without_random,
    with_set_up,
)
from stiction_envs.gap.settings import GapSettings, gap_settings
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import Signals, prepare
from stiction_envs.gap.signals.sessions import sessions, spans
from stiction_envs.gap.signals.torque_lag import correct_torques, lag_of
from stiction_envs.gap.signals.torque_sign import signs
from stiction_envs.gap.verdict import (
    described,
    evidence,
    percent_gained,
    percent_lost,
    structured,
    verdict_of,
    what_to_record,
)
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.method_settings import Changes, override
from stiction_envs.robots import Arm

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis(Judgement):
    """The result, and the data behind it."""

    nominal_rms: Array
    """(n,) held-out error of the nominal model [N·m]."""
    extended_rms: Array
    """(n,) held-out error of the extended model [N·m]."""
    noise: Array
    """(n,) noise floor, given the causes (`noise_left`) [N·m]."""
    structured: NDArray[np.bool_]
    """(n,) whether a further cause would take much of what is left of a joint."""
    not_identifiable: dict[str, str]
    """Causes that these data cannot show, and why."""
    what_to_record: tuple[str, ...]
    """The motions to record next, most useful first; ``record_next`` in the file."""
    logs: tuple[JointLog, ...]
    data: Data
    library: RegressorLibrary
    terms: tuple[Candidate, ...]
    coefficients: Array
    links: LinkErrors | None
    """Small errors of all links; None where a few bodies explain the arm."""
    doubt: tuple[Array, ...]
    """(k, K) rows of a factor of the coefficients' covariance, for each term."""
    base: Data
    """The logs against the nominal friction, without causes of earlier diagnoses."""
    baseline: Nominal
    """The nominal model."""
    torque_sign: int
    """1 where the logs' torques drive the joints, -1 where they were inverted; 0 where unknown."""
    notes: tuple[str, ...] = ()
    """How the signals and the noise floor were computed."""

    @property
    def settings(self) -> GapSettings:
        """Constants of the method."""
        return self.data.settings

    @property
    def gain_percent(self) -> float:
        """100 (1 − mean over joints of extended over nominal held-out RMS) [%]."""
        return percent_gained(self.nominal_rms, self.extended_rms)

    def torque(self, joint: int) -> Array:
        """Return (T,) what the causes add to the nominal torque of a joint (from 0) [N·m]."""
        return self.library.torque(self.terms, self.coefficients, joint)

    def cause_torque(self, cause: str) -> Array:
        """Return (T, n) what one cause adds to the nominal torques [N·m]."""
        out = np.zeros_like(self.data.q)
        shares = self.library.split(self.terms, self.coefficients)
        for term, mine in zip(self.terms, shares, strict=True):
            if term.cause == cause and not term.small:
                for j in self.library.affected_joints(term):
                    out[:, j] += self.library.part(term, j, mine)
        return out

    def to_json(self) -> dict[str, object]:
        """Return ``diagnosis.json`` of the contract."""
        return {
            "robot": self.robot,
            "verdict": self.verdict,
            "nominal": {"rms_nm": self.nominal_rms.tolist(), "held_out": True},
            "extended": {"rms_nm": self.extended_rms.tolist(), "held_out": True},
            "noise_floor_nm": self.noise.tolist(),
            "gain_percent": self.gain_percent,
            **self.judged_json(),
            **({} if self.links is None else {"links": self.links.to_json()}),
            "record_next": list(self.what_to_record),
            "notes": [*self.notes, *_log_notes(self.logs)],
        }


def diagnose_logs(
    logs: Sequence[JointLog],
    robot: str | Path | Arm,
    *,
    nominal: str | Path | FrictionParameters | Nominal = "rigid",
    torque: str = "motor",
    causes: Sequence[Cause] | None = None,
    cutoff_hz: float | None = None,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
    settings: GapSettings | Changes | None = None,
) -> Diagnosis:
    """Name what a nominal model gets wrong about measured joint logs.

    Args:
        logs: of one robot.
        robot: name, model file or arm.
        nominal: ``rigid``, ``shipped``, a TOML (friction, or an earlier ``model.toml``), or
            parameters.
        torque: side of the gear on which torque was measured, "motor" or "link".
        causes: registered hypotheses; None for all of them, beside small errors of all links.
        cutoff_hz: bandwidth of the zero-phase filter; None chooses it from the data.
        seed: of the bootstrap.
        progress: called with a stage and the part of it that is done.
        settings: constants of the method that differ from ``settings.toml``: by name
            (``{"selection.chance": 0.02}``), a TOML file of them, or all.

    Raises:
        StictionError: invalid settings, no log, logs that do not fit the robot, or a cause that is
            not registered.
    """
    say = progress or (lambda *_: None)
    own = override(gap_settings(), settings)
    arm, baseline = nominal_of(robot, nominal)
    if not logs:
        raise StictionError("no logs: expected one or more")
    say("reading", 1.0)
    causes = (TOLERANCES, *registered()) if causes is None else causes
    for cause in causes:
        cause_named(cause.name)  # files and reports look it up
    read, signals = correct_torques(
        logs,
        arm,
        partial(prepare, cutoff_hz=cutoff_hz, settings=own),
        own,
        baseline.torque_sign,
        baseline.torque_lag,
    )
    signals = replace(signals, sessions=sessions(read, baseline.sessions))
    say("inverse dynamics", 0.0)
    base = assemble(
        arm,
        signals,
        friction=baseline.friction,
        torque=torque,
        settings=own,
        link_factor=baseline.links,
    )
    data = baseline.extend(base)
    say("columns of all causes", 0.0)
    if not np.isfinite(data.dt):  # only poses without motion
        causes = [c for c in causes if c.shown_at_rest]
    library = RegressorLibrary(data, causes)

    def choose(
        library: RegressorLibrary, *some: Sequence[Candidate], stage: str = "refitting"
    ) -> list[Candidate]:
        return Chooser(library, lambda k: say(stage, k / (k + 12)), *some).choose()

    say("choosing causes", 0.0)

    terms = with_or_without_random(library, partial(choose, stage="choosing causes"), sharpen)
    say("refitting", 0.0)
    library, terms = refit(library, terms, choose)
    if library.scale > 0:
        # the noise, and the size of the links' errors, are known only now; a search is greedy
        terms = likelier(library, choose(library, terms), choose(library))
    say("refitting", 0.6)
    terms = refine_delay(library, sharpen(library, terms))
    terms = prefer_arm_causes(library, terms)
    say("refitting", 0.8)
    kept = pruned(library, terms)
    if len(kept) < len(terms):
        # a cause that was dropped may have kept out a better one
        gone = [t for t in terms if t not in kept]
        terms = refine_delay(library, sharpen(library, choose(library, kept, gone)))
        terms = pruned(library, terms)
    if library.scale > 0:
        library.settle()
        terms = likelier(library, terms, sharpen(library, choose(library, terms)))
    return _conclude(baseline, base, read, signals, library, terms, seed, say)


def _conclude(
    baseline: Nominal,
    base: Data,
    logs: list[JointLog],
    signals: Signals,
    library: RegressorLibrary,
    terms: list[Candidate],
    seed: int,
    say: Callable[[str, float], None],
) -> Diagnosis:
    data, grams, chosen = library.data, library.grams, terms
    terms = with_set_up(library, chosen)
    library.keep(terms)
    count = np.array([g.count.sum() for g in grams.joints])

    def error(left: Array) -> Array:
        """Return (n,) of squared errors (n, B) [N·m]."""
        return np.asarray(np.sqrt(left.sum(axis=1) / count) * data.noise)

    model = library.model_columns(terms)
    nominal_rms = error(grams.held_out(library.model_columns([])))
    extended_rms, c = error(grams.held_out(model)), grams.fit(model)
    draws = draw(library, terms, c, seed) if terms else []
    doubt = found_factor(draws, library.split(terms, c), data.settings.estimates)
    draws = with_earlier(draws, terms, baseline.parts, seed)
    noise, of_noise = noise_left(library, terms, c, signals)
    names = list(dict.fromkeys(t.cause for t in terms if not t.small))
    named, little = [], set()
    for i, name in enumerate(names):
        say("evidence", i / len(names))
        mine = [t for t in terms if t.cause == name and not t.small]
        its_gain = gain(library, chosen, mine)
        if not its_gain.significant:
            continue
        if its_gain.stands_out:  # other links would take its place
            without = error(grams.held_out_less(model, library.own(terms, mine)))
        else:
            others = [t for t in terms if t not in mine]
            without = error(grams.held_out(library.model_columns(others)))
        lost = percent_lost(without, extended_rms, nominal_rms)
        if lost <= 0:  # beside the small errors of the set-up it only costs
            continue
        s = data.settings.verdict
        if lost < 100 * s.minor and bool((without < s.minor_error * extended_rms).all()):
            little.add(name)
        joints = tuple(sorted(t.joint + 1 for t in mine))
        if mine[0].joint == ARM:
            joints = tuple(int(j) + 1 for j in np.flatnonzero(its_gain.significant_joints))
        named.append(
            NamedCause(
                name=name,
                joints=joints,
                gain_percent=lost,
                parameters=estimates(library, terms, mine, c, draws),
                evidence=evidence(
                    described(library, terms, mine, c), joints, without, extended_rms
                ),
                confused_with=confused_with(library, chosen, mine, joints, its_gain),
            )
        )
    named.sort(key=lambda x: -x.gain_percent)
    minor = tuple(c for c in named[1:] if c.name in little)
    named = [c for c in named if c not in minor]
    more = structured(library, terms, extended_rms / noise)
    not_identifiable = {name: reason for (name, _), reason in library.not_identifiable.items()}
    return Diagnosis(
        robot=data.arm.name,
        verdict=verdict_of(named, nominal_rms, extended_rms, noise, library, more),
        causes=tuple(named),
        minor=minor,
        nominal_rms=nominal_rms,
        extended_rms=extended_rms,
        noise=noise,
        structured=more,
        not_identifiable=not_identifiable,
        what_to_record=what_to_record(named, not_identifiable),
        logs=tuple(logs),
        data=data,
        library=library,
        terms=tuple(terms),
        coefficients=c,
        links=link_errors(library, terms, c),
        doubt=tuple(doubt),
        base=base,
        baseline=baseline,
        torque_sign=_torque_sign(logs, signals, baseline, data),
        notes=(*signals.notes, *of_noise, *_small_notes(library, terms)),
    )


def _torque_sign(logs: list[JointLog], signals: Signals, baseline: Nominal, data: Data) -> int:
    """Return the sign of the robot's torques, if these or earlier logs show it."""
    if any(c.kind == "sign" for log in logs for c in log.corrections):
        return -1
    shown = any(s.vote for s in signs(signals, data.recording.arm, data.settings))
    return 1 if shown else baseline.torque_sign


def _small_notes(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[str]:
    """Return what small errors of the set-up are in a model."""
    of = dict.fromkeys(t.cause for t in terms if t.small and t not in library.random)
    if not of:
        return []
    return [f"small errors within the usual tolerance are fitted too, not named: {', '.join(of)}"]


def _log_notes(logs: Sequence[JointLog]) -> list[str]:
    """Return corrections of the logs and uncorrected findings, each with its log."""
    said = [(log, x) for log in logs for x in (*(c.text for c in log.corrections), *log.warnings)]
    return [f"{Path(log.source).name}: {x}" if len(logs) > 1 else x for log, x in said]


def model_of(diagnosis: Diagnosis, coefficients: Array | None = None) -> Nominal:
    """Return a diagnosis's baseline with its causes.

    ``coefficients`` (P,) replace those that were fitted to all data.
    """
    before = diagnosis.baseline
    data, arm = diagnosis.data, diagnosis.data.arm
    c = diagnosis.coefficients if coefficients is None else coefficients
    level = 1 + max((p.level for p in before.parts), default=0)
    split = diagnosis.library.split(diagnosis.terms, c)

    def carried(term: Candidate) -> bool:
        cause = diagnosis.library.causes[term.cause]
        return cause.acts_on_all if isinstance(cause, ActuatorDelay) else data.carried is not None

    def part(term: Candidate, mine: Array, factor: Array) -> Part:
        cause, shape = diagnosis.library.causes[term.cause], term.shape
        if term in diagnosis.library.random and diagnosis.links is not None:
            own = diagnosis.links.changes.ravel()
        else:
            own, shape = cause.part_of(mine, shape)
        if diagnosis.links is not None and (cause.body or cause.random):
            factor = np.zeros((0, 0))  # the doubt of all links contains it
        else:
            earlier = earlier_factor(before.parts, term, len(factor))
            factor = np.concatenate([-earlier, factor], axis=1)
        return Part(
            cause=term.cause,
            joint=0 if term.joint == ARM else term.joint + 1,
            shape=tuple(float(x) for x in shape),
            coefficients=tuple(float(x) for x in own),
            level=level,
            carried=carried(term),
            doubt=tuple(tuple(float(x) for x in row) for row in factor),
        )

    each = zip(diagnosis.terms, split, diagnosis.doubt, strict=True)
    parts = tuple(part(*x) for x in each)
    return Nominal(
        friction=before.friction,
        parts=(*before.parts, *parts),
        robot=arm.name,
        payload=arm.payload,
        tilt=arm.tilt,
        distance=tuple(float(x) for x in data.friction.presliding_distance),
        torque_sign=diagnosis.torque_sign,
        torque_lag=lag_of(diagnosis.logs, before.torque_lag),
        sessions=spans(diagnosis.logs, before.sessions),
        links=before.links if diagnosis.links is None else diagnosis.links.factor,
    )
