"""The page of the nested models: its numbers are the models', and its words fit those shipped."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.gap.tables.cells import cells, score
from stiction_envs.measured import thesis_dithered
from stiction_envs.reporting.json_text import plain
from stiction_envs.reporting.templates import render
from stiction_envs.thesis.nested_models import NestedModel
from stiction_envs.thesis.nyquist_phase import PHASES, study_phase
from stiction_envs.thesis.page import FILES, TEMPLATES, write_page
from stiction_envs.thesis.page_numbers import FLAT, LOPSIDED, SHAKEN, SLOW, iiwa, numbers
from stiction_envs.thesis.scores import FREQUENCIES, JOINTS, ModelScores
from tests.thesis.made_up import made_up, nested_model, phase_study

SHIPPED = Path(__file__).parents[2] / "benchmarks" / "thesis_ladder"
FIXED = (
    r"Tables? 4\.\d+(?:, 4\.\d+)*(?: and 4\.\d+)?",
    r"[Jj]oints? \d(?:, \d)*(?: (?:and|to) \d)?",
    r"[\w*]*\]?\((?:joint_\d|iiwa|ladder|residuals)\.(?:png|md)\)",
    r"(?:Lund|Dupont) 20\d\d|\(thesis \d\.\d\)|physics\.md \d\.\d|friction/iiwa7\.toml",
    r"95 % bootstrap|scale 1\.0|0\.15 rad|150 mrad|to 2 points|0\.3 of the friction|φ = 0|1/f²",
    r"(?:15|30|80|100|200) Hz",
    r"(?m)^\d\. ",
)
"""What the thesis, the protocol and the method set, and no run can change."""


@pytest.fixture(scope="module")
def all_cells():
    return cells()


@pytest.fixture(scope="module")
def models(all_cells):
    return made_up(all_cells)


@pytest.fixture(scope="module")
def scores(models, all_cells):
    return ModelScores(models, all_cells)


@pytest.fixture(scope="module")
def written(models, tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    return folder, write_page(folder, models, study=phase_study())


@pytest.fixture(scope="module")
def shipped(all_cells):
    saved = json.loads((SHIPPED / "ladder.json").read_text("utf-8"))["rungs"]
    return ModelScores({m["key"]: NestedModel(**m) for m in saved}, all_cells)


@pytest.fixture(scope="module")
def found(shipped):
    return numbers(shipped, phase_study())


def changed(models, **changes):
    """Return models with other predictions."""
    return {
        **models,
        **{
            k: dataclasses.replace(models[k], change=list(map(float, v)))
            for k, v in changes.items()
        },
    }


def numbers_of(models, all_cells):
    return numbers(ModelScores(models, all_cells), phase_study())


def parts(page: str) -> dict[str, str]:
    """Return a page by its headings."""
    return {p.partition("\n")[0]: p for p in re.split(r"(?m)^## ", page)}


# ---- the whole -----------------------------------------------------------------------------------


def test_all_files_are_written(written):
    folder, _ = written
    assert {p.name for p in folder.iterdir()} == set(FILES)
    for file in folder.glob("*.png"):
        assert file.read_bytes().startswith(b"\x89PNG")
    page = (folder / "gap.md").read_text(encoding="utf-8")
    for name in FILES[1:]:
        assert f"({name})" in page
    assert not re.search(r"\b(nan|inf|None)\b|array\(", page)


def test_summary_is_json_and_repeats_the_scores(written, models, all_cells):
    _, summary = written
    summary = json.loads(json.dumps(plain(summary), allow_nan=False))
    assert [m["key"] for m in summary["models"]] == list(models)
    for m in summary["models"]:
        mine = score("", all_cells, np.array(models[m["key"]].change))
        assert (m["mean"], m["median"]) == (mine.mean, mine.median)
    assert summary["targets"]["mean"]["reached"] == summary["models"][-1]["mean"]
    assert {c["name"] for c in summary["causes"]} >= {"inertia", "presliding"}


def test_table_holds_every_model_with_its_numbers(written, scores, models):
    lines = (written[0] / "ladder.md").read_text("utf-8").splitlines()
    for key, m in models.items():
        s = scores.scores[key]
        row = next(x for x in lines if x.startswith(f"| {m.name} | {s.mean:.1f} ["))
        values = [f"{x:.1f}" for x in (*s.by_column.values(), *s.by_joint.values())]
        assert row.endswith(" | ".join(values) + " |")
    broken = next(x for x in lines if x.startswith("- Table 4.7, joint 2"))
    assert "94 % (dither does nothing)" in broken


def test_tables_have_as_many_cells_as_their_heads(written):
    for name in ("gap.md", "ladder.md"):
        text = (written[0] / name).read_text("utf-8")
        tables = re.findall(r"(?m)(?:^\|.*\|$\n?)+", text)
        assert len(tables) == {"gap.md": 18, "ladder.md": 2}[name]
        for table in tables:
            assert len({line.count("|") for line in table.splitlines()}) == 1, table


def test_bad_models(tmp_path, models):
    study = phase_study()
    with pytest.raises(StictionError, match="needs all nested models: nothing, lookup, band"):
        write_page(tmp_path, {}, study=study)
    part = {k: m for k, m in models.items() if k != "arm"}
    with pytest.raises(StictionError, match="models: arm not fitted"):
        write_page(tmp_path, part, study=study)
    short = dataclasses.replace(models["nothing"], change=[0.0])
    with pytest.raises(StictionError, match="1 cells, but there are 308"):
        write_page(tmp_path, {**models, "nothing": short}, study=study)
    assert list(tmp_path.iterdir()) == []


# ---- what is shipped -----------------------------------------------------------------------------


def test_shipped_page_is_what_the_shipped_models_give(found):
    """All but the part on the iiwa, which is simulated below."""
    for name in ("gap.md", "ladder.md"):
        now = parts(render(TEMPLATES / f"{name}.j2", **found))
        kept = parts((SHIPPED / name).read_text("utf-8"))
        assert list(now) == list(kept)
        assert [k for k in now if now[k] != kept[k] and "iiwa" not in k] == []


@pytest.mark.slow
def test_shipped_page_on_the_iiwa_is_what_the_plant_gives(shipped):
    study = study_phase()
    title = "Why the iiwa's trials at 100 Hz are erratic"
    now = parts(render(TEMPLATES / "gap.md.j2", **numbers(shipped, study)))
    kept = parts((SHIPPED / "gap.md").read_text("utf-8"))
    assert now[title] == kept[title]
    assert study.change[:, 0].tolist() == [0.0] * len(study.rows)
    assert study.simulated_range[1] < 5e-4
    assert study.measured.max() > 0.1


def test_every_number_in_the_words_is_a_variable():
    text = (TEMPLATES / "gap.md.j2").read_text("utf-8")
    text = re.sub(r"\{#.*?#\}|\{\{.*?\}\}|\{%.*?%\}", "", text, flags=re.DOTALL)
    for pattern in FIXED:
        text = re.sub(pattern, "", text)
    assert re.findall(r".*\d.*", text) == []


@pytest.mark.parametrize(
    ("joint", "causes", "worse"),
    [
        (1, {"inertia", "drift"}, {"elasticity", "arm + drift"}),
        (2, {"inertia", "presliding", "offset"}, set()),
        (3, {"inertia", "presliding", "elasticity", "offset", "drift"}, {"load"}),
        (4, {"inertia", "presliding"}, set()),
        (5, {"inertia", "offset", "drift"}, {"load"}),
        (6, {"inertia"}, set()),
        (7, {"inertia", "presliding", "elasticity", "drift"}, set()),
    ],
)
def test_causes_that_the_words_name(shipped, joint, causes, worse):
    gains = shipped.gains(joint)
    assert {g.key for g in gains if g.named} == causes
    assert {g.key for g in gains if g.worse} == worse


def test_claims_about_single_joints(found):
    j = found["j"]
    assert j[1]["now"] > j[1]["constant"]
    assert all(j[n]["now"] < j[n]["constant"] for n in (2, 5, 7))
    assert j[2]["taken"][0] > 3 * j[2]["taken"][1] > 0
    for n in (3, 5):
        low, high = sorted(j[n]["taken"])
        assert 0 < high < 1.5 * low
    assert (j[3]["dithered"] > 0).all()
    assert FREQUENCIES[int(np.argmin(j[3]["change"][0]))] == 30.0
    assert abs(j[3]["resonance"][0] - 30) < 5
    assert abs(max(j[3]["rotor_resonance"]) - 30) < 5
    assert j[4]["error"]["presliding"] < 0.5 * j[4]["error"]["inertia"]
    assert j[6]["arrives"].max() < 0.5
    assert j[7]["resonance"][1] > 1
    assert abs(j[7]["resonance"][0] - 15) < 5
    assert [n for n in JOINTS if j[n]["elastic"]] == list(FLAT)
    assert [n for n in JOINTS if j[n]["shaken"].min() > 1 and n in FLAT] == list(SHAKEN)


def test_claims_about_band_and_frequency(found):
    """Whose torque 15 Hz lowers 1.5 times as much as any other frequency, and why."""
    ratio = dict(
        zip((*SLOW, *FLAT), found["slow"]["measured"] + found["flat"]["measured"], strict=True)
    )
    assert sorted(n for n in ratio if ratio[n] >= 1.5) == list(SLOW)
    assert min(found["slow"]["predicted"]) >= 1.5
    assert min(found["slow"]["rotor"]) > 70
    assert max(found["slow"]["arrives"][80.0]) < 0.1
    assert found["flat"]["most"] < 0.5
    assert found["springs"][1] < found["springs"][0]
    inside, total = found["averaging"]
    assert inside > 0.9 * total
    assert found["creep"]["gap"] < 2.0
    assert -20 < found["mean_change"]["measured"] < 0
    assert found["mean_change"]["band"] == pytest.approx(-100, abs=1)


def test_claims_about_asymmetry(found):
    lopsided = [n for n, x in found["j"].items() if abs(x["offset"][0]) >= 0.3 * x["friction"][0]]
    assert lopsided == list(LOPSIDED)
    assert all(np.diff(np.abs(found["j"][n]["offset"])) < 0 for n in LOPSIDED)
    assert found["model"]["offset"].mean < found["model"]["load"].mean
    assert found["taken"]["offset"] < found["taken"]["load"]


def test_claims_about_the_fit(found):
    verdict = {(n, p.name): p.verdict for n in JOINTS for p in found["j"][n]["found"].values()}
    assert set(verdict.values()) == {"yes", "no"}
    assert [name for (n, name), v in verdict.items() if n == 1 and v == "yes"] == ["coulomb_ratio"]
    open_ = [n for n in JOINTS if verdict[n, "bristle_stiffness"] == "no"]
    assert open_ == list(FLAT)
    ramp = found["ramp"]
    rates = [x["rate"] for x in ramp["rows"]]
    assert ramp["best"] in (rates[0], rates[-1])
    assert not any(x["worse"] for x in ramp["rows"])
    assert ramp["reach"] < 0.3
    means = [found["model"][k].mean for k in ("elasto-plastic", "drift")]
    assert abs(means[0] - means[1]) < 0.3
    gap, error = found["plastic"]
    assert gap > error
    assert found["residual"]["parts"][0] > 30
    assert found["residual"]["first_four"] > 75


# ---- numbers -------------------------------------------------------------------------------------


def test_a_cause_is_named_where_it_helps_and_only_there(models, all_cells):
    """Presliding helps joint 7 alone, and spoils joint 5."""
    joint = np.array([c.row.joint for c in all_cells])
    measured = np.array([c.change for c in all_cells])
    before = np.array(models["inertia"].change)
    after = np.where(joint == 7, measured, before)
    after = np.where(joint == 5, before + 0.05, after)
    x = numbers_of(changed(models, presliding=after), all_cells)["j"]
    assert [j for j in JOINTS if "presliding" in [g.key for g in x[j]["causes"]]] == [7]
    gain = next(g for g in x[7]["causes"] if g.key == "presliding")
    assert gain.plain.after == pytest.approx(0.0)
    assert [g.key for g in x[5]["statements"] if g.worse] == ["presliding"]


def test_gain_by_shape_sees_through_a_base_that_moved(models, all_cells):
    """A model that gets the shape right on a base that is off is named all the same."""
    measured = np.array([c.change for c in all_cells])
    steady = np.where([c.held_out for c in all_cells], 0.9 * (1 + 0.5 * measured) - 1, -0.1)
    right = 0.85 * (1 + measured) - 1
    f = ModelScores(changed(models, path=steady, elasticity=right), all_cells)
    gain = next(g for g in f.gains(7) if g.key == "elasticity")
    assert gain.shape is not None
    assert gain.shape.after == pytest.approx(0.0, abs=1e-9)
    assert gain.shape.better


def test_constant_is_the_median_change_of_the_configuration(scores, all_cells):
    """Of Table 4.6, asked for the cells held out; the models have no part in it."""
    first: dict[object, list[float]] = {}
    for c in all_cells:
        if not c.held_out:
            first.setdefault(c.configuration, []).append(c.change)
    errors = [
        100 * abs(float(np.median(first[c.configuration])) - c.change)
        for c in all_cells
        if c.held_out and not c.row.outlier and c.row.joint == 7
    ]
    assert scores.constant(7) == pytest.approx(np.mean(errors))


def test_frequencies_of_the_measured_means(scores):
    """Read off Table 4.6: joint 7 has −35.3 % at 15 Hz and at best −9.4 % elsewhere."""
    x = numbers(scores, phase_study())
    np.testing.assert_allclose(x["j"][7]["change"][0], [-2.3, -4.4, -9.4, -35.3], atol=0.05)
    assert x["slow"]["measured"][-1] == pytest.approx(35.3 / 9.4, rel=0.01)
    assert x["flat"]["spread"].max() == pytest.approx(-3.1 + 14.9, abs=0.1)


def test_final_dither_of_a_perfect_model(models, all_cells):
    measured = [c.change for c in all_cells]
    x = numbers_of(changed(models, offset=measured, load=np.zeros(len(measured))), all_cells)
    for row in x["taken"]["rows"]:
        assert row["offset"] == pytest.approx(row["taken"], abs=2e-3)  # printed to four figures
        assert row["load"] == 0.0
    assert x["j"][2]["taken"] == [r["taken"] for r in x["taken"]["rows"][:2]]
    assert [r["place"] for r in x["taken"]["rows"][:2]] == ["2 load +", "2 load −"]


def test_iiwa_counts_and_shifts():
    x = iiwa(phase_study())
    assert (x["up"], x["cells"]) == (4, 8)
    assert x["shifts"][2, "load"] == pytest.approx((0.080, 0.125), abs=5e-4)
    assert (x["low"], x["high"]) == pytest.approx((-5.0, 0.0))


def test_ramp_rates(models, all_cells):
    """0.12 fits as well as 0.07 to the joints' scatter, 0.04 does not; 0.07 is the protocol's."""
    f = ModelScores(models, all_cells)
    assert f.ramp_rates() == {0.04: "ramp 0.04", 0.07: "drift", 0.12: "ramp 0.12"}
    gap, error = f.preferred("drift", "ramp 0.04")
    assert (gap, error) == (pytest.approx(30.0), pytest.approx(0.0))
    assert f.preferred("ramp 0.04", "drift")[0] == pytest.approx(-30.0)
    ramp = numbers(f, phase_study())["ramp"]
    assert ramp["best"] == 0.07
    assert {x["rate"]: x["worse"] for x in ramp["rows"]} == {0.04: True, 0.07: False, 0.12: False}
    assert [x["over"] for x in ramp["rows"]] == pytest.approx([30.0, 0.0, 1.0])


def test_identification_marks(models, all_cells):
    """One parameter on its bound, one that the seeds do not agree on; a worse seed is no vote."""
    arm = nested_model("arm", np.array(models["arm"].change), seeds=3)
    arm.found["1"][0]["on_bound"] = ["rotor_inertia"]
    arm.found["2"][1]["parameters"]["bristle_stiffness"] = 9000.0
    arm.found["3"][1]["parameters"]["bristle_stiffness"] = 9000.0
    arm.found["3"][1]["loss"] = 99.0
    x = numbers_of({**models, "arm": arm}, all_cells)
    verdict = {(j, p.name): p.verdict for j in JOINTS for p in x["j"][j]["found"].values()}
    assert verdict[1, "rotor_inertia"] == "no"
    assert verdict[2, "bristle_stiffness"] == "no"
    assert verdict[3, "bristle_stiffness"] == "yes"
    assert x["parameters"] - x["identified"] == 2
    table = parts(render(TEMPLATES / "gap.md.j2", **x))["What was identified, and what cannot be"]
    assert "| 0.240 [0.240, 0.245] † |" in table
    assert "| 1500 [1500, 9000] ‡ |" in table
    assert "| 2 of 3 |" in table


def test_targets_are_judged(models, all_cells):
    def met(change) -> list[bool]:
        x = numbers_of(changed(models, **{"arm + drift": change}), all_cells)
        return [reached <= aim for reached, aim in x["targets"].values()]

    assert met([c.change for c in all_cells]) == [True] * 4
    assert met(np.zeros(len(all_cells))) == [False] * 4


def test_shares_of_the_residual(models, all_cells):
    """A base that is off is constant per configuration; an error at one frequency is not."""
    held = [c.held_out for c in all_cells]
    shift = np.array([0.1 if c.row.direction == "+" else -0.05 for c in all_cells])
    measured = np.array([c.change for c in all_cells])
    f = ModelScores(changed(models, **{"arm + drift": measured + shift}), all_cells)
    np.testing.assert_allclose(f.shares(1), [1, 0, 0], atol=1e-9)
    x = numbers(f, phase_study())["residual"]
    np.testing.assert_allclose(x["parts"], [100, 0, 0], atol=1e-6)
    assert [w["points"] for w in x["worst"][:2]] == pytest.approx([10, 10])
    rng = np.random.default_rng(0)
    noise = np.where(held, 0.05 * rng.normal(size=len(held)), 0.0)
    f = ModelScores(changed(models, **{"arm + drift": measured + noise}), all_cells)
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
