"""The search's page holds what its rows say of every treatment."""

from __future__ import annotations

from pathlib import Path

from benchmarks.learning.search import STUDY
from benchmarks.learning.search_page import LOOKS, draw, page


def test_the_page_holds_every_treatment(tmp_path: Path):
    parts = [f"{x}{part}" for x in ("", "resting_") for part in ("position", "orientation")]
    names = (*LOOKS, "the same without its gate")

    def row(k: int, factor: float) -> dict[str, float]:
        left = dict.fromkeys(parts, factor * (k + 1) / 100)
        return {**left, "vibration_m": 1e-4 * k, "vibration_at_rest_m": 1e-5 * k}

    # geometric means over two paths
    results = {
        path: {name: row(k, factor) for k, name in enumerate(names)}
        for path, factor in (("triangle", 0.5), ("pentagon", 2.0))
    }
    panda = {condition: results for condition in ("known", "too small", "too large", "elsewhere")}
    joint = [{"left": 0.9, "displacement_rad": 1e-3}] * 7
    tables = {"make tune": joint, "search": joint}
    values = page(
        paths={"panda": panda, "iiwa7": {"known": results}},
        joints={"panda": tables, "iiwa7": tables},
        hunting={"0.05 mrad": [1e-4]},
        gains=[1.0],
    )
    options = STUDY.parser().parse_args(["--out", str(tmp_path)])
    more = {"seed": 1, "iterations": 1, "evaluations": 1600, "gates_rad_s": [0.1, 0.2]}
    text = STUDY.write_page(options, **values, **more)
    for k, name in enumerate(names):
        assert f"| {name} | {k + 1} / {k + 1} | {k + 1} / {k + 1} | {0.01 * k:.3f} |" in text
    assert "leaves 11 / 11 %" in text
    assert "10.0 %, 1.000 mrad" in text
    draw(panda, tmp_path / "compensation.png")
    assert (tmp_path / "compensation.png").exists()
