"""Least squares of the thesis, and the small Markdown of the report."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from stiction_envs.gap.causes import CAUSES
from stiction_envs.gap.least_squares import least_squares, line
from stiction_envs.gap.report import UNITS
from stiction_envs.gap.report_figures import VIEWS
from stiction_envs.reporting.html import to_html
from stiction_envs.reporting.png import COLOURS, save
from tests.gap.signals.test_poses import poses
from tests.gap.small_logs import data_of, hidden, panda


def test_line_is_that_of_polyfit():
    """Equation 3.1 is ordinary least squares."""
    rng = np.random.default_rng(0)
    v = rng.uniform(0.1, 1.0, 200)
    tau = 0.5 + 0.2 * v + 0.05 * rng.normal(size=200)
    m, b, r2 = line(v, tau)
    np.testing.assert_allclose([m, b], np.polyfit(v, tau, 1))
    assert r2 == pytest.approx(np.corrcoef(v, tau)[0, 1] ** 2)


def test_line_without_a_spread_of_speeds_is_none():
    assert np.isnan(line(np.full(10, 0.3), np.arange(10.0))).all()
    assert np.isnan(line(np.zeros(0), np.zeros(0))).all()


def test_least_squares_is_right_on_clean_signals_and_says_where_not():
    """Without noise the bands come out; with noisy angles raw accelerations bury them."""
    arm = panda()
    clean = hidden(arm, lambda q, dq, ddq: 0.5 * np.sign(dq) + 0.3 * dq, noise=0.0)
    t = clean.t

    def fitted(noise: float):
        rng = np.random.default_rng(3)
        q = clean.q + noise * rng.normal(size=clean.q.shape)
        log = type(clean)(source="x.csv", t=t.copy(), q=q, dq=None, tau=clean.tau.copy())
        return least_squares([log], data_of(arm, log))

    good, bad = fitted(0.0), fitted(3e-4)
    for x in good.lines[10:]:  # joints 6 and 7 move little mass: q's own noise hardly counts
        sign = 1 if x.direction == "+" else -1
        assert x.intercept == pytest.approx(0.5 * sign, abs=0.15)
    assert min(x.r2 for x in bad.lines) < 0.1
    assert any("R²" in why for why in bad.breaks[2])
    assert any("raw differentiation" in why for why in bad.breaks[2])


def test_least_squares_of_poses_has_no_lines():
    """Poses have no speeds: no line, and it says why."""
    log = poses(count=30)
    found = least_squares([log], data_of(panda(), log))
    assert all(np.isnan(x.slope) and x.rows == 0 for x in found.lines)
    assert found.breaks[1] == ("it does not move in both directions",)


def test_pictures_are_small_and_the_same_twice(tmp_path):
    """A palette of few colours; white stays white and a line keeps its colour."""
    for name in ("a.png", "b.png"):
        figure = Figure(figsize=(4, 3))
        axes = figure.subplots()
        axes.plot(np.random.default_rng(0).normal(size=3000), ".", color="#c2590c", ms=2)
        axes.plot([0, 3000], [0, 0], color="#1f5fa8", lw=6)
        save(figure, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "b.png"]
    picture = Image.open(tmp_path / "a.png")
    assert picture.mode == "P"
    colours = [c for _, c in picture.convert("RGB").getcolors()]
    assert len(colours) <= COLOURS
    for wanted in ((255, 255, 255), (0xC2, 0x59, 0x0C), (0x1F, 0x5F, 0xA8)):
        assert min(max(abs(a - b) for a, b in zip(wanted, c, strict=True)) for c in colours) < 6


def test_every_cause_has_a_view_and_every_parameter_a_unit():
    assert set(VIEWS) == {c.name for c in CAUSES}
    without = {"load_coefficient", "scale", "inertia"}
    names = {p.name for c in CAUSES for p in c.parameters}
    assert names - without <= set(UNITS)


def test_html_escapes_and_holds_its_pictures(tmp_path):
    (tmp_path / "a.png").write_bytes(b"png")
    lines = ["# A < B", "", "text **bold** `x<y`", "more", "", "- one", "- two", ""]
    lines += ["| a | b |", "|---|---|", "| 1 | 2 |", "", "![pic](a.png)", "", "!odd"]
    page = to_html(lines, tmp_path, "T & T")
    for part in (
        "<title>T &amp; T</title>",
        "<h1>A &lt; B</h1>",
        "<strong>bold</strong> <code>x&lt;y</code> more",
        "<li>one</li>\n<li>two</li>",
        "<td>1</td><td>2</td>",
        'src="data:image/png;base64,cG5n"',
    ):
        assert part in page
