"""The only writer of pictures: in full colour, or small enough for inclusion in a page.

Both write the same bytes for the same figure.
"""

import io
import os

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.reporting.atomic import write_bytes_atomic

DPI = 130  # dots per inch of full pictures (assumed)
SMALL_DPI = 100
"""Dots per inch of small pictures: 11 inches are the 1100 pixels of `html`'s page."""
COLOURS = 48
"""Colours of small pictures: three of lines, their shades and edges (assumed; looks right)."""

LEVEL = 6
"""Level of zlib for small pictures: 9 takes six times as long for a tenth fewer bytes
(measured)."""


def save_full(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a PNG in full colour that is there in full or not at all."""
    out = io.BytesIO()
    # without matplotlib's version, which would change the file with each release
    figure.savefig(out, format="png", dpi=DPI, metadata={"Software": None})
    write_bytes_atomic(path, out.getvalue())


def save_small(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a PNG of few colours, chosen from the figure's, that is there in full or not at all."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    out = io.BytesIO()
    figure.dpi = SMALL_DPI
    canvas = FigureCanvasAgg(figure)
    # `savefig` would draw twice where a layout is computed, and compress once more
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    # dither would break up the flat areas that make a picture small
    picture = picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    picture.save(out, format="png", compress_level=LEVEL)
    write_bytes_atomic(path, out.getvalue())
