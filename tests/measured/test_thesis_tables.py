import pytest

from stiction_envs.measured.thesis_tables import (
    THESIS_TABLES,
    thesis_base,
    thesis_dithered,
    thesis_table,
)
from tests.refusal import refusal


@pytest.mark.parametrize(
    ("number", "rows"),
    list(zip(THESIS_TABLES, (91, 12, 56, 28, 8, 112, 84, 56, 28, 56, 24, 14), strict=True)),
)
def test_thesis_tables_are_typed(number, rows):
    table = thesis_table(number)
    assert len(table) == rows
    for row in table:
        assert isinstance(row.get("joint", 1), int)
        for name, value in row.items():
            if name in ("robot", "load", "direction", "quantity", "unit", "printed", "axis"):
                assert isinstance(value, str)
            elif name.endswith(("_Nm", "_Hz", "_pct")) or name in ("scale", "value", "diff"):
                assert isinstance(value, float)


def test_thesis_percentages_agree_with_their_torques():
    for row in thesis_dithered("panda") + thesis_dithered("iiwa"):
        percent = 100 * (abs(row.tau_sje_nm) / abs(row.tau_base_nm) - 1)
        assert percent == pytest.approx(row.change_pct, abs=0.032)


def test_thesis_dithered():
    rows = thesis_dithered("panda")
    counts = {t: sum(r.table == t for r in rows) for t in ("4.6", "4.7", "4.8", "4.10")}
    assert counts == {"4.6": 112, "4.7": 84, "4.8": 56, "4.10": 56}
    assert sum(r.change_pct > 0 for r in rows if r.table != "4.10") == 20
    (bad,) = (r for r in rows if r.outlier)
    assert (bad.joint, bad.load, bad.direction, bad.frequency_hz) == (2, "load", "-", 30.0)
    assert [r.table for r in thesis_dithered("iiwa7")] == ["4.5"] * 8
    for row in rows:
        assert row.amplitude_nm == pytest.approx(row.scale * abs(row.tau_base_nm), rel=1e-12)


def test_unknown_thesis_names():
    refusal(lambda: thesis_table("4.12"), r"thesis table '4.12'.*4\.1, .*A\.1")
    for read in (thesis_base, thesis_dithered):
        refusal(lambda read=read: read("iiwa14"), "'iiwa14': expected one of panda, iiwa7")
