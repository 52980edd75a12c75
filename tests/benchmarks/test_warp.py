"""The comparison of MuJoCo Warp with MuJoCo: how its numbers are made (extra warp)."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("mujoco_warp")
from benchmarks.engines import warp as study


def ramp(tau: float, end: float) -> dict[str, object]:
    return {"tau": tau, "angle": np.linspace(0.0, end, 11).tolist()}


def test_torques_are_compared_relatively_and_angles_before_the_end():
    row = {
        "1 load +": {"mujoco": ramp(2.0, 0.1), "warp": ramp(2.02, 0.1)},
        "1 load -": {"mujoco": ramp(-4.0, 0.1), "warp": ramp(-4.0, 0.2)},
        "seconds": 1.0,
    }
    line = study.torque_line(row)
    assert line["count"] == 2
    assert (line["least"], line["most"]) == (2.0, 4.0)
    assert line["apart"] == pytest.approx(0.01)
    assert line["angle"] == pytest.approx(0.08)


def test_small_numbers_read_as_powers():
    assert [study._power(x) for x in (0.0, 3.2e-6, 1e-12)] == ["0", "3·10⁻⁶", "1·10⁻¹²"]


def test_sums_in_float32_are_put_back():
    ours = study.warp_batch.sum_angles
    with study.sums_in_float32(True):
        assert study.warp_batch.sum_angles is not ours
    assert study.warp_batch.sum_angles is ours


def test_what_a_card_measured_is_kept_and_read():
    kept = json.loads((study.STUDY.folder / study.CARD).read_text("utf-8"))
    values = study.card_values(kept)
    assert values["configurations"] == 4 * 28
    assert values["same"]
    assert values["end"]
    first = values["rates"].splitlines()[2]
    rate = kept["rows"]["throughput gte mujoco 1024"]["rate"]
    assert first.startswith(f"| 1024 | {rate / 1e6:.3f} |")


def test_a_card_that_repeats_no_bits_is_told():
    kept = json.loads((study.STUDY.folder / study.CARD).read_text("utf-8"))
    kept["rows"]["twice gte panda"]["same"] = False
    assert not study.card_values(kept)["same"]


def test_a_training_on_a_card_is_a_table():
    kept = json.loads((study.STUDY.folder / study.CARD).read_text("utf-8"))
    row = {"seconds": 61.7, "returns": {"none": -0.01, "trained": 0.25}, "steps_per_second": 1e4}
    kept["rows"]["training sje warp"] = row
    assert study.card_values(kept)["training"].splitlines()[2] == "| warp | 62 | −0.0100 | 0.250 |"
