"""The page's part on the iiwa: dither at half the controller's rate, and what eight cells support.

Every number is computed from the study, and every sentence that might be false is chosen by it.
"""

from __future__ import annotations

from stiction_envs.reporting.markdown import listed, percent, plural, signed, table
from stiction_envs.thesis.nyquist_phase import PhaseStudy


def section(study: PhaseStudy | None) -> list[str]:
    """Return why the iiwa's trials are erratic, and what eight cells support."""
    lines = ["## Why the iiwa's trials at 100 Hz are erratic", ""]
    if study is None:
        return [*lines, "Not simulated in this run.", ""]
    rate, measured = study.controller_rate_hz, 100 * study.measured
    tones = [f"{x:g}" for x in dict.fromkeys(r.frequency_hz for r in study.rows)]
    low, high = (100 * x for x in study.simulated_range)
    random = 100 * study.over_random_phase
    up, inside = int((measured > 0).sum()), int(study.within.sum())
    n = len(measured)
    lines += [
        f"The thesis does not state its command rate; the usual driver runs at {rate:g} Hz. Held "
        f"at that rate, a sine of {listed(tones)} Hz is sampled twice "
        "per period: what is sent is ±A sin φ, and the amplitude depends on nothing but the phase "
        "φ between the sine and the controller's clock (at 200 Hz it would be a constant torque).",
        "",
        f"Simulated with the plant, {len(study.phase)} phases: at φ = 0 the joints do not notice "
        f"the dither at all, over all phases the change lies between {percent(high)} and "
        f"{percent(low)}, and one and the same setting differs by up to "
        f"{100 * study.spread_by_phase.max():.0f} points. If each of the six iterations has a "
        f"phase of its own, the mean over them is expected at {percent(random.max())} to "
        f"{percent(random.min())}.",
        "",
        f"Measured: {percent(measured.min())} to {percent(measured.max())}; {up} of {n} cells need "
        f"*more* torque with dither, and {inside} of {n} lie in what some phase gives.",
        "",
    ]
    if high > 0.5 and measured.max() <= high:
        lines += ["Phase alone can account for the whole range measured.", ""]
    else:
        lines += [
            "So phase makes the amplitude an accident, but no phase raises the torque"
            + ("" if high < 0.05 else f" by more than {high:.1f} %")
            + ": the cells that rose moved for another reason. Split into what both directions "
            "share and what they do not, as for the base torques:",
            "",
            *_iiwa_shifts(study),
        ]
    return [
        *lines,
        "![iiwa](iiwa.png)",
        "",
        f"What {plural(n, 'cell')} at one frequency and one scale support: no frequency response, "
        "hence neither rotor inertia nor bristles nor joint springs. The iiwa's friction levels "
        "and offsets are calibrated to its Table 4.3; every parameter that decides what dither "
        "does there is assumed (`friction/iiwa7.toml`). To learn them: frequencies well below "
        f"{rate / 2:g} Hz, the command rate noted, base torques repeated beside each setting, and "
        "KUKA's friction compensation known to be on or off.",
        "",
    ]


def _iiwa_shifts(study: PhaseStudy) -> list[str]:
    rows = []
    for number, load in dict.fromkeys((r.joint, r.load) for r in study.rows):
        pair = {r.direction: r for r in study.rows if (r.joint, r.load) == (number, load)}
        if set(pair) != {"+", "-"}:
            continue
        plus, minus = (pair[d].tau_sje_nm - pair[d].tau_base_nm for d in "+-")
        name = "load" if load == "load" else "no load"
        rows.append(
            [
                f"{number}, {name}",
                signed((plus - minus) / 2, 3),
                signed((plus + minus) / 2, 3),
            ]
        )
    header = ["joint, pose", "friction with dither [N·m]", "offset with dither [N·m]"]
    text = (
        "A shift of the offset is no effect of a dither without mean; the iiwa's ramps started at "
        "an averaged external torque (thesis 3.2), which goes into every reading."
    )
    return [*table(header, rows), text, ""] if rows else []
