"""The page of a ladder: its numbers are the rungs', its sentences follow the numbers."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

from stiction_envs.cli.common import plain
from stiction_envs.errors import StictionError
from stiction_envs.gap.tables.cells import cells, score
from stiction_envs.measured import thesis_dithered
from stiction_envs.reporting import markdown as words
from stiction_envs.thesis import page_iiwa, page_joints, page_limits, page_questions
from stiction_envs.thesis.nyquist_phase import PHASES, study_phase
from stiction_envs.thesis.page import FILES, gap_page, ladder_page, write_page
from stiction_envs.thesis.scores import JOINTS, Findings
from tests.thesis.made_up import made_up, phase_study, rung


@pytest.fixture(scope="module")
def all_cells():
    return cells()


@pytest.fixture(scope="module")
def rungs(all_cells):
    return made_up(all_cells)


@pytest.fixture(scope="module")
def findings(rungs, all_cells):
    return Findings(rungs, all_cells)


@pytest.fixture(scope="module")
def written(rungs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    return folder, write_page(folder, rungs, study=phase_study())


def changed(rungs, **changes):
    """Return rungs with other predictions."""
    return {
        **rungs,
        **{
            k: dataclasses.replace(rungs[k], change=list(map(float, v))) for k, v in changes.items()
        },
    }


def text(lines):
    return "\n".join(lines)


# ---- the whole -----------------------------------------------------------------------------------


def test_all_files_are_written(written):
    folder, _ = written
    assert {p.name for p in folder.iterdir()} == {*FILES, "iiwa.png"}
    for file in folder.glob("*.png"):
        assert file.read_bytes().startswith(b"\x89PNG")
    page = (folder / "gap.md").read_text(encoding="utf-8")
    for name in (*FILES[1:], "iiwa.png"):
        assert f"({name})" in page
    assert not re.search(r"\b(nan|inf)\b", page)


def test_summary_is_json_and_repeats_the_scores(written, rungs, all_cells):
    _, summary = written
    summary = json.loads(json.dumps(plain(summary), allow_nan=False))
    assert summary["finished"]
    assert [r["key"] for r in summary["rungs"]] == list(rungs)
    for r in summary["rungs"]:
        mine = score("", all_cells, np.array(rungs[r["key"]].change))
        assert (r["mean"], r["median"]) == (mine.mean, mine.median)
    assert summary["targets"]["mean"]["reached"] == summary["rungs"][-1]["mean"]
    assert {c["name"] for c in summary["causes"]} >= {"inertia", "presliding"}


def test_table_holds_every_rung_with_its_numbers(findings, rungs):
    lines = ladder_page(findings)
    for key, r in rungs.items():
        s = findings.scores[key]
        row = next(line for line in lines if line.startswith(f"| {r.name} | {s.mean:.1f} ["))
        numbers = [f"{x:.1f}" for x in (*s.by_column.values(), *s.by_joint.values())]
        assert row.endswith(" | ".join(numbers) + " |")
    broken = next(line for line in lines if line.startswith("- Table 4.7, joint 2"))
    assert "94 % (dither does nothing)" in broken


def test_page_is_the_same_twice(findings, rungs, all_cells):
    again = Findings(rungs, all_cells)
    study = phase_study()
    assert gap_page(findings, study) == gap_page(again, study)


@pytest.mark.parametrize("last", ["nothing", "band", "inertia", "load"])
def test_a_ladder_half_climbed_has_a_page_that_says_so(rungs, all_cells, last):
    keys = list(rungs)
    part = {k: rungs[k] for k in keys[: keys.index(last) + 1]}
    page = text(gap_page(Findings(part, all_cells), None))
    assert "This ladder is not finished" in page
    assert f"*{rungs[last].name}*" in page
    assert "Not simulated in this run." in page


def test_bad_rungs(tmp_path, rungs):
    with pytest.raises(StictionError, match="at least one rung"):
        write_page(tmp_path, {})
    short = dataclasses.replace(rungs["nothing"], change=[0.0])
    with pytest.raises(StictionError, match="1 cells, but there are 308"):
        write_page(tmp_path, {"nothing": short})
    assert list(tmp_path.iterdir()) == []


# ---- causes --------------------------------------------------------------------------------------


def test_a_cause_is_named_where_it_helps_and_only_there(rungs, all_cells):
    """Presliding helps joint 7 alone, and spoils joint 5."""
    joint = np.array([c.row.joint for c in all_cells])
    measured = np.array([c.change for c in all_cells])
    before = np.array(rungs["inertia"].change)
    after = np.where(joint == 7, measured, before)
    after = np.where(joint == 5, before + 0.05, after)
    f = Findings(changed(rungs, presliding=after), all_cells)
    named = {j: [g.key for g in f.gains(j) if g.named] for j in JOINTS}
    assert [j for j in JOINTS if "presliding" in named[j]] == [7]
    section = text(page_joints.section(f, 7))
    assert f"**{page_joints.CAUSES['presliding']}**" in section
    gain = next(g for g in f.gains(7) if g.key == "presliding")
    assert gain.plain.after == pytest.approx(0.0)
    assert f"{gain.plain.before:.1f} → 0.0 %" in section
    assert "The error grew with: presliding" in text(page_joints.section(f, 5))


def test_gain_by_shape_sees_through_a_base_that_moved(rungs, all_cells):
    """A rung that gets the shape right on a base that is off is named all the same."""
    measured = np.array([c.change for c in all_cells])
    steady = np.where([c.held_out for c in all_cells], 0.9 * (1 + 0.5 * measured) - 1, -0.1)
    right = 0.85 * (1 + measured) - 1
    f = Findings(changed(rungs, path=steady, elasticity=right), all_cells)
    gain = next(g for g in f.gains(7) if g.key == "elasticity")
    assert gain.shape is not None
    assert gain.shape.after == pytest.approx(0.0, abs=1e-9)
    assert gain.shape.better


def test_constant_that_is_as_good_is_admitted(rungs, all_cells):
    good = text(page_joints.section(Findings(rungs, all_cells), 7))
    assert "do not show that more is needed" not in good
    poor = Findings(changed(rungs, **{"arm + drift": np.zeros(len(all_cells))}), all_cells)
    assert "do not show that more is needed" in text(page_joints.section(poor, 7))


# ---- questions -----------------------------------------------------------------------------------


def test_asymmetry_follows_the_errors(findings, rungs, all_cells):
    assert "the tables speak for an offset" in text(page_questions.asymmetry(findings))
    swapped = changed(rungs, load=rungs["offset"].change, offset=rungs["load"].change)
    other = text(page_questions.asymmetry(Findings(swapped, all_cells)))
    assert "the tables speak for asymmetric friction" in other


def test_frequency_is_told_from_the_measured_means(findings):
    page = text(page_questions.frequency(findings))
    assert "On joints 5, 6 and 7 15 Hz does 1.6 to 3.8 times" in page
    assert "On joints 1, 2, 3 and 4 the four frequencies differ by at most 12 points" in page


def test_iiwa_says_what_phase_cannot_do():
    page = text(page_iiwa.section(phase_study()))
    assert "4 of 8 cells need *more* torque" in page
    assert "no phase raises the torque:" in page
    assert "| 2, load | +0.080 | +0.125 |" in page
    able = text(page_iiwa.section(phase_study(highest=0.4)))
    assert "Phase alone can account for the whole range measured." in able


def test_elasto_plastic_verdicts(findings, rungs, all_cells):
    drift = np.array(rungs["drift"].change)
    measured = np.array([c.change for c in all_cells])
    for change, says in (
        (drift - 0.03, "They speak for creep inside the band"),
        (drift, "do not tell the two apart"),
        (measured, "They speak *against* LuGre's creep"),
    ):
        f = Findings(changed(rungs, **{"elasto-plastic": change}), all_cells)
        assert says in text(page_limits.identification(f))


def test_ramp_rates(rungs, all_cells):
    """0.12 fits as well as 0.07 to the joints' scatter, 0.04 does not; 0.07 is the protocol's."""
    page = text(page_limits.identification(Findings(rungs, all_cells)))
    assert "Fitted best at 0.07 N·m/s; 0.07 and 0.12 N·m/s fit equally well" in page
    assert "dithered torques do not tell it" in page
    assert "| 0.04 | 130.0 | +30.0 |" in page
    f = Findings(rungs, all_cells)
    assert f.ramp_rates() == {0.04: "ramp 0.04", 0.07: "drift", 0.12: "ramp 0.12"}
    gap, error = f.preferred("drift", "ramp 0.04")
    assert (gap, error) == (pytest.approx(30.0), pytest.approx(0.0))
    assert f.preferred("ramp 0.04", "drift")[0] == pytest.approx(-30.0)


def test_identification_marks(rungs, all_cells):
    """One parameter on its bound, one that the seeds do not agree on; a worse seed is no vote."""
    arm = rung("arm", np.array(rungs["arm"].change), seeds=3)
    arm.found["1"][0]["on_bound"] = ["rotor_inertia"]
    arm.found["2"][1]["parameters"]["bristle_stiffness"] = 9000.0
    arm.found["3"][1]["parameters"]["bristle_stiffness"] = 9000.0
    arm.found["3"][1]["loss"] = 99.0
    f = Findings({**rungs, "arm": arm}, all_cells)
    verdict = {(j, p.name): p.verdict for j in JOINTS for p in f.identified(j)}
    assert verdict[1, "rotor_inertia"] == "no"
    assert verdict[2, "bristle_stiffness"] == "no"
    assert verdict[3, "bristle_stiffness"] == "yes"
    page = text(page_limits.identification(f))
    assert "0.240 [0.240, 0.245] †" in page
    assert "1500 [1500, 9000] ‡" in page
    assert "rotor inertia of joint 1 and bristles σ0 of joint 2" in page
    assert "| 2 of 3 |" in page
    alone = {k: v for k, v in rungs.items() if not k.startswith("arm")}
    assert "cannot be told" in text(page_limits.identification(Findings(alone, all_cells)))


def test_targets_are_judged(findings, rungs, all_cells):
    perfect = Findings(changed(rungs, **{"arm + drift": findings.measured}), all_cells)
    page = text(page_limits.remains(perfect))
    assert page.count("| met |") == 4
    assert "Nothing is left." in page
    poor = Findings(changed(rungs, **{"arm + drift": np.zeros(len(all_cells))}), all_cells)
    assert text(page_limits.remains(poor)).count("**not met**") == 4


def test_shares_of_the_residual(rungs, all_cells):
    """A base that is off is constant per configuration; an error at one frequency is not."""
    held = [c.held_out for c in all_cells]
    shift = np.array([0.1 if c.row.direction == "+" else -0.05 for c in all_cells])
    measured = np.array([c.change for c in all_cells])
    f = Findings(changed(rungs, **{"arm + drift": measured + shift}), all_cells)
    np.testing.assert_allclose(f.shares(1), [1, 0, 0], atol=1e-9)
    assert "Base torques repeated" in text(page_limits.remains(f))
    rng = np.random.default_rng(0)
    noise = np.where(held, 0.05 * rng.normal(size=len(held)), 0.0)
    f = Findings(changed(rungs, **{"arm + drift": measured + noise}), all_cells)
    shares = np.array([f.shares(j) for j in JOINTS])
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    assert shares[:, 2].mean() > 0.5


# ---- the iiwa's phase, simulated -----------------------------------------------------------------


def test_at_nyquist_only_phase_decides():
    """At φ = 0 every sample of 100 Hz at 200 Hz is zero: no dither, to the last bit."""
    row = next(r for r in thesis_dithered("iiwa7") if r.load == "no_load")
    study = study_phase(rows=[row])
    assert study.change.shape == (1, PHASES)
    assert study.controller_rate_hz == 200
    assert study.change[0, 0] == 0.0
    assert study.change[0, -1] < -0.02
    assert study.spread_by_phase[0] == np.ptp(study.change)
    assert study.measured[0] == pytest.approx(row.change_pct / 100, abs=1e-3)
    assert study.over_random_phase[0] == pytest.approx(study.change.mean(), abs=0.01)


# ---- words ---------------------------------------------------------------------------------------


def test_words():
    assert [words.signed(x) for x in (-0.04, 0.04, -1.25, float("nan"))] == [
        "0.0",
        "0.0",
        "−1.2",
        "–",
    ]
    assert [words.short(x) for x in (12345.6, 0.00123456, 0.0)] == ["12346", "0.00123", "0"]
    assert words.span([0.21, 0.2, 0.7]) == "0.20 to 0.70"
    assert words.span([38.01, 38.02]) == "38"
    assert words.listed([1, 2, 3]) == "1, 2 and 3"
    assert [words.joints(x) for x in ([], [1], [1, 2])] == ["no joint", "joint 1", "joints 1 and 2"]
