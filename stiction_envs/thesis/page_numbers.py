"""The numbers of the nested models' pages, all of them computed; the words are in ``templates/``.

`numbers` returns what the hand-written `gap.md` and its tables ask for by name: plain numbers in
the units of the page (per cent of the base torque, Hz, N·m, mrad), so that it can quote no other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.protocol import Configuration, configurations
from stiction_envs.measured import thesis_base
from stiction_envs.thesis.joint_theory import poses_of
from stiction_envs.thesis.nyquist_phase import PhaseStudy
from stiction_envs.thesis.scores import FREQUENCIES, JOINTS, SAME_LOSS, SAME_RANGE, ModelScores

Array = NDArray[np.float64]
POSES = {"load": "load", "no_load": "no load"}
SLOW, FLAT = (5, 6, 7), (1, 2, 3, 4)
"""Joints the page says 15 Hz frees, and those on which frequency hardly matters."""
SHAKEN = (1, 2, 4)
"""Of the latter, those shaken faster than the Stribeck velocity at every frequency."""
LOPSIDED = (2, 3, 4)
"""Joints with an offset of 0.3 of the friction and more in the load pose."""
CLOSE = 2.0
"""Theory and simulation agree when they differ by less, in points of the base torque; assumed."""
GRAVITY = 5.0
"""Change of a joint's gravity torque between the poses from which it is compared with [N·m]."""


def place(where: Configuration) -> str:
    """Return ``load +`` and the like, with a true minus."""
    return f"{POSES[where.load]} {'+' if where.direction == '+' else '−'}"


def numbers(s: ModelScores, study: PhaseStudy) -> dict[str, Any]:
    """Return every number the page quotes, by name."""
    found = [p for j in JOINTS for p in s.identified(j)]
    fitted, elastic = s.table == "4.6", np.isin(s.joint, FLAT) & s.held_out
    return {
        **overview(s),
        "frequencies": FREQUENCIES,
        "repeats": int((s.table == "4.10 intermediate").sum()),
        "j": {j: joint(s, j) for j in JOINTS},
        "mean_change": {"measured": s.mean(fitted), "band": s.mean(fitted, "band")},
        "final": [s.mean((s.joint == j) & (s.table == "4.10 final")) for j in JOINTS],
        "averaging": averaging(s),
        "creep": creep(s),
        "slow": group(s, SLOW),
        "flat": group(s, FLAT),
        "shaken": group(s, SHAKEN),
        "springs": [s.error(k, elastic) for k in ("path", "elasticity")],
        "taken": taken(s),
        "iiwa": iiwa(study),
        "identified": sum(p.verdict == "yes" for p in found),
        "parameters": len(found),
        "same_loss": SAME_LOSS,
        "same_range": SAME_RANGE,
        "ramp": ramp(s),
        "plastic": s.preferred("elasto-plastic", "drift"),
        "residual": residual(s),
    }


def overview(s: ModelScores) -> dict[str, Any]:
    """Return the numbers of all models."""
    return {
        "cells": len(s.cells),
        "held_out": int(s.held_out.sum()),
        "model": s.scores,
        "models": s.models,
        "floor": s.floor,
        "targets": s.targets(),
        "broken": [cell(s, i) for i, c in enumerate(s.cells) if c.row.outlier],
    }


def cell(s: ModelScores, i: int) -> dict[str, Any]:
    """Return one cell, measured and predicted by the last model."""
    c = s.cells[i]
    return {
        "table": c.row.table,
        "column": c.column,
        "joint": c.row.joint,
        "place": place(c.configuration),
        "frequency": c.row.frequency_hz,
        "scale": c.row.scale,
        "amplitude": c.row.amplitude_nm,
        "measured": 100 * c.change,
        "predicted": 100 * s.predicted[s.last][i],
        "errors": {k: s.scores[k].error[i] for k in ("nothing", s.last)},
    }


# ---- joints --------------------------------------------------------------------------------------


def joint(s: ModelScores, number: int) -> dict[str, Any]:
    """Return the numbers of one joint; by pose (load, no load) where theory depends on it."""
    theory, base, j = s.theory(number), thesis_base("panda"), number - 1
    held, residuals = s.held_out & (s.joint == number), s.residual()
    means = {c: float(residuals[held & s.of(c)].mean()) for c in configurations(7, [number])}
    worst = max(means, key=lambda c: abs(means[c]))
    asked = {c: 100 * (x - 1) for c, x in s.drift().items() if c.joint == number}
    furthest = max(asked, key=lambda c: abs(asked[c]))
    friction, offset = base.friction[j], base.offset[j]
    peaks = [theory.resonances(k) for k in range(2)]
    near = [p for p in peaks[0] if min(FREQUENCIES) / 1.5 < p[0] < max(FREQUENCIES)]
    run = float(poses_of("panda")[0][j] @ (1, -1))
    speeds = np.array([theory.shaking(FREQUENCIES, friction[k], k) for k in range(2)])
    gains = s.gains(number)
    return {
        "constant": s.constant(number),
        "now": s.scores[s.last].by_joint[number],
        "error": {k: x.by_joint[number] for k, x in s.scores.items()},
        "statements": gains,
        "gain": {g.key: g.points for g in gains},
        "causes": sorted((g for g in gains if g.named), key=lambda g: -g.points),
        "shares": [100 * x for x in s.shares(number)],
        "worst": {"place": place(worst), "points": means[worst]},
        "worst_cell": cell(s, int(np.argmax(np.where(held, np.abs(residuals), -1)))),
        "asked": {"place": place(furthest), "percent": asked[furthest]},
        "dithered": 100 * s.measured[s.of(furthest, "4.6")],
        "change": [[s.mean(s.at(number, f), k) for f in FREQUENCIES] for k in (None, s.last)],
        "rotor": theory.rotor,
        "bristles": theory.parameter("bristle_stiffness"),
        "spring": theory.stiffness,
        "elastic": theory.elastic,
        "resonances": dict.fromkeys(f"{f:.0f}" for f in sorted(f for p in peaks for f, _ in p)),
        "resonance": max(near, key=lambda p: p[1], default=None),
        "rotor_resonance": [p[-1][0] for p in peaks if p],
        "arrives": np.array([theory.bristle_gain(FREQUENCIES, k) for k in range(2)]),
        "swing": 1e3 * np.array([theory.stroke(FREQUENCIES, friction[k], k) for k in range(2)]),
        "shaken": speeds / theory.parameter("stribeck_velocity"),
        "step": 100 * theory.step(),
        "friction": friction,
        "offset": offset,
        "over_gravity": 100 * (offset[0] - offset[1]) / run
        if abs(run) > GRAVITY and number > 1
        else None,
        "taken": [x["taken"] for x in final_dither(s, [number])],
        "found": {p.name: p for p in s.identified(number)},
        "seeds": s.seeds(number),
    }


def final_dither(s: ModelScores, joints: Sequence[int]) -> list[dict[str, Any]]:
    """Return what the final dither takes off in the load pose, + and −, three ways [N·m]."""
    out = []
    for c in configurations(7, list(joints)):
        i = int(np.argmax(s.of(c, "4.10 final")))
        row = s.cells[i].row
        base = abs(row.tau_base_nm)
        both = {k: float(-base * s.predicted[k][i]) for k in ("load", "offset")}
        measured = base - abs(row.tau_sje_nm)
        if c.load == "load":
            where = f"{c.joint} {place(c)}"
            out.append({"place": where, "base": base, "taken": measured, **both})
    return out


def taken(s: ModelScores) -> dict[str, Any]:
    """Return `final_dither` of the lopsided joints, and how far both readings are off [N·m]."""
    rows = final_dither(s, LOPSIDED)
    off = {k: float(np.mean([abs(x[k] - x["taken"]) for x in rows])) for k in ("load", "offset")}
    return {"rows": rows, **off}


def group(s: ModelScores, joints: Sequence[int]) -> dict[str, Any]:
    """Return what frequency does to some joints together."""
    change = [
        [[s.mean(s.at(j, x), k) for x in FREQUENCIES] for j in joints] for k in (None, s.last)
    ]
    theories = [s.theory(j) for j in joints]
    arrives = {
        f: [float(t.bristle_gain(f, k)) for t in theories for k in range(2)] for f in FREQUENCIES
    }
    return {
        "measured": [favoured(x) for x in change[0]],
        "predicted": [favoured(x) for x in change[1]],
        "spread": np.ptp(change[0], axis=1),
        "rotor": [100 * t.rotor / (t.rotor + t.link(0)) for t in theories],
        "arrives": arrives,
        "most": max(map(max, arrives.values())),
        "step": [100 * t.step() for t in theories],
        "resonances": [p[-1][0] for t in theories for k in range(2) if (p := t.resonances(k))],
    }


def favoured(change: Sequence[float]) -> float:
    """Return what 15 Hz, the last, does over what the best other frequency does [-]."""
    best = -min(change[:-1])
    return -change[-1] / best if best > 0 else float("inf")


# ---- theory without simulation -------------------------------------------------------------------


def _theory(s: ModelScores, key: str, kind: str, *, bias: bool) -> Array:
    """Return (cells,) what a theory predicts with the parameters of a model [% of base]."""
    theories = {j: s.theory(j, key) for j in JOINTS}
    changes = [
        theories[c.row.joint].change(
            kind, c.configuration, c.row.frequency_hz, c.row.amplitude_nm, bias=bias
        )
        for c in s.cells
    ]
    return 100 * np.array(changes, dtype=float)


def averaging(s: ModelScores) -> tuple[int, int]:
    """Return how many cells of the model without bristles averaging theory bears out, and of."""
    free, sliding = (_theory(s, "inertia", k, bias=False) for k in ("free", "sliding"))
    simulated = 100 * s.predicted["inertia"]
    low, high = np.minimum(free, sliding) - CLOSE, np.maximum(free, sliding) + CLOSE
    return int(((low <= simulated) & (simulated <= high)).sum()), len(simulated)


def creep(s: ModelScores) -> dict[str, float]:
    """Compare shaken bristles, a formula, with the simulation and with the robot."""
    theory = _theory(s, "offset", "creep", bias=True)
    joints = {j: s.theory(j, "offset") for j in JOINTS}
    sticks = [
        joints[c.row.joint].sticks(c.row.frequency_hz, c.row.amplitude_nm, c.configuration.index[1])
        for c in s.cells
    ]
    stuck = s.sound & np.array(sticks)
    held = s.held_out & stuck
    return {
        "stuck": int(stuck.sum()),
        "cells": int(s.sound.sum()),
        "gap": float(np.median(np.abs(theory - 100 * s.predicted["offset"])[stuck])),
        "error": float(np.abs(theory - 100 * s.measured)[held].mean()),
        "simulated": s.error("offset", held),
    }


# ---- the iiwa, the fit, and what is left ---------------------------------------------------------


def iiwa(study: PhaseStudy) -> dict[str, Any]:
    """Return the numbers of the part on the iiwa [% of base]."""
    measured = 100 * study.measured
    low, high = (100 * x for x in study.simulated_range)
    shift = {
        (r.joint, POSES[r.load], r.direction): r.tau_sje_nm - r.tau_base_nm for r in study.rows
    }
    pairs = {k[:2]: (shift[(*k[:2], "+")], shift[(*k[:2], "-")]) for k in shift}
    return {
        "rate": study.controller_rate_hz,
        "phases": len(study.phase),
        "low": low,
        "high": high,
        "spread": 100 * study.spread_by_phase.max(),
        "random": 100 * study.over_random_phase,
        "measured": measured,
        "up": int((measured > 0).sum()),
        "within": int(study.within.sum()),
        "cells": len(measured),
        "shifts": {k: ((a - b) / 2, (a + b) / 2) for k, (a, b) in pairs.items()},
    }


def ramp(s: ModelScores) -> dict[str, Any]:
    """Return how well each ramp rate [N·m/s] fits, and whether clearly worse than the best."""
    rates = s.ramp_rates()
    loss = {r: float(s.models[k].loss or 0.0) for r, k in rates.items()}
    best = min(loss, key=loss.__getitem__)
    rows = []
    for r, k in rates.items():
        gap, error = s.preferred(rates[best], k)
        mean = s.scores[k].mean
        worse = r != best and gap >= error
        rows.append(
            {"rate": r, "loss": loss[r], "over": loss[r] - loss[best], "worse": worse, "mean": mean}
        )
    return {"rows": rows, "best": best, "reach": np.ptp([x["mean"] for x in rows])}


def residual(s: ModelScores) -> dict[str, Any]:
    """Return how the squared held-out residual is made up [%], and the worst configurations."""
    r = s.residual()
    squares = np.array([(r[s.held_out & (s.joint == j)] ** 2).sum() for j in JOINTS])
    share = squares / (squares.sum() or 1.0)
    means = {c: float(r[s.held_out & s.of(c)].mean()) for c in configurations(7)}
    worst = sorted(means, key=lambda c: -abs(means[c]))
    return {
        "first_four": 100 * share[:4].sum(),
        "parts": 100 * share @ np.array([s.shares(j) for j in JOINTS]),
        "worst": [{"where": f"joint {c.joint} {place(c)}", "points": means[c]} for c in worst],
    }
