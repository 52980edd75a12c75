from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import stiction_envs.measured as measured
from stiction_envs.errors import StictionError
from stiction_envs.measured import (
    SJERow,
    check_amplitudes,
    check_differences,
    check_files,
    check_fits,
    check_growth,
    check_measurements,
    check_parameters,
    check_percentages,
    check_repeats,
    check_signs,
    check_sje,
    check_tables,
    check_thesis,
    check_units,
    write_sje,
)
from stiction_envs.measured.checks.rules import setting_key

THESIS = Path(measured.__file__).parent / "thesis"
SHARED = Path(__file__).parents[4] / "shared" / "thesis" / "README.md"
SEEDS = range(8)
POSES = [(load, direction) for load in ("load", "no_load") for direction in "+-"]

# By line of "What is wrong in print" in the project's list: its table and place, and what the
# checker says to it as (table, where, printed); * for what stands in no single cell.
IN_PRINT = {
    ("4.9", "joint 5, no_load +"): [("4.9", "panda joint 5, no_load +, intermediate", "0.7996")],
    ("4.9", "joint 3, scale"): [("4.9", "panda joint 3, scale", "1.0")],
    ("4.9", "joint 2, final"): [("4.9", "panda joint 2, final", "1.2")],
    ("4.7", "joint 2, load −, 30 Hz"): [
        ("4.7", "panda joint 2, load -, 30 Hz", "-0.1795 N·m, -94.27 %")
    ],
    ("4.4", "joint 3, load − / no_load +"): [
        ("4.4", "panda joint 3, load -", "-1.3377"),
        ("4.4", "panda joint 3, no_load +", "0.777"),
    ],
    ("4.3 ↔ 4.5/4.6", "iiwa J2 −, Panda J2 load −, J4 no_load +"): [
        ("4.3", "iiwa joint 2, load -", "-1.265"),
        ("4.3", "iiwa joint 2, no_load -", "-1.241"),
        ("4.3", "panda joint 2, load -", "-3.132"),
        ("4.3", "panda joint 4, no_load +", "1.262"),
    ],
    ("4.11", "all"): [("4.11", "all", "Nm")],
    ("4.11", "b x, b roll, c pitch, c yaw, d z, d roll"): [
        ("4.11", "b x", "+0.1037"),
        ("4.11", "b roll", "-0.8976"),
        ("4.11", "c pitch", "-1.5986"),
        ("4.11", "c yaw", "-1.1751"),
        ("4.11", "d z", "-0.0343"),
        ("4.11", "d roll", "+0.7292"),
    ],
    ("4.11", "a x, b x, c z, c roll, d roll"): [
        ("4.11", "a x", "+0.1893"),
        ("4.11", "b x", "+0.1037"),
        ("4.11", "c z", "+0.0629"),
        ("4.11", "c roll", "+0.6339"),
        ("4.11", "d roll", "+0.7292"),
    ],
    ("4.2 ↔ A.1", "joint 1"): [
        ("4.2", "panda joint 1 +, intercept", "0.81"),
        ("4.2", "panda joint 1 +, slope", "-3.02"),
        ("A.1", "panda joint 1 -, r2", "0.000001"),
    ],
    ("4.1", "all"): [
        ("4.1", "iiwa link 3, mass", "-50.15 kg"),
        ("4.1", "iiwa7, sum of masses", "1013.6 kg"),
        ("4.1", "iiwa link 1, viscous", "-128728.04 Nms"),
        ("4.1", "iiwa link 2, viscous", "202673.10 Nms"),
        ("4.1", "iiwa link 1, mass", "3.45 kg"),
        ("4.1", "iiwa link 2, mass", "3.48 kg"),
    ],
    ("A.1", "intercepts"): [
        ("A.1", "all", "*"),
        ("A.1", "panda joint 2 +, intercept", "-3.1325"),
        ("A.1", "panda joint 2 -, intercept", "-4.1755"),
        ("A.1", "panda joint 3 -, intercept", "0.1632"),
        ("A.1", "panda joint 4 +, intercept", "3.4506"),
        ("A.1", "panda joint 4 -, intercept", "2.7097"),
        ("A.1", "panda joint 5 +, intercept", "-0.0394"),
        ("A.1", "panda joint 6 -, intercept", "0.3907"),
    ],
}
REMARKS = {
    ("4.9", "joint 2, final"),
    ("4.3 ↔ 4.5/4.6", "iiwa J2 −, Panda J2 load −, J4 no_load +"),
    ("4.11", "b x, b roll, c pitch, c yaw, d z, d roll"),
    ("4.11", "a x, b x, c z, c roll, d roll"),
    ("4.2 ↔ A.1", "joint 1"),
}


def rows_of(number):
    with open(THESIS / f"table_{number.replace('.', '_')}.csv", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def changed(rows, i, **cells):
    return [{**r, **cells} if k == i else dict(r) for k, r in enumerate(rows)]


def places(found):
    return [d.where for d in found]


def test_thesis_list_is_the_projects_list_and_no_more():
    found = [
        (d.table, d.where, "*" if (d.table, d.where) == ("A.1", "all") else d.printed)
        for d in check_thesis()
    ]
    assert Counter(found) == Counter(x for lines in IN_PRINT.values() for x in lines)


@pytest.mark.parametrize("line", IN_PRINT, ids=" ".join)
def test_each_line_of_the_projects_list_is_found(line):
    found = {(d.table, d.where): d.kind for d in check_thesis() if d.kind != "unit"}
    if line == ("4.11", "all"):
        assert [d.where for d in check_thesis() if d.kind == "unit"] == ["all"]
        return
    for table, where, _ in IN_PRINT[line]:
        started = where in ("iiwa link 1, mass", "iiwa link 2, mass")
        assert (found[table, where] == "remark") is (line in REMARKS or started)


def test_expected_lines_are_those_of_the_readme():
    if not SHARED.is_file():
        pytest.skip("no /shared/thesis beside the repository")
    text = SHARED.read_text(encoding="utf-8").split("## What is wrong in print")[1]
    lines = [x.split("|") for x in text.split("## ")[0].splitlines() if x.startswith("|")]
    assert {(x[1].strip(), x[2].strip()) for x in lines[2:]} == set(IN_PRINT)


def test_all_316_percentages_of_the_thesis_pass():
    bases = {setting_key(r): r["tau_base_Nm"] for r in rows_of("4.6")}
    tables = [rows_of(n) for n in ("4.5", "4.6", "4.7", "4.8", "4.10")]
    assert sum(map(len, tables)) == 316
    for rows in tables:
        assert check_percentages(rows, bases=bases) == []


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


def errors(rng):
    rows = []
    for axis in ("x", "y", "z", "roll", "pitch", "yaw"):
        without = round(rng.uniform(1, 5), 4)
        dither = round(without * rng.uniform(0.5, 0.95), 4)
        unit = "m·samples" if axis in "xyz" else "rad·samples"
        cells = ("robot", "subtable", "axis", "mean_error_dither", "mean_error_no_dither")
        values = ("arm", "a", axis, f"{dither:.4f}", f"{without:.4f}")
        row = dict(zip(cells, values, strict=True))
        rows.append({**row, "diff": f"{dither - without:+.4f}", "unit_printed": unit})
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
    tables = {"d": dithered(rng), "a": amplitudes(rng), "e": errors(rng)}
    for name, rows in tables.items():
        assert check_tables({name: rows}) == []
    write_sje(tmp_path / "sje.csv", sje(rng))
    assert check_files([tmp_path / "sje.csv"]) == []


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
    assert check_signs(rows, ["tau_base_Nm", "tau_sje_Nm"]) == []


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


@pytest.mark.parametrize("seed", SEEDS)
def test_a_wrong_difference_unit_or_growth_is_found(seed):
    rng = np.random.default_rng(seed)
    rows = errors(rng)
    i = int(rng.integers(len(rows)))
    axis = f"a {rows[i]['axis']}"
    for step, kind in ((0.0001, "remark"), (0.0002, "difference")):
        (defect,) = check_tables(
            {"mine": changed(rows, i, diff=f"{float(rows[i]['diff']) + step:+.4f}")}
        )
        assert (defect.where, defect.kind) == (axis, kind)
    for unit in ("Nm", "N·m", "m" if i > 2 else "rad"):
        (defect,) = check_tables({"mine": changed(rows, i, unit_printed=unit)})
        assert (defect.where, defect.kind, defect.printed) == (axis, "unit", unit)
    cells = {
        "mean_error_dither": rows[i]["mean_error_no_dither"],
        "mean_error_no_dither": rows[i]["mean_error_dither"],
        "diff": "+" + rows[i]["diff"][1:],
    }
    bad = changed(rows, i, **cells)
    assert places(check_growth(bad)) == [axis]
    assert check_differences(bad) == []
    with pytest.raises(StictionError, match=r"unknown axis 'w'.*x, y, z"):
        check_units(changed(rows, i, axis="w"))


def test_repeats_by_their_printed_digits():
    """Half a unit of the shorter number: 1.265 is 1.2646 rounded, 1.264 is not."""
    assert check_repeats([("a", "q", "1.2646"), ("b", "q", "1.2646"), ("b", "p", "7")]) == []
    (remark,) = check_repeats([("a", "q", "1.265"), ("b", "q", "1.2646")])
    assert (remark.table, remark.printed, remark.kind) == ("a", "1.265", "remark")
    (defect,) = check_repeats([("a", "q", "1.264"), ("b", "q", "1.2646"), ("c", "q", "1.265")])
    assert (defect.table, defect.printed, defect.kind) == ("a", "1.264", "repeat")
    (defect,) = check_repeats([("a", "q", "1.2645"), ("b", "q", "1.2646")])
    assert (defect.table, defect.kind) == ("b", "repeat")
    readings = [("a", "r2", "0.0299"), ("b", "r2", "0.029948")]
    assert len(check_repeats(readings)) == 1
    assert check_repeats(readings, enough_digits=3) == []


@pytest.mark.parametrize("seed", SEEDS)
def test_a_repetition_that_contradicts_is_found(seed):
    rng = np.random.default_rng(seed)
    first = [{**r, "table": "one"} for r in dithered(rng)]
    again = []
    for r in first:
        percent = float(r["change_pct"]) + rng.normal(scale=3.0)
        tau = float(r["tau_base_Nm"]) * (1 + percent / 100)
        again.append({**r, "table": "two", "tau_sje_Nm": f"{tau}", "change_pct": f"{percent:+.2f}"})
    assert check_measurements(first + again) == []
    i = int(rng.integers(len(first)))
    bad = changed(again, i, change_pct="-95.00")
    (defect,) = check_measurements(first + bad)
    r = first[i]
    place = f"arm joint {r['joint']}, {r['load']} {r['direction']}, {r['frequency_Hz']} Hz"
    assert (defect.table, defect.where, defect.kind) == ("two", place, "repeat")
    # Four repetitions are too few to tell a spread.
    assert check_measurements(first[:4] + changed(again, 0, change_pct="-95.00")[:4]) == []


@pytest.mark.parametrize("seed", SEEDS)
def test_sje_tables(seed, tmp_path):
    rng = np.random.default_rng(seed)
    write_sje(tmp_path / "sje.csv", sje(rng))
    with open(tmp_path / "sje.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    i = int(rng.choice([k for k, r in enumerate(rows) if float(r["frequency_hz"]) > 0]))
    r = rows[i]
    place = f"arm joint {r['joint']}, {r['load']} {r['direction']}"
    bad = changed(rows, i, reduction=f"{float(r['reduction']) + 0.01:.4f}")
    (defect,) = check_sje(bad, "mine")
    assert (defect.kind, defect.where.startswith(place)) == ("percentage", True)
    bad = changed(rows, i, tau_nm=repr(-float(r["tau_nm"])))
    (defect,) = check_sje(bad, "mine")
    assert (defect.kind, defect.where) == ("sign", place)
    for std, step, n in (("0.01", 0.05, 0), ("0.01", 0.1, 1), ("nan", 0.01, 0), ("nan", 1.5, 1)):
        sign = 1 if r["direction"] == "+" else -1
        other = repr(float(r["tau_nm"]) + sign * step)
        twice = {**r, "tau_nm": other, "reduction": "nan", "std_nm": std}
        assert [d.kind for d in check_sje([*rows, twice])] == ["repeat"] * n
    # Without its base row a reduction cannot be judged.
    alone = [x for x in rows if float(x["frequency_hz"]) > 0]
    assert check_sje(alone) == []


def test_fits_and_parameters():
    fit = {"robot": "arm", "direction": "+", "slope_Nms_per_rad": "0.1"}
    fits = [{**fit, "joint": str(j), "intercept_Nm": "0.5", "r2": "0.8"} for j in (1, 2, 3)]
    bases = {("arm", j, "+"): 0.6 for j in (1, 2, 3)}
    assert check_fits(fits, bases=bases) == []
    for cell in ({"intercept_Nm": "-0.5"}, {"intercept_Nm": "1.3"}, {"r2": "0.02"}):
        (defect,) = check_fits(changed(fits, 1, **cell), bases=bases)
        assert (defect.kind, defect.where[:11]) == ("implausible", "arm joint 2")
    weak = [{**f, "r2": "0.02"} for f in fits]
    assert places(check_fits(weak, bases=bases)) == ["all"]

    row = {"robot": "arm", "quantity": "mass", "unit": "kg"}
    mass = [{**row, "joint": str(j), "value": "3.00"} for j in range(1, 8)]
    mass.append({**row, "joint": "1", "quantity": "viscous", "unit": "Nms", "value": "20"})
    limits = {"total_kg": {"arm": 25.0}, "start_kg": {"arm": {2: 4.0}}}
    assert check_parameters(mass, **limits) == []
    for i, value, where, kind in (
        (0, "-0.10", "arm link 1, mass", "implausible"),
        (0, "90.00", "arm, sum of masses", "implausible"),
        (1, "4.00", "arm link 2, mass", "remark"),
        (7, "-5000", "arm link 1, viscous", "implausible"),
    ):
        (defect,) = check_parameters(changed(mass, i, value=value), **limits)
        assert (defect.where, defect.kind) == (where, kind)
