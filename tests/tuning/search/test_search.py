"""The whole search on a small arm: its result, its files, and how it continues."""

import pytest

from stiction_envs.control.compensation_files import read_compensation
from stiction_envs.measured.tables import read_amplitudes, read_sje
from tests.command_line import csv_rows
from tests.refusal import refusal
from tuning.names import TREATMENTS
from tuning.search.search import search
from tuning.search.stages import Options

QUICK = {"search.draws": 1, "search.verify_draws": 2, "search.verify_iterations": 1}


@pytest.fixture
def small(small_arm, fast, tmp_path):
    def run(out, **options):
        options = {"sampler": "tpe", "evaluations": 6, "settings": QUICK, **options}
        return search(small_arm, out=tmp_path / out, protocol=fast, **options)

    return run


def test_what_is_found_keeps_the_limit_and_beats_no_dither(small, tmp_path):
    found = small("out", sampler="random", evaluations=12)
    folder = tmp_path / "out"
    assert read_amplitudes(folder / "final.csv", n_joints=2) == list(found.final)
    trials = csv_rows(folder / "trials.csv")
    assert len(trials) == 24
    for row in found.final:
        mine = [t for t in trials if t["joint"] == str(row.joint) and t["allowed"] == "1"]
        best = min(mine, key=lambda t: float(t["value_0"]))
        assert float(best["amplitude_nm"]) == row.amplitude_nm
        assert float(best["left"]) < 1.0
    verified = read_sje(folder / "verification.csv")
    assert {r.joint for r in verified} == {1, 2}
    assert found.summary["mean_reduction_percent"] > 0
    for name in ("report.md", "landscape.png"):
        assert (folder / name).exists()


@pytest.mark.slow
def test_stopped_anywhere_it_ends_with_the_same_files(small, tmp_path):
    class Stop(Exception):
        pass

    whole = small("whole")
    for after in (2, 4):
        calls = 0

        def stop(stage, done, total, after=after):
            nonlocal calls
            calls += stage in ("sje", "verification")
            if calls > after:
                raise Stop

        with pytest.raises(Stop):
            small("parts", progress=stop)
    parts = small("parts")
    assert parts.final == whole.final
    for name in ("trials.csv", "final.csv", "verification.csv", "comparison.csv", "report.md"):
        one, other = (tmp_path / part / name for part in ("whole", "parts"))
        assert one.read_bytes() == other.read_bytes(), name


def test_two_objectives_make_a_front(small, tmp_path):
    small("out", pareto=True, sampler="random", evaluations=8)
    front = csv_rows(tmp_path / "out" / "pareto.csv")
    assert front
    for one in front:
        same = [r for r in front if r["study"] == one["study"]]
        assert float(one["value_1"]) == pytest.approx(float(one["displacement_rad"]))
        assert not any(
            float(r["value_0"]) < float(one["value_0"])
            and float(r["value_1"]) <= float(one["value_1"])
            for r in same
        )


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"objective": "speed"}, "objective"),
        ({"sampler": "annealing"}, "sampler"),
        ({"evaluations": 0}, "from 1"),
        ({"sampler": "cmaes", "pareto": True}, "two objectives"),
        ({"sampler": "grid", "objective": "gte"}, "objective sje"),
        ({"objective": "gte", "treatment": "pull"}, "'pull': expected one of dither"),
        ({"treatment": "push", "objective": "sje"}, "expected objective gte"),
    ],
)
def test_options_that_cannot_be_are_one_clear_line(options, what):
    refusal(lambda: Options(**options), what)


@pytest.mark.slow
def test_treatments_are_compared_under_the_same_limits(small, tmp_path):
    """Each has its study and budget; the best that does not shake at rest is written."""
    found = small("out", treatment="observer", evaluations=2)
    folder = tmp_path / "out"
    trials = csv_rows(folder / "trials.csv")
    studies = {row["study"] for row in trials}
    assert len(trials) == 2 * len(TREATMENTS["observer"]) == 2 * len(studies)
    compared = csv_rows(folder / "comparison.csv")
    rest = {
        (r["table"], r["where"]): float(r["value"])
        for r in compared
        if r["measure"] == "vibration_at_rest_m"
    }
    # this arm can follow no random path
    assert {where for _, where in rest} == {"triangle", "pentagon"}
    winner = found.summary["treatment"]
    text = (folder / "report.md").read_text()
    assert all(f"{name}, searched" in text for name in TREATMENTS["observer"])
    if winner["name"] != "no dither":
        for where in ("triangle", "pentagon"):
            assert rest[winner["name"], where] <= rest["no dither", where] + 2e-5
        assert winner["left_percent"] < 100.0
        kind = winner["name"].split(",")[0]
        c = read_compensation(folder / "final.yaml", None, 2)
        assert c == read_compensation(folder / "compensation.csv", kind, 2)
