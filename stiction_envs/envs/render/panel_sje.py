"""The panel beside the scene of the SJE: which joint, how it is dithered, torque and angle.

`Plot` and the fonts are shared with the other environments' panels.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from stiction_envs.envs.trace import Trace

if TYPE_CHECKING:
    from stiction_envs.envs.sje_core import Core

Array = NDArray[np.float64]
Colour = tuple[int, int, int]
INK, SOFT, GRID, PAPER = (35, 38, 44), (110, 115, 124), (226, 228, 232), (255, 255, 255)
BLUE, BAND, ORANGE, PURPLE = (20, 90, 180), (178, 205, 240), (225, 95, 0), (150, 70, 180)


@functools.lru_cache
def font(size: int, bold: bool = False) -> Any:
    """Return a font of a size [pixel]."""
    from matplotlib import get_data_path

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(get_data_path()) / "fonts" / "ttf" / name), size)


def draw_panel(core: Core, i: int, width: int, height: int) -> NDArray[np.uint8]:
    """Return the panel of slot ``i``, (height, width, 3)."""
    assert core.trace is not None
    trace, c, base = core.trace[i], core.configuration[i], float(core.tau_base[i])
    image = Image.new("RGB", (width, height), PAPER)
    draw = ImageDraw.Draw(image)
    title = f"{core.arm.name}  joint {c.joint}"
    draw.text((14, 8), title, font=font(17, bold=True), fill=INK)
    pose = "load pose" if c.load == "load" else "no-load pose"
    draw.text((14, 31), f"{pose}, direction {c.direction}", font=font(13), fill=INK)
    draw.text((14, 50), _dither_line(trace), font=font(13), fill=INK)
    draw.text((14, 69), _state_line(core, i, base), font=font(13, bold=True), fill=ORANGE)

    time = np.array(trace.time)
    torque, size = np.array(trace.torque), np.array(trace.amplitude)
    ramp = abs(base) / core.rig.protocol.ramp_rate
    end = round_up(max(1.2 * ramp, float(time[-1]) if len(time) else 0.0))
    low, high = min(0.0, 1.25 * base), max(0.0, 1.25 * base)
    if len(time):
        low, high = min(low, float((torque - size).min())), max(high, float((torque + size).max()))
    top = Plot(draw, (58, 112, width - 14, 254), (0.0, end), (low, high), "torque [N·m]")
    top.level(base, SOFT, "τ_base")
    if len(time):
        top.band(time, torque - size, torque + size, BAND)
        top.line(time, torque, BLUE)
    top.legend([("with dither", BAND), ("without", BLUE)])

    threshold = c.sign * core.rig.protocol.threshold
    moved = np.array(trace.displacement)
    low, high = min(-0.02, 1.2 * threshold), max(0.02, 1.2 * threshold)
    if len(time):
        low, high = min(low, float(moved.min())), max(high, float(moved.max()))
    below = (58, 296, width - 14, height - 42)
    bottom = Plot(draw, below, (0.0, end), (low, high), "angle since start [rad]")
    bottom.level(threshold, SOFT, "threshold")
    if len(time):
        bottom.line(time, moved, ORANGE)
    bottom.time_label()
    return np.array(image, dtype=np.uint8)


def _dither_line(trace: Trace) -> str:
    if not trace.time or trace.amplitude[-1] == 0:
        return "no dither on this joint"
    return f"dither {trace.amplitude[-1]:.2f} N·m at {trace.frequency[-1]:.0f} Hz"


def _state_line(core: Core, i: int, base: float) -> str:
    if core.alive[i]:
        seconds = core.trace[i].time[-1] if core.trace and core.trace[i].time else 0.0
        return f"ramp: {seconds:.1f} s, {core.torque(np.array([i]))[0]:+.2f} N·m"
    tau = float(core.rig.tau[i])
    if not np.isfinite(tau):
        return "given up"
    return f"broke away at {tau:+.2f} N·m (base {base:+.2f})"


def round_up(value: float) -> float:
    """Return the next multiple of 5 [s]."""
    return 5.0 * float(np.ceil(value / 5.0))


def _ticks(low: float, high: float, most: int = 5) -> Array:
    """Return at most ``most`` + 1 round numbers between ``low`` and ``high``."""
    raw = (high - low) / most
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next(m for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * power >= raw)
    return np.asarray(
        step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)
    )


class Plot:
    """Axes drawn with PIL: small, and some twenty times faster than Matplotlib."""

    def __init__(
        self,
        draw: ImageDraw.ImageDraw,
        box: tuple[int, int, int, int],
        x: tuple[float, float],
        y: tuple[float, float],
        title: str,
    ) -> None:
        self._draw, self._box, self._x, self._y = draw, box, x, y
        left, top, right, bottom = box
        draw.text((14, top - 20), title, font=font(12), fill=INK)
        for value in _ticks(*y, most=4):
            at = float(self._at(x[0], value)[1])
            draw.line([(left, at), (right, at)], fill=GRID)
            draw.text((left - 6, at), f"{value + 0.0:.4g}", font=font(11), fill=SOFT, anchor="rm")
        for value in _ticks(*x):
            at = float(self._at(value, y[0])[0])
            draw.line([(at, top), (at, bottom)], fill=GRID)
            draw.text((at, bottom + 4), f"{value + 0.0:g}", font=font(11), fill=SOFT, anchor="mt")
        draw.rectangle(box, outline=SOFT)

    def _at(self, x: Any, y: Any) -> tuple[Any, Any]:
        left, top, right, bottom = self._box
        across = (np.asarray(x) - self._x[0]) / (self._x[1] - self._x[0])
        up = (np.asarray(y) - self._y[0]) / (self._y[1] - self._y[0])
        return left + across * (right - left), bottom - up * (bottom - top)

    def _points(self, x: Array, y: Array) -> list[tuple[float, float]]:
        return [(float(a), float(b)) for a, b in zip(*self._at(x, y), strict=True)]

    def line(self, x: Array, y: Array, colour: Colour) -> None:
        """Draw a curve."""
        self._draw.line(self._points(x, y), fill=colour, width=2, joint="curve")

    def band(self, x: Array, low: Array, high: Array, colour: Colour) -> None:
        """Fill between two curves."""
        if len(x) > 1:
            outline = self._points(x, low) + self._points(x, high)[::-1]
            self._draw.polygon(outline, fill=colour)

    def level(self, y: float, colour: Colour, name: str) -> None:
        """Draw a dashed horizontal line with its name."""
        left, _, right, _ = self._box
        at = float(self._at(self._x[0], y)[1])
        for start in range(left, right, 8):
            self._draw.line([(start, at), (min(start + 4, right), at)], fill=colour)
        anchor = "rb" if y >= 0 else "rt"
        offset = -2 if y >= 0 else 3
        self._draw.text((right - 4, at + offset), name, font=font(11), fill=colour, anchor=anchor)

    def legend(self, entries: list[tuple[str, Colour]]) -> None:
        """Write what the colours mean, above the plot on the right."""
        _, top, right, _ = self._box
        for name, colour in reversed(entries):
            right -= int(self._draw.textlength(name, font=font(11)))
            self._draw.text((right, top - 19), name, font=font(11), fill=SOFT)
            self._draw.rectangle((right - 16, top - 16, right - 5, top - 9), fill=colour)
            right -= 26

    def marks(self, x: Array, colour: Colour) -> None:
        """Draw vertical lines."""
        _, top, _, bottom = self._box
        for value in x:
            at = float(self._at(value, self._y[0])[0])
            self._draw.line([(at, top), (at, bottom)], fill=colour)

    def time_label(self) -> None:
        """Name the horizontal axis."""
        left, _, right, bottom = self._box
        place = ((left + right) / 2, bottom + 21)
        self._draw.text(place, "time [s]", font=font(12), fill=INK, anchor="mt")
