"""The panel of the GTE: where the arm is on its path, its errors, its dither."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from stiction_envs.envs.render.panel import (
    BAND,
    BLUE,
    GRID,
    INK,
    PURPLE,
    SOFT,
    Plot,
    font,
    new_panel,
    round_up,
)

if TYPE_CHECKING:
    from stiction_envs.envs.gte_core import GTECore

Array = NDArray[np.float64]


def draw_gte_panel(core: GTECore, i: int, width: int, height: int) -> NDArray[np.uint8]:
    """Return the panel of simulation ``i``, (height, width, 3)."""
    trajectory, (translational, rotational, nullspace) = core.case[i]
    stiffness = f"{translational:g} N/m, {rotational:g} N·m/rad"
    if nullspace:
        stiffness += f", {nullspace:g} N·m/rad"
    lines = [f"{core.arm.name}  {trajectory}", f"stiffness {stiffness}"]
    image, draw = new_panel(width, height, lines, _state_line(core, i))

    assert core.recorder.trace is not None
    trace = core.recorder.trace[i]
    time = np.concatenate([[0.0], *trace.time])[1:]
    error = np.concatenate([np.zeros((1, 6)), *trace.error])[1:]
    end = round_up(max(core.undithered_duration(i), float(time[-1]) if len(time) else 0.0))
    accepted = core.rig.sequencer.accepted_at[i]
    accepted = accepted[np.isfinite(accepted) & (accepted > 0)]
    right = width - 14
    for top, bottom, part, title, least in (
        (94, 190, error[:, :3], "distance from reference [mm]", core.tolerance[0]),
        (222, 318, error[:, 3:], "rotation from reference [mrad]", core.tolerance[1]),
    ):
        size = 1e3 * np.sqrt((part**2).sum(axis=1))
        high = max(1e3 * least, 1.1 * float(size.max())) if len(size) else 1e3 * least
        plot = Plot(draw, (58, top, right, bottom), (0.0, end), (0.0, high), title)
        plot.marks(accepted, PURPLE)
        plot.legend([("new goal", PURPLE)] if top < 200 else [])
        if len(time):
            plot.line(time, size, BLUE)
    plot.time_label()
    _bars(draw, core, i, (58, 380, right, height - 38))
    return np.array(image, dtype=np.uint8)


def _state_line(core: GTECore, i: int) -> str:
    reached, goals = int(core.rig.sequencer.index[i]), int(core.goals[i])
    seconds = float(core.rig.step[i]) * 1e-3
    if not core.alive[i]:
        ratio = core.tracking_error(np.array([i]))[0]
        return f"over: error {100 * ratio:.0f} % of undithered"
    if reached == goals:
        return f"last goal reached, {seconds:.1f} s"
    return f"on the way to goal {reached + 1} of {goals}, {seconds:.1f} s"


def _bars(draw: ImageDraw.ImageDraw, core: GTECore, i: int, box: tuple[int, int, int, int]) -> None:
    """Draw amplitude (share of A_max) and frequency of every joint's dither."""
    left, top, right, bottom = box
    draw.text((14, top - 20), "dither: share of A_max, frequency [Hz]", font=font(12), fill=INK)
    amplitude, frequency = np.split(core.action[i], 2)
    share = amplitude / core.action_space.high[: core.n]
    pitch = (right - left) / core.n
    draw.rectangle(box, outline=SOFT)
    for j in range(core.n):
        low, high = left + (j + 0.18) * pitch, left + (j + 0.82) * pitch
        middle = 0.5 * (low + high)
        draw.rectangle((low, top + 1, high, bottom - 1), fill=GRID)
        if share[j] > 0:
            edge = bottom - share[j] * (bottom - top - 1)
            draw.rectangle((low, min(edge, bottom - 1), high, bottom - 1), fill=BAND)
            draw.line((low, edge, high, edge), fill=BLUE, width=2)
            place = (middle, bottom + 18)
            draw.text(place, f"{frequency[j]:.0f}", font=font(11), fill=INK, anchor="mt")
        draw.text((middle, bottom + 4), f"J{j + 1}", font=font(11), fill=SOFT, anchor="mt")
