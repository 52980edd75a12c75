"""Plots of the Generated Trajectory Experiment."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from stiction_envs.experiments.gte import plots as gte_plots
from stiction_envs.experiments.gte.protocol import AXES
from tests.experiments.gte.made_up import made_up


@pytest.fixture
def drawn(monkeypatch) -> list[Figure]:
    """Figures that are not saved."""
    figures: list[Figure] = []
    monkeypatch.setattr(gte_plots, "save_full", lambda figure, path: figures.append(figure))
    return figures


@pytest.mark.parametrize("orientation", [False, True])
def test_errors_against_time(drawn, orientation):
    """One panel per axis in mm or mrad, a line per run, purple dots at every accepted goal."""
    noise = 1e-3 * np.random.default_rng(0).normal(size=(2, 700, 6))
    times = {"accepted": (0.0, 1.9, 3.8), "reached": (1.9, 3.8, 5.7)}
    runs = made_up(2e-3 + noise), made_up(1e-3 + noise, dithered=True, **times)
    gte_plots.plot_errors(runs, "a.png", robot="panda", orientation=orientation)
    (figure,) = drawn
    assert len(figure.axes) == 3
    names, unit = (AXES[3:], "mrad") if orientation else (AXES[:3], "mm")
    for k, (axes, name) in enumerate(zip(figure.axes, names, strict=True)):
        assert axes.get_ylabel() == f"{name} error [{unit}]"
        lines = {line.get_label(): line for line in axes.lines}
        for run, label in zip(runs, ("no dither", "dither"), strict=True):
            mean = run.error[:, :, k + 3 * orientation].mean(axis=0)
            np.testing.assert_allclose(lines[label].get_ydata(), 1e3 * mean)
            assert lines[label].get_color() == gte_plots.colour(run)
        purple = [x for x in axes.lines if x.get_color() == gte_plots.ACCEPTED]
        assert sorted(x.get_xdata()[0] for x in purple) == [0.0, 1.9, 2.0, 3.8, 4.0]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert "Panda, triangle, stiffness 200/20/0" in figure.get_suptitle()


def test_reference_is_cut_where_it_goes_to_the_measured_pose():
    reference, goals = gte_plots.published(made_up())
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(reference[:, 0])), [200, 401])
    assert len(reference) == 702
    assert goals.shape == (3, 3)


@pytest.mark.parametrize(
    "plot", [gte_plots.plot_path_xy, gte_plots.plot_path_3d, gte_plots.plot_errors]
)
def test_one_iteration_is_drawn(tmp_path, plot):
    plot([made_up(iterations=1)], tmp_path / "a.png", robot="own")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
