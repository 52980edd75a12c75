"""The library as a user calls it: five lines from a log to a dither, and what each can save."""

from __future__ import annotations

import ast
import json
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

import stiction_envs as st
from stiction_envs.cli import main
from stiction_envs.experiments.sje.protocol import load_protocol
from stiction_envs.measured.tables import SJERow, read_amplitudes, read_base, read_sje, write_sje
from stiction_envs.reporting.result import Result
from tests.gap.small_logs import hidden, sticky, write_csv
from tests.robots.arms import TWO

FAST = load_protocol("two").replace(ramp_rate=1.0, iterations=1, return_time=0.2)
WRITTEN = {"diagnosis.json", "model.xml", "model.toml", "report.md", "report.html"}
"""Files of a diagnosis that a user opens."""


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder with the model of a two-joint arm and a log of it that has friction."""
    folder = tmp_path_factory.mktemp("facade")
    (folder / "two.xml").write_text(TWO)
    write_csv(folder / "log.csv", hidden(st.load_arm(folder / "two.xml"), sticky, seconds=8.0))
    return folder


@pytest.fixture(scope="module")
def diagnosed(place):
    d = st.diagnose(str(place / "log.csv"), robot=place / "two.xml", torque="link")
    d.save(place / "why")
    return d


@pytest.fixture(scope="module")
def arm(place, diagnosed):
    return st.load_model(place / "why" / "model.toml", place / "two.xml")


@pytest.fixture(scope="module")
def base(place, arm):
    found = st.SingleJointExperiment(arm, protocol=FAST).base_torques()
    found.save(place / "base")
    return found


@pytest.fixture(scope="module")
def table(place) -> Path:
    """An SJE table that says too little for a verdict, so that nothing is simulated."""
    path = place / "sje.csv"
    rows = []
    for load in ("load", "no_load"):
        for direction, sign in (("+", 1), ("-", -1)):
            where = ("two", 1, load, direction)
            rows.append(SJERow(*where, 0.0, 0.0, sign * 0.8, 0.01, 4, 0.0))
            rows.append(SJERow(*where, 15.0, 0.8, sign * 0.6, 0.01, 4, 0.25))
    write_sje(path, rows)
    return path


def files(folder: Path) -> dict[str, bytes]:
    """Return all files of a folder but for the provenance."""
    found = {p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file()}
    return {k: p.read_bytes() for k, p in found.items() if k != "provenance.json"}


# ---- names ---------------------------------------------------------------------------------------


def test_every_name_is_there():
    assert set(st.__all__) <= set(dir(st))
    assert all(getattr(st, name) is not None for name in st.__all__)
    public = {n for n in dir(st) if not n.startswith("_")}
    modules = {n for n in public if type(getattr(st, n)).__name__ == "module"}
    assert public - modules - set(st.__all__) == {"import_module", "register_all", "TYPE_CHECKING"}
    with pytest.raises(AttributeError, match="no attribute 'diagnoze'"):
        st.diagnoze  # noqa: B018


def test_editors_see_the_names_that_are_handed_out():
    """The block for type checkers imports each name from where `__getattr__` finds it."""
    points = entry_points(group="stiction_envs.api")
    tree = ast.parse(Path(st.__file__).read_text("utf-8"))
    (block,) = (n for n in tree.body if isinstance(n, ast.If))
    typed = {a.name: x.module for x in block.body for a in x.names}
    assert typed == st._HOME | {p.name: p.load().__module__ for p in points}
    assert set(typed) | {"__version__"} == set(st.__all__)


# ---- five lines ----------------------------------------------------------------------------------


def test_a_diagnosis_prints_its_verdict_and_its_causes(diagnosed):
    text = str(diagnosed)
    assert text.startswith("explained: ")
    rows = [line for line in text.splitlines() if " %  " in line]
    assert [line.split()[2] for line in rows] == [c.name for c in diagnosed.causes]
    assert {"coulomb_friction", "viscous_friction"} <= {c.name for c in diagnosed.causes}


def test_a_diagnosis_saves_what_the_command_writes(place, diagnosed, capsys):
    out = place / "command"
    options = ["--robot", str(place / "two.xml"), "--torque", "link", "--out", str(out)]
    assert main(["diagnose", str(place / "log.csv"), *options]) == 0
    assert capsys.readouterr().out.startswith(str(diagnosed))
    assert files(out) == files(place / "why")
    assert set(files(out)) >= WRITTEN
    made = [(x / "provenance.json").read_text() for x in (out, place / "why")]
    assert made[0] == made[1]


def test_an_experiment_takes_a_diagnosed_arm_with_its_friction(arm, base, place):
    """A joint breaks away where the log says: 0.5 N·m dry, and what the ramp gains on the way."""
    assert arm.n == 2
    np.testing.assert_allclose(
        arm.parameters.stiction * arm.parameters.coulomb_ratio, 0.5, atol=0.03
    )
    rows = read_sje(place / "base" / "base.csv")
    assert [r.tau_nm for r in rows] == [r.tau_nm for r in base.rows]
    assert len(rows) == 8
    assert all(r.is_base and 0.5 < abs(r.tau_nm) < 1.6 for r in rows)
    np.testing.assert_array_equal(read_base(place / "base" / "base.csv", "two", 2).tau, base.tau)
    assert base.base.n_joints == 2


def test_one_arm_by_name_file_arm_and_model(place):
    """However it is named, it is the same experiment."""
    own = place / "two.xml"
    loaded = st.load_arm(own)
    model = st.SingleJointExperiment(own).sticking
    tau = [
        st.SingleJointExperiment(x, protocol=FAST).base_torques().tau
        for x in (own, str(own), loaded, model)
    ]
    for other in tau[1:]:
        np.testing.assert_array_equal(other, tau[0])
    bench = st.GeneratedTrajectoryExperiment(model)
    assert bench.sticking is model
    assert st.SingleJointExperiment("panda").sticking.arm.name == "panda"


@pytest.mark.slow
def test_the_base_torques_are_tuned_to(place, base):
    files_of = {"table": place / "base" / "base.csv", "out": place / "tuned"}
    settings = {"frequencies": [15.0], "scales": [1.0], "protocol": FAST}
    found = st.tune(place / "two.xml", **files_of, **settings)
    assert list(found.final) == read_amplitudes(place / "tuned" / "final.csv", n_joints=2)
    assert [row.joint for row in found.final] == [1, 2]
    # the same call goes on, and finds all done
    assert st.tune(place / "two.xml", **files_of, **settings).final == found.final
    found.save(place / "copy")
    assert files(place / "copy") == files(place / "tuned")


# ---- tables --------------------------------------------------------------------------------------


def test_a_table_has_the_same_face(place, table, capsys):
    d = st.diagnose(table, robot=place / "two.xml")
    assert d.verdict == "cannot tell"
    assert d.causes == ()
    assert "1 frequencies and scales" in str(d)
    d.save(place / "table")
    out = place / "table_command"
    assert main(["diagnose", str(table), "--robot", str(place / "two.xml"), "--out", str(out)]) == 0
    assert capsys.readouterr().out.startswith(str(d))
    assert files(out) == files(place / "table")
    assert set(files(out)) >= WRITTEN
    again = st.load_model(out / "model.toml", place / "two.xml")
    shipped = st.SingleJointExperiment(place / "two.xml").sticking
    np.testing.assert_array_equal(again.parameters.stiction, shipped.parameters.stiction)


# ---- results -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def results(place, diagnosed, base, table) -> dict[str, Result]:
    """Return the result of each function."""
    own = place / "two.xml"
    return {
        "diagnose": diagnosed,
        "diagnose a table": st.diagnose(table, robot=own),
        "base_torques": base,
        "identify": st.identify(place / "log.csv", own, torque="link"),
        "check": st.check(place / "log.csv", table, robot=own),
        "conformance": st.conformance(st.SingleJointExperiment(own).sticking, rates=(1.0,)),
    }


def test_every_result_is_short_to_look_at_and_can_be_saved(results, tmp_path):
    for name, result in results.items():
        assert len(repr(result)) < 200, name
        assert "array" not in repr(result), name
        assert "\n" not in repr(result), name
        assert len(str(result).splitlines()) >= 1, name
        if name == "diagnose":
            continue  # see above
        folder = result.save(tmp_path / name)
        made = json.loads((folder / "provenance.json").read_text())
        assert made["finished"], name
        assert made["files"] == sorted(files(folder)), name
        json.dumps(result.to_json(), default=lambda x: x.tolist())
