"""The one writer of pictures: in full colour, or small enough to be carried inside a page.

Both write the same bytes for the same figure.
"""

from __future__ import annotations

import io
import os

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.reporting.atomic import write_bytes_atomic

DPI = 130
SMALL_DPI = 100
"""As wide on the page as on the screen: 11 inches are the page's 1100 pixels."""
COLOURS = 48
"""Enough for three colours of line, their shades and their edges (looked at)."""


def save_full(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a PNG in full colour that is there in full or not at all."""
    write_bytes_atomic(path, _png(figure, DPI))


def save_small(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a PNG of few colours, chosen from the figure's, that is there in full or not at all."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    out = io.BytesIO()
    figure.dpi = SMALL_DPI
    canvas = FigureCanvasAgg(figure)
    # once: `savefig` draws twice where the layout is worked out, and packs what is packed again
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    # Dither would scatter the flat areas that make a picture small.
    picture = picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    picture.save(out, format="png", optimize=True)
    write_bytes_atomic(path, out.getvalue())


def _png(figure: Figure, dpi: float) -> bytes:
    out = io.BytesIO()
    # matplotlib's version is of no interest, and would make the file another with each release
    figure.savefig(out, format="png", dpi=dpi, metadata={"Software": None})
    return out.getvalue()
