"""Every misprint of the thesis's tables is found, and nothing else."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.measured import (
    check_differences,
    check_fits,
    check_growth,
    check_parameters,
    check_tables,
    check_thesis,
    check_units,
)
from tests.measured.checks.test_checks import SEEDS, changed, places

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


@pytest.mark.parametrize("seed", SEEDS)
def test_a_wrong_difference_unit_or_growth_is_found(seed):
    rng = np.random.default_rng(seed)
    rows = errors(rng)
    i = int(rng.integers(len(rows)))
    axis = f"a {rows[i]['axis']}"
    assert check_tables({"e": rows}) == []
    for step, kind in ((0.0001, "remark"), (0.0002, "difference")):
        diff = f"{float(rows[i]['diff']) + step:+.4f}"
        (defect,) = check_tables({"e": changed(rows, i, diff=diff)})
        assert (defect.where, defect.kind) == (axis, kind)
    for unit in ("Nm", "N·m", "m" if i > 2 else "rad"):
        (defect,) = check_tables({"e": changed(rows, i, unit_printed=unit)})
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


def test_fits_and_parameters():
    fit = {"robot": "arm", "direction": "+", "slope_Nms_per_rad": "0.1"}
    fits = [{**fit, "joint": str(j), "intercept_Nm": "0.5", "r2": "0.8"} for j in (1, 2, 3)]
    bases = {("arm", j, "load", "+"): "0.6" for j in (1, 2, 3)}
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
