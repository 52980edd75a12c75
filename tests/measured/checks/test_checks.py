"""The rules of `stiction check` on tables of which everything is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stiction_envs.measured as measured
from stiction_envs.measured import SJERow, write_sje
from stiction_envs.measured.checks.rules import (
    check_amplitudes,
    check_measurements,
    check_percentages,
    check_repeats,
    check_signs,
    check_sje,
    setting_key,
)
from stiction_envs.measured.checks.tables import check_tables, read_rows
from stiction_envs.measured.thesis_tables import thesis_file

THESIS = Path(measured.__file__).parent / "thesis"
SEEDS = range(8)
POSES = [(load, direction) for load in ("load", "no_load") for direction in "+-"]


def changed(rows, i, **cells):
    return [{**r, **cells} if k == i else dict(r) for k, r in enumerate(rows)]


def places(found):
    return [d.where for d in found]


def test_all_316_percentages_of_the_thesis_pass():
    bases = {setting_key(r): r["tau_base_Nm"] for r in read_rows(thesis_file("4.6"))}
    tables = [read_rows(thesis_file(n)) for n in ("4.5", "4.6", "4.7", "4.8", "4.10")]
    assert sum(map(len, tables)) == 316
    for rows in tables:
        assert list(check_percentages(rows, bases=bases)) == []


def dithered(rng, robot="arm", scale=1.0):
    rows = []
    for joint in range(1, 6):
        for load, direction in POSES:
            base = (1 if direction == "+" else -1) * round(rng.uniform(0.4, 3.0), 4)
            for frequency in (50, 30):
                tau = round(base * rng.uniform(0.6, 1.05), 4)
                rows.append(
                    {
                        "robot": robot,
                        "joint": str(joint),
                        "load": load,
                        "direction": direction,
                        "frequency_Hz": str(frequency),
                        "scale": str(scale),
                        "tau_base_Nm": f"{base:.4f}",
                        "tau_sje_Nm": f"{tau:.4f}",
                        "change_pct": f"{100 * (tau / base - 1):+.2f}",
                    }
                )
    return rows


def amplitudes(rng):
    rows = []
    for joint in range(1, 6):
        scale = float(rng.choice([0.8, 1.0, 1.2]))
        base = [s * round(rng.uniform(0.4, 3.0), 4) for s in (1, -1, 1, -1)]
        final = max(round(scale * abs(b), 4) for b in base)
        rows += [
            {
                "robot": "arm",
                "joint": str(joint),
                "load": load,
                "direction": direction,
                "frequency_Hz": "50",
                "scale": f"{scale}",
                "tau_base_Nm": f"{b:.4f}",
                "tau_intermediate_Nm": f"{scale * b:.4f}",
                "tau_final_Nm": f"{final:.4f}",
                "final_set_by_hand": "no",
            }
            for (load, direction), b in zip(POSES, base, strict=True)
        ]
    return rows


def sje(rng):
    rows = []
    for joint in range(1, 4):
        for load, direction in POSES:
            base = (1 if direction == "+" else -1) * rng.uniform(0.4, 3.0)
            key = dict(robot="arm", joint=joint, load=load, direction=direction, iterations=3)
            rows.append(
                SJERow(**key, frequency_hz=0, amplitude_nm=0, tau_nm=base, std_nm=0.01, reduction=0)
            )
            for f in (30.0, 50.0):
                cut = rng.uniform(0.05, 0.4)
                more = dict(frequency_hz=f, amplitude_nm=abs(base), tau_nm=base * (1 - cut))
                rows.append(SJERow(**key, **more, std_nm=0.01, reduction=cut))
    return rows


@pytest.mark.parametrize("seed", SEEDS)
def test_clean_tables_have_no_defect(seed, tmp_path):
    rng = np.random.default_rng(seed)
    tables = {"d": dithered(rng), "a": amplitudes(rng)}
    for name, rows in tables.items():
        assert check_tables({name: rows}) == []
    write_sje(tmp_path / "sje.csv", sje(rng))
    assert check_tables({"s": read_rows(tmp_path / "sje.csv")}) == []


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("column", ["change_pct", "tau_sje_Nm"])
def test_a_wrong_percentage_or_torque_is_found(seed, column):
    rng = np.random.default_rng(seed)
    rows = dithered(rng)
    i = int(rng.integers(len(rows)))
    value = f"{float(rows[i][column]) * 1.02:.4f}"
    if column == "change_pct":
        value = f"{float(rows[i][column]) + rng.choice([-0.1, 0.1]):+.2f}"
    bad = changed(rows, i, **{column: value})
    (defect,) = check_tables({"mine": bad})
    r = rows[i]
    place = f"arm joint {r['joint']}, {r['load']} {r['direction']}, {r['frequency_Hz']} Hz"
    assert (defect.table, defect.where, defect.kind) == ("mine", place, "percentage")


@pytest.mark.parametrize("seed", SEEDS)
def test_a_wrong_sign_is_found(seed):
    rng = np.random.default_rng(seed)
    rows = dithered(rng)
    i = int(rng.integers(len(rows)))
    tau = rows[i]["tau_sje_Nm"]
    bad = changed(rows, i, tau_sje_Nm=tau[1:] if tau[0] == "-" else f"-{tau}")
    (defect,) = check_tables({"mine": bad})
    assert defect.kind == "sign"
    assert list(check_signs(rows, ["tau_base_Nm", "tau_sje_Nm"])) == []


@pytest.mark.parametrize("seed", SEEDS)
def test_a_wrong_amplitude_scale_or_final_is_found(seed):
    rng = np.random.default_rng(seed)
    rows = amplitudes(rng)
    i = int(rng.integers(len(rows)))
    joint = f"arm joint {rows[i]['joint']}"
    right = rows[i]["tau_intermediate_Nm"]
    bad = changed(rows, i, tau_intermediate_Nm=f"{1.3 * float(right):.4f}")
    (defect,) = check_amplitudes(bad)
    where = f"{joint}, {rows[i]['load']} {rows[i]['direction']}, intermediate"
    assert (defect.where, defect.kind, defect.expected) == (where, "amplitude", right)

    for indices in ([i], [k for k, r in enumerate(rows) if r["joint"] == rows[i]["joint"]]):
        bad = rows
        for k in indices:
            bad = changed(bad, k, scale="0.9")
        (defect,) = check_amplitudes(bad)
        assert (defect.where, defect.kind) == (f"{joint}, scale", "scale")
        assert float(defect.expected) == float(rows[i]["scale"])

    final = f"{float(rows[i]['tau_final_Nm']) + 0.0002:.4f}"
    (defect,) = check_amplitudes(changed(rows, i, tau_final_Nm=final))
    assert (defect.where, defect.kind) == (f"{joint}, final", "final")
    (defect,) = check_amplitudes(changed(rows, i, tau_final_Nm=final, final_set_by_hand="yes"))
    assert defect.kind == "remark"


def test_repeats_by_their_printed_digits():
    """Half a unit of the shorter number: 1.265 is 1.2646 rounded, 1.264 is not."""
    assert list(check_repeats([("a", "q", "1.2646"), ("b", "q", "1.2646"), ("b", "p", "7")])) == []
    (remark,) = check_repeats([("a", "q", "1.265"), ("b", "q", "1.2646")])
    assert (remark.table, remark.printed, remark.kind) == ("a", "1.265", "remark")
    (defect,) = check_repeats([("a", "q", "1.264"), ("b", "q", "1.2646"), ("c", "q", "1.265")])
    assert (defect.table, defect.printed, defect.kind) == ("a", "1.264", "repeat")
    (defect,) = check_repeats([("a", "q", "1.2645"), ("b", "q", "1.2646")])
    assert (defect.table, defect.kind) == ("b", "repeat")
    readings = [("a", "r2", "0.0299"), ("b", "r2", "0.029948")]
    assert len(list(check_repeats(readings))) == 1
    assert list(check_repeats(readings, enough_digits=3)) == []


@pytest.mark.parametrize("seed", SEEDS)
def test_a_repetition_that_contradicts_is_found(seed):
    rng = np.random.default_rng(seed)
    first = [{**r, "table": "one"} for r in dithered(rng)]
    again = []
    for r in first:
        percent = float(r["change_pct"]) + rng.normal(scale=3.0)
        tau = float(r["tau_base_Nm"]) * (1 + percent / 100)
        again.append({**r, "table": "two", "tau_sje_Nm": f"{tau}", "change_pct": f"{percent:+.2f}"})
    assert list(check_measurements(first + again)) == []
    i = int(rng.integers(len(first)))
    bad = changed(again, i, change_pct="-95.00")
    (defect,) = check_measurements(first + bad)
    r = first[i]
    place = f"arm joint {r['joint']}, {r['load']} {r['direction']}, {r['frequency_Hz']} Hz"
    assert (defect.table, defect.where, defect.kind) == ("two", place, "repeat")
    # Four repetitions are too few to tell a spread.
    assert list(check_measurements(first[:4] + changed(again, 0, change_pct="-95.00")[:4])) == []


@pytest.mark.parametrize("seed", SEEDS)
def test_sje_tables(seed, tmp_path):
    rng = np.random.default_rng(seed)
    write_sje(tmp_path / "sje.csv", sje(rng))
    rows = read_rows(tmp_path / "sje.csv")
    i = int(rng.choice([k for k, r in enumerate(rows) if float(r["frequency_hz"]) > 0]))
    r = rows[i]
    place = f"arm joint {r['joint']}, {r['load']} {r['direction']}"
    bad = changed(rows, i, reduction=f"{float(r['reduction']) + 0.01:.4f}")
    (defect,) = check_sje(bad)
    assert (defect.kind, defect.where.startswith(place)) == ("percentage", True)
    bad = changed(rows, i, tau_nm=repr(-float(r["tau_nm"])))
    (defect,) = check_sje(bad)
    assert (defect.kind, defect.where) == ("sign", place)
    for std, step, n in (("0.01", 0.05, 0), ("0.01", 0.1, 1), ("nan", 0.01, 0), ("nan", 1.5, 1)):
        sign = 1 if r["direction"] == "+" else -1
        other = repr(float(r["tau_nm"]) + sign * step)
        twice = {**r, "tau_nm": other, "reduction": "nan", "std_nm": std}
        assert [d.kind for d in check_sje([*rows, twice])] == ["repeat"] * n
    # Without its base row a reduction cannot be judged.
    alone = [x for x in rows if float(x["frequency_hz"]) > 0]
    assert list(check_sje(alone)) == []
