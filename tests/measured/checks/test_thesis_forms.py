"""Every misprint of the thesis's tables is found, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.measured.checks.tables import check_tables, read_rows
from stiction_envs.measured.checks.thesis_forms import (
    check_differences,
    check_fits,
    check_growth,
    check_parameters,
    check_units,
)
from stiction_envs.measured.thesis_tables import THESIS_TABLES, thesis_file
from tests.measured.checks.test_checks import SEEDS, changed, places

IN_PRINT = """\
4.1: iiwa link 1, mass: remark: 3.45 kg
4.1: iiwa link 1, viscous: implausible: -128728.04 Nms
4.1: iiwa link 2, mass: remark: 3.48 kg
4.1: iiwa link 2, viscous: implausible: 202673.10 Nms
4.1: iiwa link 3, mass: implausible: -50.15 kg
4.1: iiwa7, sum of masses: implausible: 1013.6 kg
4.9: panda joint 2, final: remark: 1.2
4.9: panda joint 3, scale: scale: 1.0
4.9: panda joint 5, no_load +, intermediate: amplitude: 0.7996
4.11: all: unit: Nm
4.11: b x: remark: +0.1037
4.11: b roll: remark: -0.8976
4.11: c pitch: remark: -1.5986
4.11: c yaw: remark: -1.1751
4.11: d z: remark: -0.0343
4.11: d roll: remark: +0.7292
4.11: a x: remark: +0.1893
4.11: b x: remark: +0.1037
4.11: c z: remark: +0.0629
4.11: c roll: remark: +0.6339
4.11: d roll: remark: +0.7292
A.1: all: implausible: 14 values
A.1: panda joint 2 +, intercept: implausible: -3.1325
A.1: panda joint 2 -, intercept: implausible: -4.1755
A.1: panda joint 3 -, intercept: implausible: 0.1632
A.1: panda joint 4 +, intercept: implausible: 3.4506
A.1: panda joint 4 -, intercept: implausible: 2.7097
A.1: panda joint 5 +, intercept: implausible: -0.0394
A.1: panda joint 6 -, intercept: implausible: 0.3907
4.7: panda joint 2, load -, 30 Hz: repeat: -0.1795 N·m, -94.27 %
4.2: panda joint 1 +, intercept: remark: 0.81
4.2: panda joint 1 +, slope: remark: -3.02
4.3: iiwa joint 2, load -: remark: -1.265
4.3: iiwa joint 2, no_load -: remark: -1.241
4.3: panda joint 2, load -: remark: -3.132
4.4: panda joint 3, load -: repeat: -1.3377
4.4: panda joint 3, no_load +: repeat: 0.777
4.3: panda joint 4, no_load +: remark: 1.262
A.1: panda joint 1 -, r2: remark: 0.000001
""".splitlines()
"""Table, place, kind and printed cell: what is wrong in print, and the remarks."""


def test_what_is_wrong_in_print_is_found_and_no_more():
    found = check_tables({name: read_rows(thesis_file(name)) for name in THESIS_TABLES})
    assert [f"{d.table}: {d.where}: {d.kind}: {d.printed}" for d in found] == IN_PRINT


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
    assert places(check_differences(bad)) == []
    with pytest.raises(StictionError, match=r"unknown axis 'w'.*x, y, z"):
        check_units(changed(rows, i, axis="w"))


def test_fits_and_parameters():
    fit = {"robot": "arm", "direction": "+", "slope_Nms_per_rad": "0.1"}
    fits = [{**fit, "joint": str(j), "intercept_Nm": "0.5", "r2": "0.8"} for j in (1, 2, 3)]
    bases = {("arm", j, "load", "+"): "0.6" for j in (1, 2, 3)}
    assert places(check_fits(fits, bases)) == []
    for cell in ({"intercept_Nm": "-0.5"}, {"intercept_Nm": "1.3"}, {"r2": "0.02"}):
        (defect,) = check_fits(changed(fits, 1, **cell), bases)
        assert (defect.kind, defect.where[:11]) == ("implausible", "arm joint 2")
    weak = [{**f, "r2": "0.02"} for f in fits]
    assert places(check_fits(weak, bases)) == ["all"]

    row = {"robot": "iiwa", "quantity": "mass", "unit": "kg"}
    mass = [{**row, "joint": str(j), "value": "3.00"} for j in range(1, 8)]
    mass.append({**row, "joint": "1", "quantity": "viscous", "unit": "Nms", "value": "20"})
    assert places(check_parameters(mass)) == []
    for i, value, where, kind in (
        (0, "-0.10", "iiwa link 1, mass", "implausible"),
        (0, "90.00", "iiwa7, sum of masses", "implausible"),
        (1, "3.48", "iiwa link 2, mass", "remark"),
        (7, "-5000", "iiwa link 1, viscous", "implausible"),
    ):
        (defect,) = check_parameters(changed(mass, i, value=value))
        assert (defect.where, defect.kind) == (where, kind)
    # of another arm no weight is known
    other = [{**r, "robot": "arm"} for r in changed(mass, 0, value="90.00")]
    assert places(check_parameters(other)) == []
