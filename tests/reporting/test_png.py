"""Pictures: the same bytes for the same figure, and few colours in the small ones."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from stiction_envs.reporting.png import COLOURS, save_full, save_small


def drawn() -> Figure:
    figure = Figure(figsize=(3, 2))
    figure.subplots().imshow(np.random.default_rng(0).normal(size=(20, 30)))
    return figure


@pytest.mark.parametrize("save", [save_full, save_small])
def test_same_figure_same_bytes(save, tmp_path):
    first, again = tmp_path / "a.png", tmp_path / "b.png"
    save(drawn(), first)
    save(drawn(), again)
    assert first.read_bytes() == again.read_bytes()


def test_colours_of_a_small_picture(tmp_path):
    """A palette of few colours; white stays white and a line keeps its colour."""
    figure = Figure(figsize=(4, 3))
    axes = figure.subplots()
    axes.plot(np.random.default_rng(0).normal(size=3000), ".", color="#c2590c", ms=2)
    axes.plot([0, 3000], [0, 0], color="#1f5fa8", lw=6)
    save_small(figure, tmp_path / "a.png")
    save_full(figure, tmp_path / "full.png")
    full = Image.open(tmp_path / "full.png").convert("RGB")
    assert len(full.getcolors(10**6)) > COLOURS
    picture = Image.open(tmp_path / "a.png")
    assert picture.mode == "P"
    colours = [c for _, c in picture.convert("RGB").getcolors()]
    assert len(colours) <= COLOURS
    for wanted in ((255, 255, 255), (0xC2, 0x59, 0x0C), (0x1F, 0x5F, 0xA8)):
        assert min(max(abs(a - b) for a, b in zip(wanted, c, strict=True)) for c in colours) < 6
