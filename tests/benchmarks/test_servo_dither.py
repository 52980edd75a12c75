"""The study of dither on an SO-101's commands: its cases and its page."""

import numpy as np
import pytest

from benchmarks.servo import servo_dither as study

MODEL = study.STUDY.folder / study.MODEL


def test_a_case_is_measured_on_the_diagnosed_arm():
    nothing, faded = (
        study.measure(study.COMPARED[k], goals=3, model=MODEL)
        for k in ("nothing", "dither that fades")
    )
    assert np.mean(faded["friction"]) < 0.3 * np.mean(nothing["friction"])
    assert nothing["amplitude"] == [0.0] * 6
    assert nothing["sag"] == faded["sag"]
    # gravity does not turn the pan, the roll or the jaw
    assert np.array(nothing["sag"])[[0, 4, 5]] == pytest.approx(0.0, abs=1e-3)
    assert nothing["tip"] < 1e-5


def test_the_page_has_every_case(tmp_path):
    row = {k: [0.001 * j for j in range(6)] for k in ("error", "shaking", "sag", "friction")}
    rows = {k: {**row, "tip": 0.02, "amplitude": row["sag"]} for k in study.cases()}
    options = study.STUDY.parser().parse_args(["--out", str(tmp_path)])
    text = study.STUDY.write_page(options, goals=3, **study.page(rows))
    assert all(f"| {name} |" in text for name in study.COMPARED)
    assert all(
        f"| {name}: {do} |" in text for name in study.LESS_KNOWN for do in study.TRIED_ON_THEM
    )
    assert "| 5 | on | 2.5 / 20 |" in text
    assert "| 15 | fades | 2.5 |" in text


def test_cases_differ():
    found = study.cases()
    by_hand = len(study.FREQUENCIES) * len(study.SCALES) * 2
    laws = 2 * (1 + len(study.SCALES))
    assert len(found) == by_hand + len(study.COMPARED) + 2 * len(study.TRIED_ON_THEM) + laws
    # two settings of the grid are also compared, and one of those is also tried with both laws
    assert len(set(found.values())) == len(found) - 3


def test_friction_that_does_not_drift_keeps_what_the_amplitude_does_not_reach():
    cases = study.cases()
    none, half, most = (
        np.mean(study.measure(cases[f"Coulomb, {scale}"], goals=3, model=MODEL)["error"])
        for scale in ("0", "0.5", "1.5")
    )
    assert half == pytest.approx(none / 2, rel=0.25)
    assert most < 0.1 * none
