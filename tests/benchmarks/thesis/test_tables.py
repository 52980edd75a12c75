"""Tables and figures of made-up measurements."""

import dataclasses
import math

import numpy as np
import pytest

from benchmarks.thesis import lsm
from benchmarks.thesis.catalogue import chosen
from benchmarks.thesis.items import Found
from benchmarks.thesis.lsm import Line
from benchmarks.thesis.paths import (
    compare_errors,
    compare_paths,
)
from benchmarks.thesis.ramps import Ramps
from benchmarks.thesis.rosdyn import Unconstrained
from benchmarks.thesis.studies import Options, run_studies
from benchmarks.thesis.torques import (
    compare,
    job_of,
    rows_of_table,
    torque_needs,
)
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Measurement
from stiction_envs.measured.thesis_tables import thesis_base, thesis_dithered, thesis_table
from tests.benchmarks.thesis.made_up import measurement, run_paths
from tests.command_line import csv_rows


def torques(number: str, effect: float = 1.0) -> Found:
    """Return measurements as printed, dither with ``effect`` times its printed change."""
    printed = {}
    for robot in ("panda", "iiwa7"):
        for r in thesis_dithered(robot):
            if r.table == number:
                c = Configuration(r.joint, r.load, r.direction)
                change = r.tau_sje_nm / r.tau_base_nm - 1
                base = thesis_base(robot).tau[c.index]
                printed[robot, job_of(r)] = base * (1 + effect * change)
    out = {}
    for robot, job in torque_needs(number)["sje"]:
        c = job.configuration
        tau = printed.get((robot, job), thesis_base(robot).tau[c.index])
        out[robot, job] = measurement(job, tau)
    return {"sje": out}


def written(key: str, found: Found, tmp_path) -> tuple[str, str, list[dict[str, str]]]:
    """Return comparison and text of a table, and the lines of its CSV."""
    (item,) = chosen([key])
    compared, body = item.write(found, tmp_path)
    rows = csv_rows(tmp_path / item.file)
    # a cell for every column, and a column for every cell
    assert all(None not in row and None not in row.values() for row in rows)
    return compared, body, rows


# ---- torques -------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", ["4.5", "4.7"])
def test_tables_as_printed_have_no_difference(number, tmp_path):
    compared, body, rows = written(f"table-{number}", torques(number), tmp_path)
    printed = thesis_table(number)
    assert list(rows[0])[: len(printed[0])] == list(printed[0])
    assert len(rows) == len(printed)
    for row, was in zip(rows, printed, strict=True):
        assert float(row["tau_sje_Nm"]) == was["tau_sje_Nm"]
        c = Configuration(was["joint"], was["load"], was["direction"])
        base = thesis_base("iiwa7" if number == "4.5" else "panda").tau[c.index]
        assert float(row["simulated_tau_base_Nm"]) == pytest.approx(base)
        assert float(row["difference_points"]) == pytest.approx(0, abs=0.05)
        # Table 4.3 rounds some bases
        assert float(row["simulated_tau_Nm"]) == pytest.approx(was["tau_sje_Nm"], rel=2e-3)
    assert compared.startswith("0.0 points off")
    assert body.count("\n| ") == len({(r["joint"], r["load"], r["direction"]) for r in printed})


@pytest.mark.parametrize(("effect", "off"), [(0.0, 9.9), (0.2, 7.9), (1.0, 0.0)])
def test_a_weaker_dither_is_as_far_off_as_it_is_weak(effect, off):
    rows = rows_of_table("4.6", torques("4.6", effect)["sje"])
    text = compare(rows)
    assert float(text.split(" points")[0]) == pytest.approx(off, abs=0.15)
    assert "no effect: 9.9, repeats: 3.1" in text


def test_a_broken_cell_counts_nowhere_and_stuck_ones_are_counted():
    found = torques("4.7")["sje"]
    rows = rows_of_table("4.7", found)
    assert sum(r.cell.outlier for r in rows) == 1
    stuck = [dataclasses.replace(r, simulated=measurement(r.simulated.job, math.nan)) for r in rows]
    assert compare(stuck) == "never moved"
    assert compare([stuck[0], *rows[1:]]).endswith("; 1 of 83 cells never moved")


# ---- ramps ---------------------------------------------------------------------------------------


def ramp_group(factor: float = 1.0) -> list[Measurement]:
    base = thesis_base("panda")
    return [
        measurement(job, factor * base.tau[c.index], 4)
        for job in Ramps("panda", 6, "none").jobs()
        for c in [job.configuration]
    ]


def test_ramps_measure_how_far_they_are_from_print():
    ramps = Ramps("panda", 6, "none")
    far = ramp_group(factor=1.2)
    assert ramps.compare(far, far) == "20.0 % off (calibrated)"
    far[0].tau[:] = math.nan
    assert ramps.compare(far, far) == "20.0 % off (calibrated); 1 never moved"


# ---- lines ---------------------------------------------------------------------------------------


def fit(intercepts: float | None = None) -> lsm.LineFit:
    """Return lines as printed, or of bands times a factor."""
    bands = lsm.bands_of("panda")
    lines = {}
    for r in thesis_table("A.1"):
        sign = 1 if r["direction"] == "+" else -1
        b = r["intercept_Nm"] if intercepts is None else sign * intercepts * bands[r["joint"] - 1]
        lines[r["joint"], r["direction"]] = Line(r["slope_Nms_per_rad"], b, r["r2"])
    speed = np.linspace(-1, 1, 100)[:, None].repeat(7, axis=1)
    torque = lsm.friction(speed, bands)
    return lsm.LineFit(robot="panda", speed=speed, torque=torque, lines=lines, links=None)


def fits(wrong: float | None = None) -> Found:
    out = {("panda", w): fit(0.8) for w in lsm.WRONG}
    return {"lsm": {**out, ("panda", lsm.ALL_WRONG): fit(wrong)}}


def test_lines_as_printed_have_no_difference(tmp_path):
    compared, body, rows = written("table-A.1", fits(), tmp_path)
    assert compared == "5 of 14 signs wrong (print 5), largest 4.2 N·m (print 4.2)"
    assert {float(r["difference_intercept_Nm"]) for r in rows} == {0.0}
    assert list(rows[0])[:6] == list(thesis_table("A.1")[0])
    assert "| nothing | 20 % (20 %) | 0.00 | 0 |" in body
    turned, _, _ = written("table-A.1", fits(-0.1), tmp_path)
    assert turned.startswith("14 of 14 signs wrong")
    _, _, rows = written("table-4.2", fits(), tmp_path)
    assert max(abs(float(r["difference"])) for r in rows) < 0.005  # print rounds


def test_table_4_4_compares_lines_with_base_torques(tmp_path):
    brief, _, rows = written("table-4.4", {**fits(), **torques("4.3")}, tmp_path)
    assert len(rows) == 28
    assert float(rows[0]["simulated_tau_base_Nm"]) == 0.5711
    now, old = brief.split()[0], brief.split("print ")[1].split(",")[0]
    assert now == old  # as printed


def test_links_of_a_known_mass(tmp_path):
    rows = {(r["joint"], r["quantity"]): r["value"] for r in thesis_table("4.1")}

    def found(mass: float) -> Found:
        """Spheres of a mass, friction as printed."""
        phi = np.zeros((7, 10))
        phi[:, 0], phi[:, [4, 6, 9]] = mass, 0.01
        links = Unconstrained(
            phi=phi,
            coulomb=np.array([rows[j, "coulomb"] for j in range(1, 8)]),
            viscous=np.array([rows[j, "viscous"] for j in range(1, 8)]),
        )
        linked = dataclasses.replace(fit(), robot="iiwa7", links=links)
        return {"lsm": {("iiwa7", w): linked for w in ("nothing", lsm.ALL_WRONG)}}

    good, _, lines = written("table-4.1", found(3.0), tmp_path)
    assert good == "0 of 7 links cannot exist; 21 kg (print 1014)"
    assert len(lines) == 91
    value = {(r["joint"], r["quantity"]): r for r in lines if r["subtable"] == "a"}
    assert float(value["3", "mass"]["simulated"]) == 3.0
    assert float(value["3", "mass"]["difference"]) == pytest.approx(53.15)
    assert float(value["3", "viscous"]["difference"]) == 0.0
    bad, _, _ = written("table-4.1", found(-3.0), tmp_path)
    assert bad == "7 of 7 links cannot exist; −21 kg (print 1014)"


# ---- paths ---------------------------------------------------------------------------------------


@pytest.fixture
def found(monkeypatch) -> Found:
    """Paths as printed."""
    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", run_paths)
    (item,) = chosen(["figure-4.6"])
    return run_studies(item.needs, Options(iterations=3), lambda *_: None)


def test_sums_as_printed_have_all_signs_right(found, tmp_path):
    compared, _, rows = written("table-4.11", found, tmp_path)
    assert compared == (
        '24 of 24 signs ("every error falls": 19; rises: 5 of 5), sizes off by a factor of 1.0'
    )
    assert len(rows) == 24
    assert max(abs(float(r["difference_points"])) for r in rows) == pytest.approx(0, abs=1e-6)
    for row in rows:
        printed = float(row["mean_error_no_dither"])
        assert float(row["simulated_no_dither"]) == pytest.approx(printed)
    assert list(rows[0])[:11] == list(thesis_table("4.11")[0])


def test_paths_and_errors_say_where_dither_helps(found):
    pairs = list(found["gte"].values())
    assert compare_paths(pairs).startswith("closer in 4 of 4 cases")
    turned = [(b, a) for a, b in pairs]
    assert compare_paths(turned).startswith("closer in 0 of 4 cases")
    triangle = [p for p in pairs if p[0][0].case.trajectory == "triangle"]
    # printed: x grows, y and z fall
    assert compare_errors(triangle, range(3)) == "errors fall on 2 and 2 of 3 axes"
    assert compare_errors(triangle, range(3, 6)) == "errors fall on 3 and 3 of 3 axes"
    assert compare_errors([(b, a) for a, b in triangle], range(3)).startswith(
        "errors fall on 1 and 1"
    )
