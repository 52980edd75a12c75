"""Fonts, colours and small plots of the panels next to the scenes."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from stiction_envs.arrays import Array

Colour = tuple[int, int, int]
INK, SOFT, GRID, PAPER = (35, 38, 44), (110, 115, 124), (226, 228, 232), (255, 255, 255)
BLUE, BAND, ORANGE, PURPLE = (20, 90, 180), (178, 205, 240), (225, 95, 0), (150, 70, 180)


@functools.lru_cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return a font of a size [pixel]."""
    from matplotlib import get_data_path

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(get_data_path()) / "fonts" / "ttf" / name), size)


def draw_panel(
    width: int, height: int, lines: list[str], plot: Callable[[ImageDraw.ImageDraw], None]
) -> NDArray[np.uint8]:
    """Return a panel (height, width, 3): a title, some lines, the last as a state, and plots."""
    image = Image.new("RGB", (width, height), PAPER)
    draw = ImageDraw.Draw(image)
    title, *rest, state = lines
    draw.text((14, 8), title, font=font(17, bold=True), fill=INK)
    for k, line in enumerate(rest):
        draw.text((14, 31 + 19 * k), line, font=font(13), fill=INK)
    draw.text((14, 31 + 19 * len(rest)), state, font=font(13, bold=True), fill=ORANGE)
    plot(draw)
    return np.array(image, dtype=np.uint8)


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

    def _at(self, x: Array | float, y: Array | float) -> tuple[Array, Array]:
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
        """Write the meaning of colours above the plot on the right."""
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
