"""The page of the nested models: `gap.md` and its pictures.

    write_page(folder, nested.models)

Numbers are in per cent of the base torque unless a table says otherwise.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.thesis.nested_models import figures
from benchmarks.thesis.nested_models.cells import FREQUENCIES, JOINTS, cells
from benchmarks.thesis.nested_models.models import NestedModel
from benchmarks.thesis.nested_models.scores import (
    ARM,
    SAME_LOSS,
    SAME_RANGE,
    Gain,
    ModelScores,
)
from stiction_envs.experiments.sje.protocol import SIGNS, Configuration
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.html import to_html
from stiction_envs.reporting.markdown import number, percent, short, signed, table_text
from stiction_envs.reporting.templates import render

TEMPLATE = Path(__file__).with_name("gap.md.j2")
IIWA = Path(__file__).with_name("iiwa.png")
"""Simulated once: the phase between dither and controller."""
CAUSES = {
    "inertia": "rotor inertia",
    "presliding": "presliding and Stribeck effect",
    "path": "torque path: low-pass and rate limit",
    "elasticity": "spring between rotor and link",
    "load": "friction of its own in each pose",
    "offset": "offset: bias of gravity model or sensor, not friction",
    "drift": "the base moved between measuring days",
    "arm + drift": "the whole arm instead of a lone joint",
}
PARAMETERS = {
    "rotor_inertia": "rotor inertia [kg·m²]",
    "bristle_stiffness": "bristles σ0 [N·m/rad]",
    "coulomb_ratio": "F_c/F_s",
    "stribeck_velocity": "Stribeck v_s [rad/s]",
    "joint_stiffness": "joint spring K [N·m/rad]",
}


def write_page(folder: Path, models: Mapping[str, NestedModel]) -> list[tuple[str, float, float]]:
    """Write `gap.md`, `report.html` and their pictures.

    Args:
        folder: where; it exists.
        models: by key, as `NestedModels.models` when all are fitted.

    Returns:
        Name, mean and median error [% of base torque] of every model, and of the thesis's repeats.
    """
    scores = ModelScores(models, cells())
    figures.models(scores, folder / "ladder.png")
    for j in JOINTS:
        figures.joint(scores, j, folder / f"joint_{j}.png")
    (folder / IIWA.name).write_bytes(IIWA.read_bytes())
    text = page(scores)
    write_text_atomic(folder / "gap.md", text)
    title = "The thesis's dithered torques, model by model"
    write_text_atomic(folder / "report.html", to_html(text.splitlines(), folder, title))
    found = [(x.name, x.mean, x.median) for x in scores.scores.values()]
    return [*found, ("the thesis repeated", *scores.floor)]


def page(s: ModelScores) -> str:
    """Return the page."""
    parameters = [p for j in JOINTS for p in s.identified(j)[0]]
    i = int(np.flatnonzero(~s.sound)[0])
    c = s.cells[i]
    return render(
        TEMPLATE,
        scores=s.scores,
        last=s.scores[ARM],
        held_out=int(s.held_out.sum()),
        cells=len(s.cells),
        floor=s.floor,
        models=_models(s),
        outlier=f"Table {c.column}, joint {c.row.joint} {_place(c.configuration)}, "
        f"{c.row.frequency_hz:g} Hz, {number(c.row.amplitude_nm, 2)} N·m: "
        f"{percent(100 * c.change)} measured, {percent(100 * s.predicted[ARM][i])} predicted",
        overview=_overview(s),
        causes=_causes(s),
        joints=_joints(s),
        identified=(sum(p.verdict == "yes" for p in parameters), len(parameters)),
        same_loss=SAME_LOSS,
        same_range=SAME_RANGE,
        identification=_identification(s),
    )


def _place(where: Configuration) -> str:
    """Return ``load +`` and the like, with a true minus."""
    return f"{where.load.replace('_', ' ')} {SIGNS[where.direction]}"


# ---- models and causes ---------------------------------------------------------------------------


def _models(s: ModelScores) -> str:
    columns = list(s.scores[ARM].by_column)
    header = ["model", "mean [95 %]", "median", *columns, *(f"J{j}" for j in JOINTS), "statement"]
    rows = [
        [
            x.name,
            f"{number(x.mean)} [{number(x.low)}, {number(x.high)}]",
            number(x.median),
            *map(number, (*x.by_column.values(), *x.by_joint.values())),
            s.models[key].statement.rstrip("."),
        ]
        for key, x in s.scores.items()
    ]
    return table_text(header, rows)


def _overview(s: ModelScores) -> str:
    rows = []
    for j in JOINTS:
        values = (s.scores["nothing"].by_joint[j], s.constant(j), s.scores[ARM].by_joint[j])
        moved = {c: 100 * (x - 1) for c, x in s.drift().items() if c.joint == j}
        c = max(moved, key=lambda c: abs(moved[c]))
        base = f"{percent(moved[c])} ({_place(c)})"
        rows.append([str(j), *(f"{number(x)} %" for x in values), base])
    header = ["joint", "dither does nothing", "constant", "last model"]
    return table_text([*header, "base of Table 4.6 against 4.3, furthest"], rows)


def _causes(s: ModelScores) -> str:
    """Return what every statement took off the error, joint by joint."""
    gains = [s.gains(j) for j in JOINTS]

    def cell(g: Gain) -> str:
        free = " ‡" if g.free else ""
        x, mark = g.shown, "**" if g.named else "*" if g.worse else ""
        return f"{mark}{signed(x.points)} [{signed(x.low)}, {signed(x.high)}]{free}{mark}"

    rows = [[CAUSES[row[0].key], *map(cell, row)] for row in zip(*gains, strict=True)]
    return table_text(["statement", *(f"joint {j}" for j in JOINTS)], rows)


def _joints(s: ModelScores) -> str:
    """Return what frequency does to every joint, as measured and by the last model."""
    rows = [
        [str(j), *(", ".join(signed(s.at(j, f, key)) for f in FREQUENCIES) for key in (None, ARM))]
        for j in JOINTS
    ]
    measured = f"measured at {', '.join(f'{f:g}' for f in FREQUENCIES)} Hz [%]"
    return table_text(["joint", measured, "last model [%]"], rows)


# ---- the fit -------------------------------------------------------------------------------------


def _identification(s: ModelScores) -> str:
    rows = []
    for j in JOINTS:
        found, seeds = s.identified(j)
        texts = {}
        for p in found:
            ends = f" [{short(p.low)}, {short(p.high)}]" if p.seeds > 1 else ""
            mark = " †" if p.on_bound else " ‡" if p.verdict == "no" else ""
            texts[p.name] = short(p.best) + ends + mark
        good = f"{found[0].seeds} of {seeds}"
        rows.append([str(j), *(texts.get(n, "–") for n in PARAMETERS), good])
    return table_text(["joint", *PARAMETERS.values(), "seeds as good"], rows)
