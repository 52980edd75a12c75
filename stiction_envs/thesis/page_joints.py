"""The page's part on each joint: its causes by name, with gain and evidence, and what is left."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stiction_envs.experiments.sje.protocol import Configuration, configurations
from stiction_envs.measured import thesis_base
from stiction_envs.reporting.markdown import listed, percent, short, signed, span, table
from stiction_envs.thesis.joint_theory import JointTheory
from stiction_envs.thesis.scores import ARM, FREQUENCIES, LEAST_GAIN, Change, Findings, Gain
from stiction_envs.thesis.words import place

CAUSES = {
    "inertia": "rotor inertia takes the dither",
    "presliding": "presliding and Stribeck: the joint sticks on bristles",
    "path": "torque path: low-pass and rate limit",
    "elasticity": "spring between rotor and link",
    "load": "friction of its own in each pose",
    "offset": "offset: gravity-compensation or sensor bias, not friction",
    "drift": "the base moved between measuring days",
    ARM: "the whole arm instead of a lone joint",
}
"""What a statement says about the robot."""
ALIKE = 1.5
"""Torques within this factor of each other are alike; assumed."""


def section(findings: Findings, number: int) -> list[str]:
    """Return the lines of one joint.

    Args:
        findings: the rungs.
        number: the joint, from 1.
    """
    f, last = findings, findings.last
    frequencies = [f"{x:g}" for x in FREQUENCIES]
    measured = [signed(f.mean(f.at(number, x))) for x in FREQUENCIES]
    simulated = [signed(f.mean(f.at(number, x), last)) for x in FREQUENCIES]
    held = f.held_out & (f.joint == number)
    nothing = f.error("nothing", held) if "nothing" in f.rungs else float("nan")
    lines = [
        f"### Joint {number}",
        "",
        f"Change of torque at scale 1.0, mean of both poses and directions, at "
        f"{listed(frequencies)} Hz: measured {', '.join(measured)} %, predicted by the last rung "
        f"{', '.join(simulated)} %. Error on held-out cells: {nothing:.1f} % of the base torque if "
        f"dither did nothing, {f.error(last, held):.1f} % now." + _constant(f, number),
        "",
    ]
    gains = f.gains(number)
    named = [g for g in gains if g.named]
    if named:
        rows = [
            [
                f"**{CAUSES.get(g.key, g.name)}**",
                f"{g.plain.before:.1f} → {g.plain.after:.1f} %",
                _points(g.plain),
                "" if g.shape is None else _points(g.shape),
                EVIDENCE[g.key](f, number) if g.key in EVIDENCE else "",
            ]
            for g in named
        ]
        header = ["cause", "held-out error", "gain in points [95 %]"]
        header += ["with bases free to move", "evidence"]
        lines += table(header, rows)
    elif gains:
        lines += ["No statement lowers this joint's error by more than its scatter.", ""]
    return [
        *lines,
        *_unnamed(gains),
        *_left(f, number),
        f"![joint {number}](joint_{number}.png)",
        "",
    ]


def _points(change: Change) -> str:
    return f"{signed(change.points)} [{signed(change.low)}, {signed(change.high)}]"


def _constant(f: Findings, number: int) -> str:
    """Say whether the physics beats a constant per configuration."""
    now, constant = f.scores[f.last].by_joint[number], f.constant(number)
    text = f" A constant per configuration is off by {constant:.1f} %"
    if now > constant - LEAST_GAIN:
        return text + ": on this joint the tables do not show that more is needed."
    return text + "."


def _unnamed(gains: list[Gain]) -> list[str]:
    """Say which statements are no causes here, and which made it worse."""
    idle = [g.name for g in gains if not g.named and not g.worse]
    worse = [f"{g.name} ({signed(-g.points)} points)" for g in gains if g.worse]
    parts = []
    if idle:
        parts.append(f"No gain that stands against the scatter: {listed(idle)}.")
    if worse:
        parts.append(f"The error grew with: {listed(worse)}.")
    return [" ".join(parts), ""] if parts else []


def _left(f: Findings, number: int) -> list[str]:
    residual, held = f.residual(), f.held_out & (f.joint == number)
    means = {c: float(residual[held & f.of(c)].mean()) for c in configurations(7, [number])}
    worst = max(means, key=lambda c: abs(means[c]))
    where, tone, rest = f.shares(number)
    largest = int(np.argmax(np.where(held, np.abs(residual), -1)))
    c = f.cells[largest]
    return [
        f"Left: of the mean square, {100 * where:.0f} % is constant per configuration (a base or a "
        f"level that is off), {100 * tone:.0f} % common to all configurations at one frequency "
        f"(the model's frequency response), {100 * rest:.0f} % neither. Worst configuration "
        f"{place(worst)}, {signed(means[worst])} points; worst cell Table {c.column}, "
        f"{place(c.configuration)}, {c.row.frequency_hz:g} Hz, {c.row.amplitude_nm:.2f} N·m: "
        f"measured {percent(100 * c.change)}, predicted "
        f"{percent(100 * f.predicted[f.last][largest])}.",
        "",
    ]


# ---- evidence: one sentence per cause, its numbers computed, its claim chosen by them ------------


def _inertia(f: Findings, joint: int) -> str:
    theory = f.theory(joint)
    gain = theory.bristle_gain(FREQUENCIES, 0)
    base = thesis_base("panda")
    strokes = 1e3 * theory.stroke(FREQUENCIES, base.friction[joint - 1, 0], 0)
    text = (
        f"a rotor of {short(theory.rotor, 2)} kg·m² swings by {span(strokes)} mrad under a dither "
        "as large as the friction; 150 mrad are asked for"
    )
    small = [f"{x:g}" for x, g in zip(FREQUENCIES, gain, strict=True) if g < 0.5]
    if small:
        text += f"; at {_hertz(small)} less than half of the dither arrives at the friction"
    return text


def _hertz(which: list[str]) -> str:
    return "every frequency" if len(which) == len(FREQUENCIES) else f"{listed(which)} Hz"


def _shaken(theory: JointTheory, joint: int) -> np.ndarray:
    """Return how much faster than v_s a stuck joint is shaken, (4,) least of both poses [-]."""
    base = thesis_base("panda").friction[joint - 1]
    speeds = [theory.shaking(FREQUENCIES, base[k], k) for k in range(2)]
    return np.min(speeds, axis=0) / theory.parameter("stribeck_velocity")


def _presliding(f: Findings, joint: int) -> str:
    theory = f.theory(joint)
    sigma0, step = theory.parameter("bristle_stiffness"), 100 * theory.step()
    peak = _strongest(theory)
    parts = []
    if peak is not None:
        parts.append(
            f"on bristles of {short(sigma0, 2)} N·m/rad the joint resonates at {peak[0]:.0f} Hz, "
            f"where {short(peak[1], 2)} times the dither arrives at the friction"
        )
    shaken = _shaken(theory, joint)
    fast = [f"{x:g}" for x, r in zip(FREQUENCIES, shaken, strict=True) if r > 1]
    if fast:
        parts.append(
            f"at {_hertz(fast)} the stuck joint is shaken faster than its Stribeck velocity, "
            f"which alone takes it from static to kinetic friction ({percent(step)}) and lets its "
            "bristles creep"
        )
    return "; ".join(parts)


def _strongest(theory: JointTheory) -> tuple[float, float] | None:
    """Return (f [Hz], gain) of the load pose's strongest resonance near the frequencies tried."""
    near = [p for p in theory.resonances(0) if min(FREQUENCIES) / 1.5 < p[0] < max(FREQUENCIES)]
    return max(near, key=lambda peak: peak[1], default=None)


def _path(f: Findings, joint: int) -> str:
    fast, slow = 100 * f.theory(joint).command_gain([80.0, 15.0])
    return f"the robot's low-pass leaves {fast:.0f} % of a sine at 80 Hz, {slow:.0f} % at 15 Hz"


def _elasticity(f: Findings, joint: int) -> str:
    theory = f.theory(joint)
    if not theory.elastic:
        return "rigid in this fit: the parameters found with the other springs in place"
    tops = [theory.resonances(k)[-1][0] for k in range(2) if theory.resonances(k)]
    best = min(FREQUENCIES, key=lambda x: f.mean(f.at(joint, x)))
    text = f"a spring of {short(theory.stiffness, 2)} N·m/rad"
    if tops:
        text += f" lets the rotor resonate at {span(tops)} Hz"
    return text + f"; the frequency that helped most was {best:g} Hz"


def _load(f: Findings, joint: int) -> str:
    high, low = thesis_base("panda").friction[joint - 1]
    return f"half the difference of the base torques is {high:.2f} N·m loaded, {low:.2f} unloaded"


def _offset(f: Findings, joint: int) -> str:
    base = thesis_base("panda")
    high, low = base.offset[joint - 1]
    text = (
        f"half the sum of the base torques is {signed(high, 2)} N·m loaded, {signed(low, 2)} "
        f"unloaded, beside a friction of {base.friction[joint - 1, 0]:.2f} N·m"
    )
    taken = _final_torques(f, joint, "load")
    if taken is not None:
        plus, minus = taken
        text += (
            f"; in the load pose the same final dither took {plus:.2f} N·m off in + and "
            f"{minus:.2f} N·m in −"
        )
        low, high = sorted((plus, minus))
        alike = low > 0 and high < ALIKE * low
        text += ", alike, as if no bias were there" if alike else ", not alike: bias is not all"
    return text


def _final_torques(f: Findings, joint: int, load: str) -> tuple[float, float] | None:
    """Return the torque [N·m] the final dither took off in + and −; None if a cell is missing."""
    out = []
    for direction in "+-":
        mask = f.of(Configuration(joint, load, direction), "4.10 final")
        if not mask.any():
            return None
        c = f.cells[int(np.argmax(mask))]
        out.append(abs(c.row.tau_base_nm) - abs(c.row.tau_sje_nm))
    return out[0], out[1]


def _drift(f: Findings, joint: int) -> str:
    factors = {c: x for c, x in f.drift().items() if c.joint == joint}
    if not factors:
        return ""
    worst = max(factors, key=lambda c: abs(factors[c] - 1))
    mask = f.of(worst, "4.6")
    values = 100 * f.measured[mask]
    text = (
        f"{place(worst)} of Table 4.6 asks for a base {percent(100 * (factors[worst] - 1))} off "
        "that of Table 4.3"
    )
    if (values > 0).all():
        text += f": every dither raised it, by {values.min():.0f} to {values.max():.0f} %"
    return text


def _arm(f: Findings, joint: int) -> str:
    rate = f.rungs[ARM].fixed.get("ramp_rate")
    text = "fitted again with all joints in motion"
    return text if rate is None else f"{text}, ramp at {rate:g} N·m/s"


EVIDENCE: dict[str, Callable[[Findings, int], str]] = {
    "inertia": _inertia,
    "presliding": _presliding,
    "path": _path,
    "elasticity": _elasticity,
    "load": _load,
    "offset": _offset,
    "drift": _drift,
    ARM: _arm,
}


def overview(findings: Findings) -> list[str]:
    """Return one line per joint: what dither does there, and the largest cause after inertia."""
    rows = []
    for number in sorted(set(findings.joint.tolist())):
        held = findings.held_out & (findings.joint == number)
        gains = findings.gains(number)
        named = sorted((g for g in gains if g.named), key=lambda g: -g.points)
        causes = [f"{CAUSES.get(g.key, g.name)} ({signed(g.points)})" for g in named[:3]]
        start = findings.error("nothing", held) if "nothing" in findings.rungs else float("nan")
        rows.append(
            [
                str(number),
                f"{start:.1f} %",
                f"{findings.constant(number):.1f} %",
                f"{findings.error(findings.last, held):.1f} %",
                "; ".join(causes) or "none stands against the scatter",
            ]
        )
    header = ["joint", "dither does nothing", "constant", "now"]
    header.append("largest causes (points of error they take)")
    return table(header, rows)
