"""Pictures small enough to be carried inside a page: few colours, and those chosen from them."""

from __future__ import annotations

import io
import os
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

DPI = 100
"""As wide on the page as on the screen: 11 inches are the page's 1100 pixels."""
COLOURS = 48
"""Enough for three colours of line, their shades and their edges (looked at)."""


def save(figure: Figure, path: Path) -> None:
    """Write a PNG that is there in full or not at all, and the same for the same figure."""
    full, small = io.BytesIO(), io.BytesIO()
    figure.savefig(full, format="png", dpi=DPI)
    # Dither would scatter the flat areas that make a picture small.
    picture = Image.open(full).convert("RGB")
    picture = picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    picture.save(small, format="png", optimize=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.write_bytes(small.getvalue())
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
