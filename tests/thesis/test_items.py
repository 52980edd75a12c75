"""What items write and say: the numbers are made up, and the sentences follow them."""

import csv
import dataclasses
import math
import re

import numpy as np
import pytest

from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job, Measurement
from stiction_envs.measured import thesis_base, thesis_dithered, thesis_table
from stiction_envs.thesis import lsm
from stiction_envs.thesis.catalogue import chosen
from stiction_envs.thesis.friction_curve import FrictionCurve
from stiction_envs.thesis.gte import run_thesis_cases, window_sums
from stiction_envs.thesis.items import Found, Written
from stiction_envs.thesis.items_friction import say_curve
from stiction_envs.thesis.items_lines import say_lines
from stiction_envs.thesis.items_paths import ENSEMBLE, say_errors, say_paths, say_sums
from stiction_envs.thesis.items_ramps import Ramps
from stiction_envs.thesis.items_torques import agreement
from stiction_envs.thesis.rosdyn import Unconstrained
from stiction_envs.thesis.tables import ChosenRow, jobs_of_table, rows_of_table
from tests.thesis.made_up_ensemble import made_up
from tests.thesis.test_gte import as_printed


def measurement(job: Job, tau: float, iterations: int = 3) -> Measurement:
    return Measurement(
        job=job,
        tau=np.full(iterations, tau),
        start=np.zeros(iterations),
        start_torque=np.zeros(iterations),
        shaken_speed=np.zeros(1),
        deviation=0.0,
        traces=tuple(np.linspace(0, 0.15, 5, dtype=np.float32) for _ in range(iterations)),
        trace_dt=0.01,
    )


def torques(number: str, effect: float = 1.0) -> Found:
    """Return measurements as printed, dither with ``effect`` times its printed change."""
    printed = {}
    for robot in ("panda", "iiwa7"):
        for r in thesis_dithered(robot):
            if r.table == number:
                c = Configuration(r.joint, r.load, r.direction)
                change = r.tau_sje_nm / r.tau_base_nm - 1
                base = thesis_base(robot).get(c.joint, c.load, c.direction)
                tau = base * (1 + effect * change)
                printed[robot, Job(c, r.frequency_hz, r.amplitude_nm)] = tau
    out = {}
    for robot, job in jobs_of_table(number):
        c = job.configuration
        tau = printed.get((robot, job), thesis_base(robot).get(c.joint, c.load, c.direction))
        out[robot, job] = measurement(job, tau)
    return {"sje": out}


def written(key: str, found: Found, tmp_path) -> tuple[Written, list[dict[str, str]]]:
    (item,) = chosen([key])
    done = item.write(item, found, tmp_path)
    assert done.files[0] == item.file
    assert all((tmp_path / name).is_file() for name in done.files)
    if item.kind == "figure":
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
    assert "off by 0.0 points" in done.said.sentence
    rises = sum(r["change_pct"] > 0 for r in printed)
    assert f"{rises} of the {rises} printed rises come out" in done.said.sentence
    assert "as well as the thesis agrees with itself" in done.said.sentence
    assert done.body.count("\n| ") + 1 == 1 + len(
        {(r["joint"], r["load"], r["direction"]) for r in printed}
    )


def test_table_4_10_knows_a_setting_that_is_in_both_its_halves(tmp_path):
    """Some intermediate amplitudes are the final one: one simulation, two printed torques."""
    done, rows = written("table-4.10", torques("4.10"), tmp_path)
    off = [r for r in rows if abs(float(r["difference_points"])) > 0.05]
    assert {r["amplitude_set"] for r in off} == {"intermediate"}
    assert len(off) <= 6
    assert "as well as the thesis agrees with itself" in done.said.sentence


@pytest.mark.parametrize(("number", "share"), [("4.6", 0.6), ("4.10", 0.75)])
def test_a_dither_without_effect_is_called_that(number, share, tmp_path):
    done, _ = written(f"table-{number}", torques(number, effect=0.0), tmp_path)
    assert "nothing of this table is predicted" in done.said.sentence
    most, _ = written(f"table-{number}", torques(number, effect=share), tmp_path)
    assert "but not to within the repeats" in most.said.sentence
    little, _ = written(f"table-{number}", torques(number, effect=0.2), tmp_path)
    assert "hardly anything of this table is predicted" in little.said.sentence


def test_only_what_was_fitted_is_called_fitted(tmp_path):
    fitted, _ = written("table-4.6", torques("4.6"), tmp_path)
    held_out, _ = written("table-4.8", torques("4.8"), tmp_path)
    other, _ = written("table-4.5", torques("4.5"), tmp_path)
    assert "fitted to this very table" in fitted.said.sentence
    assert "nothing is fitted to this table" in held_out.said.sentence
    assert "nothing is fitted to the iiwa's table" in other.said.sentence
    assert "100 Hz is half of the 200 Hz of the controller" in other.said.sentence


def test_agreement_tells_a_moved_base_from_a_wrong_effect():
    found = torques("4.6")
    rows = rows_of_table("4.6", {"panda": {j: m for (_, j), m in found["sje"].items()}})
    moved = [
        dataclasses.replace(r, simulated_change_pct=r.measured_change_pct + 10 * (-1) ** r.joint)
        for r in rows
    ]
    assert agreement(moved).constant == pytest.approx(1.0)
    assert agreement(moved).mean == pytest.approx(10.0)
    turned = [
        dataclasses.replace(
            r, simulated_change_pct=r.measured_change_pct + (10 if r.frequency_hz > 40 else -10)
        )
        for r in rows
    ]
    assert agreement(turned).constant == pytest.approx(0.0, abs=1e-9)
    stuck = [dataclasses.replace(r, simulated_change_pct=math.nan) for r in rows]
    assert agreement(stuck).stuck == len(rows)


def test_base_torques_say_that_they_are_calibrated_or_not_met(tmp_path):
    found = torques("4.3")
    good, rows = written("table-4.3", found, tmp_path)
    assert len(rows) == 56
    assert "no prediction" in good.said.sentence
    wrong = {key: measurement(key[1], 1.1 * m.mean) for key, m in found["sje"].items()}
    bad, rows = written("table-4.3", {"sje": wrong}, tmp_path)
    assert "off by 10.0 % in the mean" in bad.said.sentence
    assert float(rows[0]["difference_points"]) == pytest.approx(10.0)
    key = next(iter(wrong))
    wrong[key] = measurement(key[1], math.nan)
    assert "1 joint never moved" in written("table-4.3", {"sje": wrong}, tmp_path)[0].said.sentence


def choice(joint: int, **changes: float) -> ChosenRow:
    printed = next(r for r in thesis_table("4.9") if r["joint"] == joint)
    values = {
        "frequency_hz": printed["frequency_Hz"],
        "scale": 1.2 if joint == 3 else printed["scale"],
        "final_nm": printed["tau_final_Nm"],
    }
    return ChosenRow(
        joint=joint,
        **{f"measured_{k}": v for k, v in values.items()},
        **{f"simulated_{k}": changes.get(k, v) for k, v in values.items()},
        reason="the largest",
    )


def test_chosen_settings_count_what_is_the_same(tmp_path):
    same = {j: choice(j) for j in range(1, 8)}
    done, rows = written("table-4.9", {"choice": same}, tmp_path)
    assert "printed frequency for 7 of 7 joints, the printed scale for 7 and" in done.said.sentence
    assert {float(r["difference_final_Nm"]) for r in rows} == {0.0}
    assert float(rows[0]["simulated_tau_intermediate_Nm"]) == pytest.approx(0.5711)
    other = {**same, 4: choice(4, frequency_hz=15.0, final_nm=1.0)}
    done, _ = written("table-4.9", {"choice": other}, tmp_path)
    assert "frequency for 6 of 7" in done.said.sentence
    assert (
        "joint 4 goes to 15 Hz for 50, which in print are 1.2 points apart, less than"
        in done.said.sentence
    )
    assert "furthest: joint 4, −50 %" in done.said.sentence


# ---- ramps ---------------------------------------------------------------------------------------


def ramp_group(first: float = 0.0, factor: float = 1.0) -> list[Measurement]:
    ramps = Ramps("panda", 6, "none")
    out = []
    for job in ramps.jobs():
        c = job.configuration
        m = measurement(job, factor * thesis_base("panda").get(6, c.load, c.direction), 4)
        m.tau[1:] += c.sign * np.array([-0.001, 0.0, 0.001])
        m.tau[0] += c.sign * first
        out.append(m)
    return out


def test_ramps_say_whether_the_first_is_another():
    ramps = Ramps("panda", 6, "none")
    alike, other = ramp_group(), ramp_group(first=0.02)
    assert "is not seen" in ramps.said(alike, alike).sentence
    assert "as section 5.1 reports, it behaves differently" in ramps.said(other, other).sentence
    far = ramp_group(factor=1.2)
    assert "within 0.0 %" in ramps.said(alike, alike).sentence
    assert "within 20.0 %" in ramps.said(far, far).sentence


def test_dithered_ramps_compare_the_change_with_print():
    ramps = Ramps("panda", 6, "final")
    printed = ramps.printed()
    base = ramp_group()
    shaken = [
        measurement(job, m.mean * (1 + r.change_pct / 100), 4)
        for job, m, r in zip(ramps.jobs(), base, printed, strict=True)
    ]
    assert "(one by one 0.0 points apart)" in ramps.said(shaken, base).sentence
    assert "torque by 0.0 % in the mean of the four" in ramps.said(base, base).sentence


# ---- lines ---------------------------------------------------------------------------------------


def fit(wrong: str, intercepts: float | None = None) -> lsm.LineFit:
    """Return lines as printed, or of bands times a factor."""
    bands = lsm.bands_of("panda")
    lines = []
    for r in thesis_table("A.1"):
        sign = 1 if r["direction"] == "+" else -1
        b = r["intercept_Nm"]
        if intercepts is not None:
            b = sign * intercepts * bands[r["joint"] - 1]
        lines.append(
            lsm.Line(
                joint=r["joint"],
                direction=r["direction"],
                rows=10,
                intercept=b,
                slope=r["slope_Nms_per_rad"],
                r2=r["r2"],
            )
        )
    speed = np.linspace(-1, 1, 100)[:, None].repeat(7, axis=1)
    torque = lsm.friction(speed, bands)
    return lsm.LineFit(
        robot="panda", wrong=wrong, speed=speed, torque=torque, lines=tuple(lines), links=None
    )


def fits(**given: lsm.LineFit) -> dict[str, lsm.LineFit]:
    out = {wrong: fit(wrong, 0.8) for wrong in lsm.WRONG}
    out["gravity error"] = fit("gravity error")
    out[lsm.ALL_WRONG] = given.get("wrong", fit(lsm.ALL_WRONG))
    return out


def test_lines_as_printed_fail_in_the_same_way(tmp_path):
    sentence = say_lines(fits()).sentence
    assert "in print 5 and 4.2: the same failure in kind and size, 14 signs as printed" in sentence
    assert "an error of gravity moves intercepts most" in sentence
    small = say_lines(fits(wrong=fit(lsm.ALL_WRONG, -0.1))).sentence
    assert "the same failure in kind, not in size" in small
    none = say_lines(fits(wrong=fit(lsm.ALL_WRONG, 0.8))).sentence
    assert "these defects do not explain" in none
    found = {"lsm": {("panda", w): f for w, f in fits().items()}}
    _, rows = written("table-A.1", found, tmp_path)
    assert {float(r["difference_intercept_Nm"]) for r in rows} == {0.0}
    assert list(rows[0])[:6] == list(thesis_table("A.1")[0])
    _, rows = written("table-4.2", found, tmp_path)
    assert max(abs(float(r["difference"])) for r in rows) < 0.005  # print rounds


def test_table_4_4_compares_lines_with_base_torques(tmp_path):
    found = {"lsm": {("panda", w): f for w, f in fits().items()}, **torques("4.3")}
    done, rows = written("table-4.4", found, tmp_path)
    assert len(rows) == 28
    assert float(rows[0]["simulated_tau_base_Nm"]) == 0.5711
    assert "not the method is at fault" in done.said.sentence
    clean = {**found["lsm"], ("panda", "nothing"): fit("nothing")}
    done, _ = written("table-4.4", {**found, "lsm": clean}, tmp_path)
    assert "do not mend the method" in done.said.sentence


def linked(mass: float, wrong: str) -> lsm.LineFit:
    """Return spheres of a mass, friction as printed."""
    rows = {(r["joint"], r["quantity"]): r["value"] for r in thesis_table("4.1")}
    phi = np.zeros((7, 10))
    phi[:, 0], phi[:, [4, 6, 9]] = mass, 0.01
    links = Unconstrained(
        phi=phi,
        coulomb=np.array([rows[j, "coulomb"] for j in range(1, 8)]),
        viscous=np.array([rows[j, "viscous"] for j in range(1, 8)]),
        condition=1.0,
    )
    return dataclasses.replace(fit(wrong), robot="iiwa7", links=links)


def test_links_say_whether_they_fail_alike(tmp_path):
    def found(mass: float) -> Found:
        return {"lsm": {("iiwa7", w): linked(mass, w) for w in ("nothing", lsm.ALL_WRONG)}}

    good, rows = written("table-4.1", found(3.0), tmp_path)
    assert "this failure is not reproduced" in good.said.sentence
    assert len(rows) == 91
    value = {(r["joint"], r["quantity"]): r for r in rows if r["subtable"] == "a"}
    assert float(value["3", "mass"]["simulated"]) == 3.0
    assert float(value["3", "mass"]["difference"]) == pytest.approx(53.15)
    assert float(value["3", "viscous"]["difference"]) == 0.0
    bad, _ = written("table-4.1", found(-3.0), tmp_path)
    assert "7 of 7 simulated links cannot exist" in bad.said.sentence
    assert "The same kind of failure, not its size" in bad.said.sentence
    heavy, _ = written("table-4.1", found(1e-6), tmp_path)
    assert heavy.said.brief.endswith("0 kg (print 1014)")


# ---- friction ------------------------------------------------------------------------------------


def test_a_curve_off_its_law_is_called_off():
    two = np.ones(2)
    curve = FrictionCurve(
        robot="panda",
        joint=1,
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
    assert "lie on its law within 0.0 %" in say_curve(right).sentence
    wrong = dataclasses.replace(right, torque=0.8 * right.torque)
    assert "up to 20.0 % off its law" in say_curve(wrong).sentence


# ---- paths ---------------------------------------------------------------------------------------


@pytest.fixture
def pairs(monkeypatch):
    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", as_printed)
    return run_thesis_cases(GeneratedTrajectoryExperiment("panda"), iterations=3)


def found_of(pairs) -> Found:
    ensemble = [made_up(k) for k in range(3)], {"diagonal": 0.5, "mass": 0.8}
    return {
        "gte": {(p[0][0].case.trajectory, p[0][0].case.stiffness): p for p in pairs},
        "ensemble": {ENSEMBLE: ensemble},
    }


def test_sums_as_printed_beat_the_rule_that_all_falls(pairs, tmp_path):
    done, rows = written("table-4.11", found_of(pairs), tmp_path)
    assert (
        "24 of 24 signs of the dither's effect are right, more than the 19 of" in done.said.sentence
    )
    assert len(rows) == 24
    assert max(abs(float(r["difference_points"])) for r in rows) == pytest.approx(0, abs=1e-6)
    assert list(rows[0])[:11] == list(thesis_table("4.11")[0])
    assert "#### Table 4.11 as it can be known" in done.body
    assert {"ensemble.csv", "ensemble.png"} <= {p.name for p in tmp_path.iterdir()}
    swapped = [
        dataclasses.replace(
            r, simulated_dither=r.simulated_no_dither, simulated_no_dither=r.simulated_dither
        )
        for r in window_sums(pairs)
    ]
    assert "0 of 24 signs of the dither's effect are right, fewer" in say_sums(swapped, 3).sentence
    assert "one iteration has no noise" in say_sums(swapped, 1).sentence


def test_paths_and_errors_say_where_dither_helps(pairs):
    said = say_paths(pairs).sentence
    assert "better in all 4 cases" in said
    change = [float(x.replace("−", "-")) for x in re.findall(r"(−[\d.]+) %", said)]
    assert len(change) == 4  # RMS distance, and that at the last goal
    assert -40 < min(change[:2]) <= max(change[:2]) < 0
    turned = [(b, a) for a, b in pairs]
    assert "better in none of 4 cases" in say_paths(turned).sentence
    triangle = [p for p in pairs if p[0][0].case.trajectory == "triangle"]
    # printed: x grows, y and z fall
    assert "on 2 of 3 axes (x, y and z) at the lower" in say_errors(triangle, range(3)).sentence
    assert "on 3 of 3 axes (roll, pitch and yaw)" in say_errors(triangle, range(3, 6)).sentence
    turned = [(b, a) for a, b in triangle]
    assert "on 1 of 3 axes" in say_errors(turned, range(3)).sentence
    assert "not seen" in say_errors(triangle, range(3)).sentence  # no spread at all


# ---- pictures ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_pictures_are_drawn(pairs, tmp_path):
    lines = {"lsm": {("panda", w): f for w, f in fits().items()}}
    for key in ("figure-4.1", "figure-A.1"):
        written(key, lines, tmp_path)
    for key in ("figure-4.6", "figure-4.7", "figure-E.1", "figure-F.2"):
        written(key, found_of(pairs), tmp_path)
    ramps = {"sje": {("panda", m.job): m for m in ramp_group()}}
    done, _ = written("figure-4.3", ramps, tmp_path)
    assert done.body == (
        "![Figure 4.3: Ramps of the Panda's joint 6 without dither](figures/figure_4_3.png)"
    )
    assert all(p.stat().st_size > 10_000 for p in (tmp_path / "figures").iterdir())
