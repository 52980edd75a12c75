"""Pictures: the same bytes for the same figure, there in full or not at all."""

from __future__ import annotations

import os

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
def test_same_figure_same_bytes_and_a_failure_keeps_the_old(save, tmp_path, monkeypatch):
    first, again = tmp_path / "a.png", tmp_path / "b.png"
    save(drawn(), first)
    save(drawn(), again)
    kept = first.read_bytes()
    assert kept == again.read_bytes()

    def broken(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", broken)
    with pytest.raises(OSError, match="disk full"):
        save(Figure(), first)
    assert first.read_bytes() == kept
    assert {p.name for p in tmp_path.iterdir()} == {"a.png", "b.png"}


def test_small_is_small_and_full_is_full(tmp_path):
    save_full(drawn(), tmp_path / "full.png")
    save_small(drawn(), tmp_path / "small.png")
    full, small = (Image.open(tmp_path / f"{x}.png") for x in ("full", "small"))
    assert full.size == (390, 260)
    assert small.size == (300, 200)
    assert len(small.convert("RGB").getcolors()) <= COLOURS
    assert len(full.convert("RGB").getcolors(10**6)) > COLOURS


def test_colours_of_a_small_picture(tmp_path):
    """A palette of few colours; white stays white and a line keeps its colour."""
    figure = Figure(figsize=(4, 3))
    axes = figure.subplots()
    axes.plot(np.random.default_rng(0).normal(size=3000), ".", color="#c2590c", ms=2)
    axes.plot([0, 3000], [0, 0], color="#1f5fa8", lw=6)
    save_small(figure, tmp_path / "a.png")
    picture = Image.open(tmp_path / "a.png")
    assert picture.mode == "P"
    colours = [c for _, c in picture.convert("RGB").getcolors()]
    assert len(colours) <= COLOURS
    for wanted in ((255, 255, 255), (0xC2, 0x59, 0x0C), (0x1F, 0x5F, 0xA8)):
        assert min(max(abs(a - b) for a, b in zip(wanted, c, strict=True)) for c in colours) < 6
