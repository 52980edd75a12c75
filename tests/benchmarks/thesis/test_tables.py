"""What tables and figures say of made-up measurements."""

import csv
import dataclasses
import math

import numpy as np
import pytest

from benchmarks.thesis import lsm
from benchmarks.thesis.catalogue import chosen
from benchmarks.thesis.items import Found, Written
from benchmarks.thesis.line_fit import Line
from benchmarks.thesis.lines import compare_curve
from benchmarks.thesis.paths import (
    compare_errors,
    compare_paths,
    compare_sums,
    window_sums,
)
from benchmarks.thesis.ramps import Ramps
from benchmarks.thesis.rosdyn import Unconstrained
from benchmarks.thesis.studies import Options, run_studies
from benchmarks.thesis.torques import (
    Chosen,
    choose,
    compare,
    grid,
    job_of,
    jobs_of_table,
    rows_of_table,
)
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job, Measurement
from stiction_envs.measured import thesis_base, thesis_dithered, thesis_table
from tests.benchmarks.thesis.made_up import measurement, run_paths


def torques(number: str, effect: float = 1.0) -> Found:
    """Return measurements as printed, dither with ``effect`` times its printed change."""
    printed = {}
    for robot in ("panda", "iiwa7"):
        for r in thesis_dithered(robot):
            if r.table == number:
                c = Configuration(r.joint, r.load, r.direction)
                change = r.tau_sje_nm / r.tau_base_nm - 1
                base = thesis_base(robot).get(c.joint, c.load, c.direction)
                printed[robot, job_of(r)] = base * (1 + effect * change)
    out = {}
    for robot, job in jobs_of_table(number):
        c = job.configuration
        tau = printed.get((robot, job), thesis_base(robot).get(c.joint, c.load, c.direction))
        out[robot, job] = measurement(job, tau)
    return {"sje": out}


def written(key: str, found: Found, tmp_path) -> tuple[Written, list[dict[str, str]]]:
    (item,) = chosen([key])
    done = item.write(item, found, tmp_path)
    if item.kind == "figure":
        assert (tmp_path / item.file).is_file()
        return done, []
    with open(tmp_path / item.file, encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    # a cell for every column, and a column for every cell
    assert all(None not in row and None not in row.values() for row in rows)
    return done, rows


# ---- torques -------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", ["4.5", "4.6", "4.7", "4.8"])
def test_tables_as_printed_have_no_difference(number, tmp_path):
    done, rows = written(f"table-{number}", torques(number), tmp_path)
    printed = thesis_table(number)
    assert list(rows[0])[: len(printed[0])] == list(printed[0])
    assert len(rows) == len(printed)
    for row, was in zip(rows, printed, strict=True):
        assert float(row["tau_sje_Nm"]) == was["tau_sje_Nm"]
        base = thesis_base("iiwa7" if number == "4.5" else "panda")
        base = base.get(was["joint"], was["load"], was["direction"])
        assert float(row["simulated_tau_base_Nm"]) == pytest.approx(base)
        assert float(row["difference_points"]) == pytest.approx(0, abs=0.05)
        # Table 4.3 rounds some bases
        assert float(row["simulated_tau_Nm"]) == pytest.approx(was["tau_sje_Nm"], rel=2e-3)
    rises = sum(r["change_pct"] > 0 for r in printed)
    assert f"{rises} of {rises} printed rises come out" in done.numbers[1]
    assert done.numbers[0].startswith("0.0 points off")
    assert done.body.count("\n| ") == len(
        {(r["joint"], r["load"], r["direction"]) for r in printed}
    )


def test_table_4_10_knows_a_setting_that_is_in_both_its_halves(tmp_path):
    """Some intermediate amplitudes are the final one: one simulation, two printed torques."""
    _, rows = written("table-4.10", torques("4.10"), tmp_path)
    off = [r for r in rows if abs(float(r["difference_points"])) > 0.05]
    assert {r["amplitude_set"] for r in off} == {"intermediate"}
    assert len(off) <= 6


@pytest.mark.parametrize(("effect", "off"), [(0.0, 9.9), (0.2, 7.9), (1.0, 0.0)])
def test_a_weaker_dither_is_as_far_off_as_it_is_weak(effect, off):
    rows = rows_of_table("4.6", torques("4.6", effect)["sje"])
    text = compare(rows)[0]
    assert float(text.split(" points")[0]) == pytest.approx(off, abs=0.15)
    assert "no effect: 9.9, repeats: 3.1" in text


def test_a_broken_cell_counts_nowhere_and_stuck_ones_are_counted():
    rows = rows_of_table("4.7", torques("4.7")["sje"])
    assert sum(r.outlier for r in rows) == 1
    assert "mean of 83 cells" in compare(rows)[1]
    stuck = [dataclasses.replace(r, simulated_change_pct=math.nan) for r in rows]
    assert compare(stuck)[0] == "never moved"
    assert "1 cells never moved" in compare([stuck[0], *rows[1:]])[1]


def test_base_torques_that_are_off_or_stuck(tmp_path):
    found = torques("4.3")
    good, rows = written("table-4.3", found, tmp_path)
    assert len(rows) == 56
    assert good.numbers[0] == "0.0 % off (calibrated)"
    wrong = {key: measurement(key[1], 1.1 * m.mean) for key, m in found["sje"].items()}
    bad, rows = written("table-4.3", {"sje": wrong}, tmp_path)
    assert "off by 10.0 % in the mean" in bad.numbers[1]
    assert float(rows[0]["difference_points"]) == pytest.approx(10.0)
    key = next(iter(wrong))
    wrong[key] = measurement(key[1], math.nan)
    done, _ = written("table-4.3", {"sje": wrong}, tmp_path)
    assert "1 never moved" in done.numbers[1]
    assert "stuck" in done.body


def choice(joint: int, **changes: float) -> Chosen:
    printed = next(r for r in thesis_table("4.9") if r["joint"] == joint)
    values = {
        "frequency_hz": printed["frequency_Hz"],
        "scale": 1.2 if joint == 3 else printed["scale"],
        "final_nm": abs(printed["tau_final_Nm"]),
    }
    return Chosen(reason="the largest", **{**values, **changes})


def test_chosen_settings_count_what_is_the_same(tmp_path):
    same = {j: choice(j) for j in range(1, 8)}
    done, rows = written("table-4.9", {"choice": same}, tmp_path)
    assert done.numbers[0] == "7 of 7 frequencies, 7 scales, 7 amplitudes"
    assert {float(r["difference_final_Nm"]) for r in rows} == {0.0}
    assert float(rows[0]["simulated_tau_intermediate_Nm"]) == pytest.approx(0.5711)
    other = {**same, 4: choice(4, frequency_hz=15.0, final_nm=1.0)}
    done, _ = written("table-4.9", {"choice": other}, tmp_path)
    assert done.numbers[0] == "6 of 7 frequencies, 7 scales, 6 amplitudes"


def test_choices_follow_the_rules():
    """A tenth of the amplitude, whatever the frequency: the first frequency, the largest scale."""
    base = {key[0]: Job(key[0]) for key in grid()}
    of = thesis_base("panda")
    measured: dict[Job, Measurement] = {}
    for job in [*base.values(), *grid().values()]:
        c = job.configuration
        tau = of.get(c.joint, c.load, c.direction) - 0.1 * c.sign * job.amplitude_nm
        measured[job] = measurement(job, tau)
    found = [choose(j, measured) for j in range(1, 8)]
    assert {(c.frequency_hz, c.scale) for c in found} == {(80.0, 1.2)}
    assert found[6].final_nm == pytest.approx(1.2 * 0.6701)
    assert found[1].final_nm < 3.0  # the thesis dropped 3.7584 by hand


def test_jobs_cover_every_printed_cell_once():
    jobs = jobs_of_table("4.9")
    assert len(jobs) == len(set(jobs)) == 28 + 336
    for number, count in {"4.3": 56, "4.5": 16, "4.6": 28 + 112, "4.10": 28 + 54}.items():
        assert len(jobs_of_table(number)) == count


# ---- ramps ---------------------------------------------------------------------------------------


def ramp_group(factor: float = 1.0) -> list[Measurement]:
    base = thesis_base("panda")
    return [
        measurement(job, factor * base.get(6, c.load, c.direction), 4)
        for job in Ramps("panda", 6, "none").jobs()
        for c in [job.configuration]
    ]


def test_ramps_measure_how_far_they_are_from_print():
    ramps = Ramps("panda", 6, "none")
    far = ramp_group(factor=1.2)
    assert ramps.compare(far, far)[0] == "20.0 % off (calibrated)"
    far[0].tau[:] = math.nan
    assert "20.0 % off in the mean" in ramps.compare(far, far)[1]
    assert "1 of four never moved" in ramps.compare(far, far)[1]


def test_dithered_ramps_compare_the_change_with_print():
    ramps = Ramps("panda", 6, "final")
    base = ramp_group()
    shaken = [
        measurement(job, m.mean * (1 + r.change_pct / 100), 4)
        for job, m, r in zip(ramps.jobs(), base, ramps.printed(), strict=True)
    ]
    assert "one by one 0.0 points apart" in ramps.compare(shaken, base)[1]
    assert ramps.compare(base, base)[0].startswith("0.0 % (print −8")


# ---- lines ---------------------------------------------------------------------------------------


def fit(intercepts: float | None = None) -> lsm.LineFit:
    """Return lines as printed, or of bands times a factor."""
    bands = lsm.bands_of("panda")
    lines = []
    for r in thesis_table("A.1"):
        sign = 1 if r["direction"] == "+" else -1
        b = r["intercept_Nm"] if intercepts is None else sign * intercepts * bands[r["joint"] - 1]
        values = {"slope": r["slope_Nms_per_rad"], "r2": r["r2"], "rows": 10}
        lines.append(Line(joint=r["joint"], direction=r["direction"], intercept=b, **values))
    speed = np.linspace(-1, 1, 100)[:, None].repeat(7, axis=1)
    torque = lsm.friction(speed, bands)
    return lsm.LineFit(robot="panda", speed=speed, torque=torque, lines=tuple(lines), links=None)


def fits(wrong: float | None = None) -> Found:
    out = {("panda", w): fit(0.8) for w in lsm.WRONG}
    return {"lsm": {**out, ("panda", lsm.ALL_WRONG): fit(wrong)}}


def test_lines_as_printed_have_no_difference(tmp_path):
    done, rows = written("table-A.1", fits(), tmp_path)
    assert done.numbers[0] == ("5 of 14 signs wrong (print 5), largest 4.2 N·m (print 4.2)")
    assert "14 signs are as printed" in done.numbers[1]
    assert {float(r["difference_intercept_Nm"]) for r in rows} == {0.0}
    assert list(rows[0])[:6] == list(thesis_table("A.1")[0])
    assert "| nothing | 20 % (20 %) | 0.00 | 0 |" in done.body
    turned, _ = written("table-A.1", fits(-0.1), tmp_path)
    assert turned.numbers[0].startswith("14 of 14 signs wrong")
    done, rows = written("table-4.2", fits(), tmp_path)
    assert max(abs(float(r["difference"])) for r in rows) < 0.005  # print rounds
    assert "0.00 N·m (joint 1), 0.00 N·m (joint 7) from those of one with all" in done.numbers[1]


def test_table_4_4_compares_lines_with_base_torques(tmp_path):
    done, rows = written("table-4.4", {**fits(), **torques("4.3")}, tmp_path)
    assert len(rows) == 28
    assert float(rows[0]["simulated_tau_base_Nm"]) == 0.5711
    now, old = done.numbers[0].split()[0], done.numbers[0].split("print ")[1].split(",")[0]
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

    good, lines = written("table-4.1", found(3.0), tmp_path)
    assert good.numbers[0] == "0 of 7 links cannot exist; 21 kg (print 1014)"
    assert len(lines) == 91
    value = {(r["joint"], r["quantity"]): r for r in lines if r["subtable"] == "a"}
    assert float(value["3", "mass"]["simulated"]) == 3.0
    assert float(value["3", "mass"]["difference"]) == pytest.approx(53.15)
    assert float(value["3", "viscous"]["difference"]) == 0.0
    bad, _ = written("table-4.1", found(-3.0), tmp_path)
    assert "7 of 7 links cannot exist; −21 kg" in bad.numbers[1]
    assert "7 masses and 10 friction coefficients are negative (print 1 and 10)" in bad.numbers[1]


def test_a_curve_off_its_law():
    two = np.ones(2)
    curve = lsm.FrictionCurve(
        robot="panda",
        stiction=0.7 * two,
        coulomb=0.6 * two,
        stribeck=0.003 * two,
        viscous=0.1 * two,
        speed=np.array([-0.1, 0.1]),
        torque=np.zeros(2),
    )
    assert curve.law(0.0) == 0.0
    assert curve.law(1e-9) == pytest.approx(0.7)
    assert curve.law(-1.0) == pytest.approx(-0.7)
    right = dataclasses.replace(curve, torque=curve.law(curve.speed))
    assert compare_curve(right)[0] == "0.0 % off its law"
    wrong = dataclasses.replace(right, torque=0.8 * right.torque)
    assert compare_curve(wrong)[0] == "20.0 % off its law"


# ---- paths ---------------------------------------------------------------------------------------


@pytest.fixture
def found(monkeypatch, tmp_path) -> Found:
    """Paths as printed."""
    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", run_paths)
    (item,) = chosen(["figure-4.6"])
    options = Options(iterations=3, folder=tmp_path / "studies")
    return run_studies(item.needs(), options, lambda *_: None)[0]


def test_sums_as_printed_have_all_signs_right(found, tmp_path):
    done, rows = written("table-4.11", found, tmp_path)
    assert done.numbers[0] == (
        '24 of 24 signs ("every error falls": 19), sizes off by a factor of 1.0'
    )
    assert "5 of 5 rises" in done.numbers[1]
    assert len(rows) == 24
    assert max(abs(float(r["difference_points"])) for r in rows) == pytest.approx(0, abs=1e-6)
    for row in rows:
        for ours, theirs in (("simulated_no_dither", "mean_error_no_dither"),):
            assert float(row[ours]) == pytest.approx(float(row[theirs]))
    assert list(rows[0])[:11] == list(thesis_table("4.11")[0])


def test_wrong_signs_wrong_sizes_and_noise_are_seen(found):
    sums = window_sums(list(found["gte"].values()))
    swapped = dataclasses.replace(sums, simulated=sums.simulated[::-1])
    assert compare_sums(swapped)[0].startswith("0 of 24 signs")
    twice = dataclasses.replace(sums, simulated=2 * sums.simulated)
    assert compare_sums(twice)[0].endswith("a factor of 2.0")
    # standard error of the change: 0.5 / 5 = 0.1 for 25 iterations
    std, before = np.tile([[0.3], [0.4]], 24), np.full(24, 5.0)
    noisy = dataclasses.replace(sums, std=std, iterations=25)
    for gap, clear in ((0.19, False), (0.21, True)):
        apart = dataclasses.replace(noisy, simulated=np.stack([before, before + gap]))
        assert apart.clear.tolist() == [clear] * 24
    one = dataclasses.replace(sums, std=np.full((2, 24), np.nan), iterations=1)
    assert not one.clear.any()


def test_paths_and_errors_say_where_dither_helps(found):
    pairs = list(found["gte"].values())
    assert compare_paths(pairs)[0].startswith("closer in 4 of 4 cases")
    turned = [(b, a) for a, b in pairs]
    assert compare_paths(turned)[0].startswith("closer in 0 of 4 cases")
    triangle = [p for p in pairs if p[0][0].case.trajectory == "triangle"]
    # printed: x grows, y and z fall
    assert compare_errors(triangle, range(3))[0] == "errors fall on 2 and 2 of 3 axes"
    assert compare_errors(triangle, range(3, 6))[0] == "errors fall on 3 and 3 of 3 axes"
    assert compare_errors([(b, a) for a, b in triangle], range(3))[0].startswith(
        "errors fall on 1 and 1"
    )


# ---- pictures ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_pictures_are_drawn(found, tmp_path):
    for key in ("figure-4.1", "figure-A.1"):
        written(key, fits(), tmp_path)
    for key in ("figure-4.6", "figure-4.7", "figure-E.1", "figure-F.2"):
        written(key, found, tmp_path)
    done, _ = written("figure-4.3", {"sje": {("panda", m.job): m for m in ramp_group()}}, tmp_path)
    assert done.body.startswith("![Figure 4.3: Ramps of the Panda's joint 6 without dither")
    assert done.body.endswith("(figures/figure_4_3.png)")
