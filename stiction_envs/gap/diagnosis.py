"""Name what the simulation gets wrong: `diagnose(logs, robot) -> Diagnosis`.

logs -> signals -> residual of the nominal model -> significant causes -> parameters
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array, Bools, rms
from stiction_envs.errors import StictionError
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.causes import TOLERANCES, Cause, Part, cause_named, registered
from stiction_envs.gap.causes.base import ALL_LINKS, LINK
from stiction_envs.gap.causes.log.actuator_delay import ActuatorDelay
from stiction_envs.gap.causes.log.encoder_offset import EncoderOffset
from stiction_envs.gap.causes.log.torque_scale import TorqueScale
from stiction_envs.gap.doubt import earlier_factor, found_factor, with_earlier
from stiction_envs.gap.judge.judgement import WIDTH, Judgement, percent_gained
from stiction_envs.gap.judge.problem import ARM, LINKS, Term
from stiction_envs.gap.links import LinkErrors, link_errors, root_of
from stiction_envs.gap.model_file import Nominal, nominal_of
from stiction_envs.gap.predictors.judged import Judged, draws, gains, held_out, judge, search_of
from stiction_envs.gap.predictors.named import ALIKE, named_causes, not_shown, shares
from stiction_envs.gap.predictors.torque import TorquePredictor
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.loads import SURE
from stiction_envs.gap.signals.prepare import Signals, prepare
from stiction_envs.gap.signals.sessions import sessions, spans
from stiction_envs.gap.signals.torque_lag import correct_torques, lag_of
from stiction_envs.gap.signals.torque_sign import converted
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.measured.motion_thresholds import TRAVEL_SPAN
from stiction_envs.robots import Arm

SAME_GAIN = 0.005
"""Error of a torque's factor that is not worth another search [-]; assumed."""
OTHER_GAIN = 0.1
"""Error of a gain from which on logs are converted by it, too [-]; assumed."""
DRAWS = 1000
"""Number of draws of the posterior for intervals [-]; assumed."""
NEGLIGIBLE = 0.1
"""Torque of a small error over the noise below which a model leaves it out [-]; assumed."""
CLOSE = 3.0
"""Held-out error over the noise floor below which nothing is left [-]; assumed."""
SMALL = 0.02
"""The same over a joint's whole torque, root mean square [-]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis(Judgement):
    """The result, and the data behind it."""

    nominal_rms: Array
    """(n,) error of the nominal model [N·m]."""
    extended_rms: Array
    """(n,) error of the extended model on rows that it was neither chosen nor fitted with [N·m]."""
    noise: Array
    """(n,) noise floor [N·m]."""
    what_to_record: tuple[str, ...]
    """The motions to record next, most useful first; ``record_next`` in the file."""
    logs: tuple[JointLog, ...]
    data: Data
    predictor: TorquePredictor
    terms: tuple[Term, ...]
    coefficients: Array
    links: LinkErrors | None
    """Small errors of all links."""
    doubt: tuple[Array, ...]
    """(k, K) rows of a factor of the coefficients' covariance, for each term."""
    base: Data
    """The logs against the nominal friction, without causes of earlier diagnoses."""
    baseline: Nominal
    """The nominal model."""
    notes: tuple[str, ...] = ()
    """How the signals and the noise floor were computed."""

    @property
    def gain_percent(self) -> float:
        """100 (1 − mean over joints of extended over nominal held-out RMS) [%]."""
        some = self.data.measured
        return percent_gained(self.nominal_rms[some], self.extended_rms[some])

    @cached_property
    def torque(self) -> Array:
        """(T, n) what the causes add to the nominal torques [N·m]."""
        return self.predictor.torque(self.terms, self.coefficients)

    def cause_torque(self, cause: str) -> Array:
        """Return (T, n) what one cause adds to the nominal torques [N·m]."""
        each = self.predictor.torques(self.terms, self.coefficients)
        mine = [x for t, x in each.items() if t.cause == cause and not t.small]
        return np.sum([np.zeros_like(self.data.q), *mine], axis=0)

    def to_json(self) -> dict[str, object]:
        """Return the content of ``diagnosis.json``."""
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
            "notes": [
                *self.data.arm.notes(self.baseline.file),
                *self.notes,
                *_log_notes(self.logs),
            ],
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
) -> Diagnosis:
    """Name what a nominal model gets wrong about measured joint logs.

    Args:
        logs: of one robot.
        robot: name, model file or arm.
        nominal: ``rigid``, ``file``, ``shipped``, a TOML (friction, or an earlier
            ``model.toml``), or parameters.
        torque: side of the gear on which torque was measured, "motor" or "link".
        causes: registered hypotheses; None for all of them, beside small errors of all links.
        cutoff_hz: bandwidth of the zero-phase filter; None chooses it from the data.
        seed: of the bootstrap.
        progress: called with a stage and the part of it that is done.

    Raises:
        StictionError: no log, logs that do not fit the robot, or a cause that is
            not registered.
    """
    say = progress or (lambda *_: None)
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
        partial(prepare, cutoff_hz=cutoff_hz),
        baseline.torque_sign,
        baseline.torque_lag,
        baseline.torque_unit,
    )
    signals = replace(signals, sessions=sessions(read, baseline.sessions))
    return diagnose_signals(read, signals, arm, baseline, torque, causes, seed, say)


def diagnose_signals(
    read: Sequence[JointLog],
    signals: Signals,
    arm: Arm,
    baseline: Nominal,
    torque: str,
    causes: Sequence[Cause],
    seed: int,
    say: Callable[[str, float], None] = lambda *_: None,
) -> Diagnosis:
    """Name what a nominal model gets wrong about signals whose torques were corrected.

    Arguments are as of `diagnose_logs`; the logs ``read`` need not be there.
    """
    say("inverse dynamics", 0.0)
    compare = partial(
        assemble,
        arm,
        friction=baseline.friction,
        torque=torque,
        link_factor=baseline.links,
        of_file=baseline.file,
        known_unit=baseline.torque_unit,
    )
    base = compare(signals)
    data = baseline.extend(base)
    if not np.isfinite(data.dt):  # only poses without motion
        causes = [c for c in causes if c.shown_at_rest]
    if signals.set_up:  # the model is another arm: whatever is named beside that, is false
        causes = [c for c in causes if c.adds_to == ALL_LINKS]
    if signals.zero_off is not None:
        far = EncoderOffset(signals.zero_off)
        causes = [far if isinstance(c, EncoderOffset) else c for c in causes]
    judged = judge(data, causes, say)
    gain, known = _gains(judged)
    off = known & (np.abs(gain - 1) > (SAME_GAIN if data.converted else OTHER_GAIN))
    if off.any():  # friction was measured with the same gain
        unit = signals.torque_unit * np.where(known, gain, 1.0)
        other_read, other_signals = converted(read, signals, unit)
        other_base = compare(other_signals)
        again = judge(baseline.extend(other_base), causes, say)
        if _gains(again)[1][off].all():  # else, something takes the gain's place
            judged, read, base = again, other_read, other_base
    return _conclude(baseline, base, read, judged, seed, say)


def _gains(judged: Judged) -> tuple[Array, Bools]:
    """Return (n,) gains of the joints' torques, and (n,) whether they are well known.

    A gain is not known where another cause may take its place, as a tool may that of all gains.
    """
    predictor, terms, c = judged.predictor, judged.terms, judged.coefficients
    slopes = gains(predictor, terms, np.eye(len(c))) - 1
    covariance = predictor.problem.covariance(terms)
    width = WIDTH * np.sqrt(np.einsum("np,pq,nq->n", slopes, covariance, slopes))
    gain = gains(predictor, terms, c)
    known = width < SURE * gain
    named, search = judged.model.terms, search_of(predictor)
    for term in named:
        if term.cause == TorqueScale.name and not term.shape:
            rivals = [score for score, _ in search.rivals(named, [term])]
            clear = max(rivals, default=-np.inf) <= search.problem.score(named) - ALIKE
            known[slice(None) if term.joint == ARM else term.joint] &= clear
    return gain, known


def _conclude(
    baseline: Nominal,
    base: Data,
    logs: Sequence[JointLog],
    judged: Judged,
    seed: int,
    say: Callable[[str, float], None],
) -> Diagnosis:
    predictor = judged.predictor
    data, kept = predictor.data, predictor.fold >= 0
    nominal_rms = rms(data.logged_residual[kept])
    extended_rms = held_out(judged, lambda part: say("held-out rows", part))
    some = data.measured
    if percent_gained(nominal_rms[some], extended_rms[some]) <= 0:  # it names nothing then
        judged = Judged(predictor, replace(judged.model, terms=()), [], np.zeros(0))
        extended_rms = nominal_rms
    terms, c = judged.terms, judged.coefficients
    drawn = draws(judged, DRAWS, seed)
    doubt = found_factor(drawn)
    drawn = with_earlier(drawn, terms, baseline.parts, seed)
    say("evidence", 0.0)
    named, minor = named_causes(judged, drawn)
    verdict = _verdict(data, bool(named), nominal_rms, extended_rms)
    hidden = not_shown(judged)
    return Diagnosis(
        robot=data.arm.name,
        verdict=verdict,
        causes=named,
        minor=minor,
        shares_percent=shares(judged),
        not_shown=hidden,
        nominal_rms=nominal_rms,
        extended_rms=extended_rms,
        noise=np.where(some, data.noise, nominal_rms),
        what_to_record=tuple(
            f"to see {x.name}: {cause_named(x.name).what_to_record}"
            for x in hidden
            if all(x.name != c.name for c in named)
        ),
        logs=tuple(logs),
        data=data,
        predictor=predictor,
        terms=tuple(terms),
        coefficients=c,
        links=link_errors(predictor, terms, c),
        doubt=tuple(doubt),
        base=base,
        baseline=baseline,
        notes=(*data.recording.findings, *data.recording.notes),
    )


def _verdict(data: Data, named: bool, nominal: Array, extended: Array) -> str:
    """Return the verdict of ``diagnosis.json`` from the errors (n,) of both models [N·m].

    Friction of a joint that holds is unknown, so what a model leaves there is no shortcoming.
    """
    enough = np.maximum(CLOSE * data.noise, SMALL * rms(data.tau))
    moves = np.ptp(data.q, axis=0) > TRAVEL_SPAN
    if not moves.any():
        return "cannot tell"
    if not named and not (nominal > enough).any():
        return "no discrepancy"
    if not named and (extended > enough).any():
        return "cannot tell"
    return "partly explained" if ((extended > enough) & moves).any() else "explained"


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
    unit = data.recording.torque_unit
    level = 1 + max((p.level for p in before.parts), default=0)
    split = diagnosis.predictor.problem.split(diagnosis.terms, c)

    def carried(term: Term) -> bool:
        cause = diagnosis.predictor.causes[term.cause]
        return cause.acts_on_all if isinstance(cause, ActuatorDelay) else data.carried is not None

    def part(term: Term, mine: Array, factor: Array) -> Part:
        cause, shape = diagnosis.predictor.causes[term.cause], term.shape
        if term.shape == LINKS and diagnosis.links is not None:
            own = diagnosis.links.changes.ravel()
        else:
            own, shape = cause.part_of(mine, shape)
        if diagnosis.links is not None and cause.adds_to in (LINK, ALL_LINKS):
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

    seen = NEGLIGIBLE * data.noise
    parts = []
    for term, mine, factor in zip(diagnosis.terms, split, diagnosis.doubt, strict=True):
        torque = diagnosis.predictor.torques([term], mine)[term]
        if term.small and term.shape != LINKS and (rms(torque) < seen).all():
            continue  # nobody needs an actuator of a millinewton metre
        parts.append(part(term, mine, factor))
    return Nominal(
        friction=before.friction,
        file=before.file,
        parts=(*before.parts, *parts),
        robot=arm.name,
        payload=arm.payload,
        tilt=arm.tilt,
        distance=tuple(float(x) for x in data.friction.presliding_distance),
        torque_sign=data.recording.torque_sign or before.torque_sign,
        torque_unit=unit if (unit != 1).any() else None,
        torque_lag=lag_of(diagnosis.logs, before.torque_lag),
        sessions=spans(diagnosis.logs, before.sessions),
        links=before.links if diagnosis.links is None else root_of(diagnosis.links.covariance),
    )
