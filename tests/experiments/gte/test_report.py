"""A Generated Trajectory Experiment's report, of made errors."""

import pytest

from stiction_envs.experiments.gte.protocol import AXES
from stiction_envs.experiments.gte.results import WORDS, write_report
from stiction_envs.experiments.gte.rows import CASES, ErrorRow, RunRow
from stiction_envs.reporting.png import save_full

SAME = {
    "robot": "panda",
    "trajectory": "triangle",
    "stiffness_translation": 200.0,
    "stiffness_rotation": 20.0,
    "stiffness_nullspace": 0.0,
}


def errors(case, left):
    return [
        ErrorRow(
            **SAME,
            case=case,
            axis=axis,
            unit="m" if k < 3 else "rad",
            window_sum=2.0 * left[k],
            window_sum_std=0.0,
            window_sum_of_mean=0.0,
            mean=1e-3,
            rms=1e-3,
            max=1e-3,
            corner=1e-3,
            settling=left[k],
            iterations=3,
        )
        for k, axis in enumerate(AXES)
    ]


def run(case, **changes):
    flags = dict.fromkeys(("singular", "saturated", "near_limit", "goals_missed", "unfinished"), 0)
    numbers = dict.fromkeys((f"vibration_{a}_m" for a in ("x", "y", "z", "turning")), 0.0)
    return RunRow(
        **SAME,
        **numbers,
        case=case,
        duration_s=6.0,
        vibration_m=2e-4,
        vibration_at_rest_m=1e-4,
        dither_energy_j=1.0,
        peak_torque_rate_nm_s=300.0,
        iterations=3,
        **{**flags, **changes},
    )


@pytest.fixture
def report(tmp_path):
    from matplotlib.figure import Figure

    for name in ("path_xy", "path_3d", "error_position", "error_orientation"):
        save_full(Figure(figsize=(1, 1)), tmp_path / f"{name}.png")

    def write(rows, runs):
        write_report(tmp_path, rows, runs, printed=False)
        return (tmp_path / "report.md").read_text("utf-8"), (tmp_path / "report.html").read_text()

    return write


def test_shares_are_of_what_is_left_without_dither(report):
    plain, shaken = [3e-3, 4e-3, 0.0, 0.01, 0.0, 0.0], [3e-3, 0.0, 0.0, 0.002, 0.0, 0.0]
    rows = [*errors("no_dither", plain), *errors("dither", shaken)]
    text, page = report(rows, [run("no_dither"), run("dither")])
    verdict = text.splitlines()[2]
    assert verdict.startswith("**Dither** leaves 60 % of the position and 20 % of the orientation")
    assert "0.200 mm of vibration (0.100 mm at rest)" in verdict
    assert "| y [mm] | 4.00 | 0 (−100 %) |" in text
    assert "| roll [rad] | 0.0200 | 0.00400 (−80 %) |" in text
    assert page.index("leaves 60 %") < page.index("<img ") < page.index("<table")
    assert "http" not in page


def test_a_run_that_did_not_arrive_is_told(report):
    left = [1e-3] * 6
    text, _ = report(errors("no_dither", left), [run("no_dither", unfinished=2)])
    assert "**1.73 mm and 1.73 mrad are left at the last goal**" in text
    assert "> No dither: 2 iterations never reached the last goal of 3." in text


def test_every_case_has_words():
    assert set(WORDS) == set(CASES)
