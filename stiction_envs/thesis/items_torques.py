"""Tables 4.3 and 4.5 to 4.10: breakaway torques, simulated beside measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stiction_envs.experiments.sje.protocol import Configuration, Job, Measurement
from stiction_envs.gap.tables.cells import FITTED, cells, repeat_floor
from stiction_envs.measured import thesis_base, thesis_robots, thesis_table
from stiction_envs.measured.thesis_robots import our_name
from stiction_envs.reporting.markdown import signed
from stiction_envs.robots import load_arm
from stiction_envs.thesis.items import Found, Item, Needs, Written, say, write_table
from stiction_envs.thesis.tables import ChosenRow, TableRow, jobs_of_table, rows_of_table

POSES = {"load": "load", "no_load": "no load"}
EXTRA = ("simulated_tau_Nm", "simulated_std_Nm", "simulated_change_pct", "difference_points")
"""Columns added to the thesis's own; the difference is of changes, or per cent of a base torque."""


def torque_needs(number: str) -> Callable[[], Needs]:
    """Return what a table needs."""
    return lambda: {"sje": jobs_of_table(number)}


def chosen_needs() -> Needs:
    """Return what Table 4.9 needs: all that its rules choose from."""
    return {"sje": jobs_of_table("4.9"), "choice": range(1, 8)}


def by_robot(found: Mapping[tuple[str, Job], Measurement]) -> dict[str, dict[Job, Measurement]]:
    """Return measurements by robot and job."""
    out: dict[str, dict[Job, Measurement]] = {}
    for (robot, job), m in found.items():
        out.setdefault(robot, {})[job] = m
    return out


def configuration_name(c: Configuration, robot: str = "") -> str:
    """Return ``Panda 1 load (+)``."""
    sign = "+" if c.direction == "+" else "−"
    return f"{robot} {c.joint} {POSES[c.load]} ({sign})".strip()


# ---- base torques --------------------------------------------------------------------------------


def write_base(item: Item, found: Found, folder: Path) -> Written:
    """Write Table 4.3."""
    rows = rows_of_table("4.3", by_robot(found["sje"]))
    of = {(r.robot, r.configuration): r for r in rows}
    lines, shown = [], []
    for printed in thesis_table("4.3"):
        robot = our_name(printed["robot"])
        r = of[robot, _configuration(printed)]
        lines.append([*printed.values(), r.simulated_nm, r.simulated_std_nm, 0.0, r.difference])
        shown.append(
            [
                configuration_name(r.configuration, thesis_robots()[robot].title),
                signed(r.measured_nm, 4),
                _torque(r.simulated_nm, 4),
                f"{_torque(r.difference, 2)} %",
            ]
        )
    gaps = {r: abs(r.difference) for r in rows if math.isfinite(r.difference)}
    worst = max(gaps, key=gaps.__getitem__) if gaps else None
    said = say(
        "base",
        cells=len(rows),
        stuck=len(rows) - len(gaps),
        mean=float(np.mean(list(gaps.values()))) if gaps else math.nan,
        largest=max(gaps.values(), default=math.nan),
        where=worst and configuration_name(worst.configuration, thesis_robots()[worst.robot].title),
        iterations=_iterations(found),
    )
    return write_table(
        item,
        folder,
        columns=[*thesis_table("4.3")[0], *EXTRA],
        rows=lines,
        header=["robot, joint, pose, direction", "measured [N·m]", "simulated [N·m]", "difference"],
        shown=shown,
        said=said,
    )


def _iterations(found: Found) -> int:
    return min(len(m.tau) for m in found["sje"].values())


def _configuration(printed: Mapping[str, Any]) -> Configuration:
    return Configuration(printed["joint"], printed["load"], printed["direction"])


def _torque(value: float, digits: int) -> str:
    return "stuck" if math.isnan(value) else signed(value, digits)


# ---- dithered torques ----------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How a table of dithered torques compares."""

    cells: int
    mean: float
    """Mean |difference| [points of the base torque]."""
    largest: float
    where: str
    """The configuration of the largest."""
    nothing: float
    """Mean |difference| if dither did nothing [points]."""
    signs: int
    """Cells whose sign of the change is right."""
    rises: int
    """Cells that rose in print."""
    rises_right: int
    own_rises: int
    """Simulated torques that dither raises."""
    constant: float
    """Share of the squared difference that every configuration has at all its settings [-]."""
    worst_joint: int
    worst_joint_mean: float
    stuck: int


def agreement(rows: Sequence[TableRow]) -> Agreement:
    """Return how dithered rows compare; the one broken cell counts nowhere."""
    sound = [r for r in rows if not r.outlier]
    good = [r for r in sound if math.isfinite(r.difference)]
    if not good:
        none = math.nan
        return Agreement(
            cells=len(sound),
            mean=none,
            largest=none,
            where="",
            nothing=none,
            signs=0,
            rises=0,
            rises_right=0,
            own_rises=0,
            constant=none,
            worst_joint=0,
            worst_joint_mean=none,
            stuck=len(sound),
        )
    gap = np.array([r.difference for r in good])
    measured = np.array([r.measured_change_pct for r in good])
    right = np.sign([r.simulated_change_pct for r in good]) == np.sign(measured)
    of = np.array([str(r.configuration) for r in good])
    constant = sum(float((of == c).sum() * gap[of == c].mean() ** 2) for c in dict.fromkeys(of))
    joints = {r.joint for r in good}
    by_joint = {
        j: float(np.mean([abs(r.difference) for r in good if r.joint == j])) for j in joints
    }
    worst = good[int(np.argmax(np.abs(gap)))]
    joint = max(by_joint, key=by_joint.__getitem__)
    return Agreement(
        cells=len(sound),
        mean=float(np.mean(np.abs(gap))),
        largest=float(np.max(np.abs(gap))),
        where=f"joint {configuration_name(worst.configuration)}",
        nothing=float(np.mean(np.abs(measured))),
        signs=int(right.sum()),
        rises=int((measured > 0).sum()),
        rises_right=int(right[measured > 0].sum()),
        own_rises=sum(r.simulated_change_pct > 0 for r in good),
        constant=constant / float(np.square(gap).sum()) if gap.any() else 0.0,
        worst_joint=joint,
        worst_joint_mean=by_joint[joint],
        stuck=len(sound) - len(good),
    )


def write_dithered(item: Item, found: Found, folder: Path) -> Written:
    """Write Tables 4.5, 4.6, 4.7, 4.8 or 4.10."""
    number = item.id
    rows = rows_of_table(number, by_robot(found["sje"]))
    (robot,) = thesis_robots(number)
    arm = load_arm(robot)
    half = arm.controller_rate_hz / 2
    said = say(
        "dithered",
        number=number,
        a=agreement(rows),
        fitted=number in FITTED,
        repeats=repeat_floor(cells())[0],
        nyquist=all(r.frequency_hz == half for r in rows),
        rate=arm.controller_rate_hz,
        frequency=rows[0].frequency_hz,
        iterations=_iterations(found),
    )
    key = _column_of(number)
    columns = list(dict.fromkeys(map(key, rows)))
    bases = {r.configuration: found["sje"][robot, Job(r.configuration)].mean for r in rows}
    # Table 4.10's printed rows alternate between the sets of amplitudes, as ours do
    lines = [
        [
            *printed.values(),
            bases[r.configuration],
            r.simulated_nm,
            r.simulated_std_nm,
            r.simulated_change_pct,
            r.difference,
        ]
        for printed, r in zip(thesis_table(number), rows, strict=True)
    ]
    cells_of: dict[Configuration, dict[Any, list[str]]] = {}
    for r in rows:
        cells_of.setdefault(r.configuration, {})[key(r)] = [
            f"{signed(r.measured_nm, 3)} ({signed(r.measured_change_pct, 1)})"
            + (" †" if r.outlier else ""),
            f"{_torque(r.simulated_nm, 3)} ({_torque(r.simulated_change_pct, 1)})",
            _torque(r.difference, 1),
        ]
    header = ["joint, pose, direction", "base [N·m]: measured", "simulated"]
    for c in columns:
        name = c if isinstance(c, str) else f"{c:g} Hz"
        header += [f"{name}: measured [N·m] (%)", "simulated (%)", "difference [points]"]
    blank, base = ["", "", ""], thesis_base(robot)
    shown = [
        [configuration_name(c), signed(base.get(c.joint, c.load, c.direction), 3)]
        + [_torque(bases[c], 3)]
        + [text for k in columns for text in mine.get(k, blank)]
        for c, mine in cells_of.items()
    ]
    return write_table(
        item,
        folder,
        columns=[*thesis_table(number)[0], "simulated_tau_base_Nm", *EXTRA],
        rows=lines,
        header=header,
        shown=shown,
        said=said,
    )


def _column_of(number: str) -> Callable[[TableRow], Any]:
    if number == "4.10":
        return lambda r: r.amplitude_set
    return lambda r: r.frequency_hz


# ---- chosen settings -----------------------------------------------------------------------------


def write_chosen(item: Item, found: Found, folder: Path) -> Written:
    """Write Table 4.9: the thesis's rules on simulated torques."""
    chosen: Mapping[int, ChosenRow] = found["choice"]
    lines = []
    for printed in thesis_table("4.9"):
        c = chosen[printed["joint"]]
        values = [("yes" if x else "no") if isinstance(x, bool) else x for x in printed.values()]
        amplitude = c.simulated_scale * abs(printed["tau_base_Nm"])
        difference = c.simulated_final_nm - c.measured_final_nm
        lines.append(
            [
                *values,
                c.simulated_frequency_hz,
                c.simulated_scale,
                math.copysign(amplitude, printed["tau_base_Nm"]),
                c.simulated_final_nm,
                difference,
            ]
        )
    shown = [
        [
            str(c.joint),
            f"{c.measured_frequency_hz:g}, {_printed_scale(c):g}, {c.measured_final_nm:.4f}",
            f"{c.simulated_frequency_hz:g}, {c.simulated_scale:g}, {c.simulated_final_nm:.4f}",
            f"{signed(c.simulated_final_nm - c.measured_final_nm, 4)}",
            c.reason,
        ]
        for c in chosen.values()
    ]
    same = [c for c in chosen.values() if c.simulated_frequency_hz == c.measured_frequency_hz]
    scales = [c for c in chosen.values() if c.simulated_scale == _printed_scale(c)]
    gaps = {c.joint: c.simulated_final_nm / c.measured_final_nm - 1 for c in chosen.values()}
    furthest = max(gaps, key=lambda j: abs(gaps[j]))
    said = say(
        "chosen",
        joints=len(chosen),
        frequencies=len(same),
        scales=len(scales),
        close=sum(abs(g) <= 0.05 for g in gaps.values()),
        furthest=furthest,
        gap=100 * gaps[furthest],
        other=[
            {
                "joint": c.joint,
                "measured": c.measured_frequency_hz,
                "simulated": c.simulated_frequency_hz,
                "apart": abs(_printed_mean(c, c.measured_frequency_hz) - _printed_mean(c)),
            }
            for c in chosen.values()
            if c not in same
        ],
        repeats=repeat_floor(cells())[0],
        hand=next(p["joint"] for p in thesis_table("4.9") if p["final_set_by_hand"]),
    )
    names = ("frequency_Hz", "scale", "tau_intermediate_Nm", "tau_final_Nm")
    return write_table(
        item,
        folder,
        columns=[
            *thesis_table("4.9")[0],
            *(f"simulated_{name}" for name in names),
            "difference_final_Nm",
        ],
        rows=lines,
        header=["joint", "measured: f [Hz], scale, A [N·m]", "simulated", "difference of A", "why"],
        shown=shown,
        said=said,
    )


def _printed_mean(c: ChosenRow, frequency_hz: float | None = None) -> float:
    """Return the mean change at scale 1.0 in print [%], at the simulated frequency for None."""
    f = c.simulated_frequency_hz if frequency_hz is None else frequency_hz
    rows = [r for r in thesis_table("4.6") if (r["joint"], r["frequency_Hz"]) == (c.joint, f)]
    return float(np.mean([r["change_pct"] for r in rows]))


def _printed_scale(c: ChosenRow) -> float:
    """Return the scale of a joint in print; joint 3's is a misprint for 1.2."""
    return 1.2 if c.joint == 3 else c.measured_scale
