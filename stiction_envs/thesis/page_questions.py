"""The page's answers to what one asks when dither does not do what a band of stiction promises.

Every number is computed from the rungs, and every sentence that might be false is chosen by them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.protocol import configurations
from stiction_envs.gap.tables.cells import Cell
from stiction_envs.measured import thesis_base
from stiction_envs.reporting.markdown import joints, listed, percent, short, signed, span, table
from stiction_envs.thesis.joint_theory import JointTheory, poses_of
from stiction_envs.thesis.scores import FREQUENCIES, JOINTS, Findings
from stiction_envs.thesis.words import place

Array = NDArray[np.float64]
FAVOURED = 1.5
"""A frequency is favoured if it does so many times what any other does; assumed."""
CLOSE = 2.0
"""Theory and simulation agree when they differ by less, in points of the base torque; assumed."""


def _frequencies() -> str:
    return listed(f"{x:g}" for x in FREQUENCIES)


def _theory_changes(f: Findings, key: str, kind: str, *, bias: bool) -> Array:
    """Return (cells,) what a theory predicts with the parameters of a rung [% of base]."""
    out = np.empty(len(f.cells))
    for number in JOINTS:
        theory = f.theory(number, key)
        for i in np.flatnonzero(f.joint == number):
            c = f.cells[i]
            row = c.row
            change = theory.change(
                kind, c.configuration, row.frequency_hz, row.amplitude_nm, bias=bias
            )
            out[i] = 100 * float(change)
    return out


# ---- 1 -------------------------------------------------------------------------------------------


def band(f: Findings) -> list[str]:
    """Return why stiction as a band promises too much."""
    first = f.table == "4.6"
    final = [f.mean((f.joint == j) & (f.table == "4.10 final")) for j in JOINTS]
    lines = ["## Why a band of stiction promises a free joint, and the robot gained less", ""]
    text = (
        f"At scale 1.0 (Table 4.6) the dither is as large as the base torque. Measured: "
        f"{percent(f.mean(first))} in the mean; with the final amplitudes the joints' means are "
        f"{percent(max(final))} to {percent(min(final))}."
    )
    if "band" in f.rungs:
        text = (
            "If stiction were a band of torque, ramp and dither would simply add, and a dither of "
            f"the band's size would leave {100 + f.mean(first, 'band'):.0f} % of the base torque. "
            + text
        )
    lines += [text + " Two things are missing from the band:", ""]
    rows = []
    for number in JOINTS:
        theory = f.theory(number)
        friction = thesis_base("panda").friction[number - 1]
        gain = np.mean([theory.bristle_gain(FREQUENCIES, k) for k in range(2)], axis=0)
        stroke = np.mean([theory.stroke(FREQUENCIES, friction[k], k) for k in range(2)], axis=0)
        rows.append(
            [
                str(number),
                ", ".join(f"{100 * x:.0f}" for x in gain),
                ", ".join(f"{1e3 * x:.2f}" for x in stroke),
                f"{150 / (1e3 * stroke.max()):.0f}",
            ]
        )
    lines += [
        "1. *The torque does not arrive.* Inertia takes it; what reaches the friction of a joint "
        "that sticks is the bristles' share below.",
        "2. *Letting go is not moving.* The experiment ends after 150 mrad; a joint that slips in "
        "part of each period moves by fractions of a milliradian, and sticks again.",
        "",
    ]
    header = [
        "joint",
        f"share of the dither at the friction, {_frequencies()} Hz [%]",
        "free swing at A = friction, peak to peak [mrad]",
        "such swings in 150 mrad, at best",
    ]
    lines += table(header, rows)
    if "band" in f.rungs and "inertia" in f.rungs:
        lines += [
            f"Rotor inertia alone takes the held-out error from {f.scores['band'].mean:.0f} % to "
            f"{f.scores['inertia'].mean:.1f} %. " + _averaging_check(f),
            "",
        ]
    return lines


def _averaging_check(f: Findings) -> str:
    """Compare the rung without bristles with averaging theory."""
    free, sliding = (_theory_changes(f, "inertia", k, bias=False) for k in ("free", "sliding"))
    simulated = 100 * f.predicted["inertia"]
    low, high = np.minimum(free, sliding) - CLOSE, np.maximum(free, sliding) + CLOSE
    inside = int(((low <= simulated) & (simulated <= high)).sum())
    share = inside / len(simulated)
    text = (
        "Averaging theory, which knows neither bristles nor fits, "
        f"{'bears that out' if share > 0.8 else 'agrees only in part'}: {inside} of "
        f"{len(simulated)} simulated cells lie, to {CLOSE:g} points, between its values with the "
        "speed that friction leaves and with the speed of a free joint."
    )
    return text


# ---- 2 -------------------------------------------------------------------------------------------


def frequency(f: Findings) -> list[str]:
    """Return why the wrist likes 15 Hz and the other joints hardly care."""
    change = {j: np.array([f.mean(f.at(j, x)) for x in FREQUENCIES]) for j in JOINTS}
    simulated = {j: np.array([f.mean(f.at(j, x), f.last) for x in FREQUENCIES]) for j in JOINTS}
    slow = [j for j in JOINTS if _favours_slow(change[j])]
    flat = [j for j in JOINTS if j not in slow]
    lines = ["## Why 15 Hz frees some joints and hardly matters on the others", ""]
    rows = []
    for j in JOINTS:
        theory = f.theory(j)
        peaks = [x for k in range(2) for x, _ in theory.resonances(k)]
        ends = listed(dict.fromkeys(f"{x:.0f}" for x in sorted(peaks))) or "–"
        shaken = _shaken_range(theory, j)
        rows.append(
            [
                str(j),
                ", ".join(signed(x) for x in change[j]),
                ", ".join(signed(x) for x in simulated[j]),
                ends,
                span(shaken),
                signed(100 * theory.step()),
            ]
        )
    header = [
        "joint",
        f"measured at {_frequencies()} Hz [%]",
        "last rung [%]",
        "resonances [Hz]",
        "shaken at so many v_s",
        "step to kinetic friction [%]",
    ]
    lines += table(header, rows)
    if slow:
        text = (
            f"On {joints(slow)} 15 Hz does {span(_slow_ratio(change[j]) for j in slow)} times what "
            "the best of the other frequencies does (last rung: "
            f"{span(_slow_ratio(simulated[j]) for j in slow)} times). "
        )
        share = [f.theory(j).rotor / (f.theory(j).rotor + f.theory(j).link(0)) for j in slow]
        low, high = _gains(f, slow, 15.0), _gains(f, slow, 80.0)
        text += (
            f"There the rotor is {100 * min(share):.0f} to {100 * max(share):.0f} % of the "
            "inertia, so that little hangs on the bristles: "
            f"at 15 Hz the friction feels {span(low)} times the dither, at 80 Hz {span(high)}. "
            "Above its resonance a stuck joint takes the dither as inertia, and the share falls as "
            "1/f²."
        )
        lines += [text, ""]
    if flat:
        lines += [_flat(f, flat, change), ""]
    if "offset" in f.rungs:
        lines += [_creep_check(f), ""]
    return lines


def _flat(f: Findings, flat: Sequence[int], change: Mapping[int, Array]) -> str:
    """Say why the frequency hardly matters on some joints."""
    spread = max(float(np.ptp(change[j])) for j in flat)
    gain = max(max(_gains(f, flat, x)) for x in FREQUENCIES)
    text = (
        f"On {joints(flat)} the four frequencies differ by at most {spread:.0f} points, and the "
        f"best is {listed(f'{_best(change[j]):g}' for j in flat)} Hz. The friction feels at most "
        f"{short(gain, 2)} times the dither, which is "
        + ("too little to overcome it" if gain < 0.5 else "at times near enough to overcome it")
    )
    shaken = [j for j in flat if _shaken_range(f.theory(j), j)[0] > 1]
    if shaken:
        step = [100 * f.theory(j).step() for j in shaken]
        text += (
            f"; but at every frequency {joints(shaken)}, still sticking, "
            f"{'are' if len(shaken) > 1 else 'is'} shaken faster than the Stribeck velocity. "
            "That turns static into kinetic friction, a step which does not depend on frequency "
            f"({percent(max(step), 0)} to {percent(min(step), 0)}), and lets the bristles creep, "
            "the more the faster they are shaken"
        )
    return text + "." + _springs(f, flat)


def _creep_check(f: Findings) -> str:
    """Compare theory without simulation with the simulated rung, and with the robot."""
    creep = _theory_changes(f, "offset", "creep", bias=True)
    gap = np.abs(creep - 100 * f.predicted["offset"])
    stuck = f.sound & np.array([_sticks(f, "offset", c) for c in f.cells])
    far = [
        j
        for j in JOINTS
        if (mine := (f.joint == j) & stuck).any() and np.median(gap[mine]) > 2 * CLOSE
    ]
    held = f.held_out & stuck
    measured = np.abs(creep - 100 * f.measured)[held].mean()
    text = (
        f"Check: in {int(stuck.sum())} of {int(f.sound.sum())} cells the bristles' share of the "
        "dither is less than the friction, so that the joint sticks. There LuGre averaged over the "
        "shaking, a formula without simulation and with the same parameters, comes within "
        f"{np.median(gap[stuck]):.1f} points (median) of the changes simulated on rung "
        f"*{f.rungs['offset'].name}*"
    )
    if far:
        text += f", but not on {joints(far)} (over {2 * CLOSE:g} points)"
    return (
        f"{text}. As a prediction of the held-out ones among them it is off by {measured:.1f} % in "
        f"the mean, the simulation by {f.error('offset', held):.1f} %."
    )


def _sticks(f: Findings, key: str, c: Cell) -> bool:
    theory, pose = f.theory(c.row.joint, key), c.configuration.index[1]
    return bool(theory.sticks(c.row.frequency_hz, c.row.amplitude_nm, pose))


def _best(change: Array) -> float:
    """Return the frequency that helps most [Hz]."""
    return FREQUENCIES[int(np.argmin(change))]


def _slow_ratio(change: Array) -> float:
    """Return what 15 Hz, the last, does over what the best other frequency does [-]."""
    best = float((-change[:-1]).max())
    return float(-change[-1]) / best if best > 0 else float("inf")


def _favours_slow(change: Array) -> bool:
    """Return whether 15 Hz helps, and clearly more than any other frequency."""
    return bool(change[-1] < 0 and _slow_ratio(change) >= FAVOURED)


def _gains(f: Findings, numbers: Sequence[int], frequency_hz: float) -> list[float]:
    return [float(f.theory(j).bristle_gain(frequency_hz, k)) for j in numbers for k in range(2)]


def _shaken_range(theory: JointTheory, joint: int) -> tuple[float, float]:
    """Return least and largest shaking over v_s at A = friction [-]."""
    friction = thesis_base("panda").friction[joint - 1]
    v = [theory.shaking(FREQUENCIES, friction[k], k) for k in range(2)]
    ratio = np.array(v) / theory.parameter("stribeck_velocity")
    return float(ratio.min()), float(ratio.max())


def _springs(f: Findings, flat: Sequence[int]) -> str:
    elastic = [j for j in flat if f.theory(j).elastic]
    if not elastic or "elasticity" not in f.chain:
        return ""
    named = [j for j in elastic if any(g.key == "elasticity" and g.named for g in f.gains(j))]
    mask = np.isin(f.joint, elastic) & f.held_out
    before = f.chain[f.chain.index("elasticity") - 1]
    a, b = f.error(before, mask), f.error("elasticity", mask)
    tops = [f.theory(j).resonances(k) for j in elastic for k in range(2)]
    at = [x[-1][0] for x in tops if x]
    return (
        f" Springs between rotor and link, with the rotor's resonance at {span(at)} Hz, "
        f"{'lower' if b < a else 'do not lower'} the error there ({a:.1f} → {b:.1f} %), "
        f"against the scatter on {joints(named)}."
        if at
        else ""
    )


# ---- 3 -------------------------------------------------------------------------------------------


def asymmetry(f: Findings) -> list[str]:
    """Return why loaded joints look asymmetric."""
    base, signed_load = thesis_base("panda"), poses_of("panda")[0]
    lines = ["## Why the loaded joints look asymmetric", ""]
    both = "load" in f.rungs and "offset" in f.rungs
    rows = []
    for j in JOINTS:
        o, w = base.offset[j - 1], base.friction[j - 1]
        run = signed_load[j - 1, 0] - signed_load[j - 1, 1]
        row = [str(j), f"{w[0]:.2f}, {w[1]:.2f}", f"{signed(o[0], 2)}, {signed(o[1], 2)}"]
        row.append(percent(100 * (o[0] - o[1]) / run) if abs(run) > 5 and j > 1 else "–")
        if both:
            mask = f.held_out & (f.joint == j)
            row.append(f"{f.error('load', mask):.1f} → {f.error('offset', mask):.1f} %")
        rows.append(row)
    header = [
        "joint",
        "half-difference (friction), load, no load [N·m]",
        "half-sum (offset), load, no load [N·m]",
        "change of offset over gravity torque",
    ]
    lines += table(header + (["held-out error, asymmetric → offset"] if both else []), rows)
    lopsided = [j for j in JOINTS if abs(base.offset[j - 1, 0]) >= 0.3 * base.friction[j - 1, 0]]
    grown = [j for j in lopsided if abs(base.offset[j - 1, 0]) > abs(base.offset[j - 1, 1])]
    lines += [
        f"In the load pose the offset of {joints(lopsided)} is at least 0.3 of the friction; on "
        f"{joints(grown)} it is larger loaded than unloaded. That is what an error of the gravity "
        "model (or of the torque sensor's zero) does: it adds to one direction what it takes from "
        "the other. Friction with a level of its own per direction could produce the same base "
        "torques, but not the same dithered ones: dither narrows friction and leaves a bias alone.",
        "",
    ]
    if both:
        lines += _asymmetry_test(f, lopsided)
    return lines


def _asymmetry_test(f: Findings, lopsided: Sequence[int]) -> list[str]:
    mask = f.held_out
    a, b = f.error("load", mask), f.error("offset", mask)
    rows, errors = [], {"load": [], "offset": []}  # type: tuple[list[list[str]], dict[str, list[float]]]
    for c in configurations(7, list(lopsided)):
        final = f.of(c, "4.10 final")
        if c.load != "load" or not final.any():
            continue
        i = int(np.argmax(final))
        torque = abs(f.cells[i].row.tau_base_nm)
        took = -torque * f.measured[i]
        predicted = {k: -torque * f.predicted[k][i] for k in errors}
        for k, value in predicted.items():
            errors[k].append(abs(value - took))
        rows.append(
            [f"{c.joint} {place(c)}", f"{torque:.2f}", f"{took:.2f}"]
            + [f"{predicted[k]:.2f}" for k in errors]
        )
    header = ["joint, pose, direction", "base", "taken off by the final dither"]
    header += ["friction asymmetric", "offset"]
    lines = table([f"{h} [N·m]" if k else h for k, h in enumerate(header)], rows) if rows else []
    better = "an offset" if b < a else "asymmetric friction"
    text = (
        f"Over all held-out cells the error is {a:.1f} % with asymmetric friction and {b:.1f} % "
        f"with an offset: the tables speak for {better}."
    )
    if rows:
        means = {k: float(np.mean(v)) for k, v in errors.items()}
        closer = "offset" if means["offset"] < means["load"] else "asymmetric friction"
        text += (
            f" In the rows above {closer} is closer (mean difference {means['offset']:.2f} N·m "
            f"with an offset, {means['load']:.2f} N·m with asymmetric friction)."
        )
    return [*lines, text, ""]
