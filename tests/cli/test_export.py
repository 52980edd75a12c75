"""Models that `stiction export` writes stick in stock MuJoCo; ``stiction conformance``."""

import json

import mujoco
import numpy as np
import pytest

from stiction_envs.experiments.conformance import conformance
from stiction_envs.experiments.conformance_report import ConformanceSettings
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import (
    QUANTITIES,
    dump_friction,
    load_friction,
)
from stiction_envs.robots import load_arm
from stiction_envs.robots.registry import in_folder
from stiction_envs.robots.stated import STICTION
from tests.command_line import csv_rows
from tests.experiments.test_conformance import lugre, stock
from tests.friction.gyro import differences


def test_equals_our_model(cli):
    options = ["--payload", 1.3, 0, 0.01, 0.05, "--tilt", 0.1, -0.2]
    ran = cli("export", "panda", "--out", "a", "--json", *options)
    assert ran.code == 0
    arm = load_arm("panda", payload=(1.3, 0, 0.01, 0.05), tilt=(0.1, -0.2))
    ours = build(arm, load_friction("panda"))
    model = mujoco.MjModel.from_xml_path("a/model.xml")
    assert max(differences(model, ours).values()) <= 1e-9
    assert model.nu == arm.n
    np.testing.assert_array_equal(model.actuator_ctrlrange[:, 1], arm.limits.torque)
    said = [j["stiction_nm"] for j in json.loads(ran.out)["joints"]]
    np.testing.assert_array_equal(said, model.actuator_biasprm[:, STICTION])


def test_friction_from_a_folder(cli, inputs):
    p = load_friction("panda")
    stickier = p.replace(stiction=2 * p.stiction, load_coefficient=0 * p.load_coefficient)
    sources = dict.fromkeys(QUANTITIES, "a test")
    text = dump_friction(stickier, sources=sources, meta={}, provenance={})
    (inputs / "model.toml").write_text(text, encoding="utf-8")
    ran = cli("export", "panda", "--from", inputs, "--out", "a", "--json")
    assert ran.code == 0
    said = [j["stiction_nm"] for j in json.loads(ran.out)["joints"]]
    np.testing.assert_allclose(said, 2 * p.stiction.mean(axis=1))


# ---- kinds of friction, engines, and what lies beside the model ----------------------------------


def test_the_folder_is_laid_out_as_in_menagerie(cli, work):
    """The scene loads in stock MuJoCo, and a folder is the model that its scene includes."""
    assert cli("export", "panda", "--out", "a").code == 0
    scene = mujoco.MjModel.from_xml_path("a/scene.xml")
    model = mujoco.MjModel.from_xml_path("a/model.xml")
    assert (scene.nu, scene.nq, scene.nkey) == (model.nu, model.nq, model.nkey)
    assert scene.ngeom == model.ngeom + 1
    assert in_folder(work / "a") == work / "a" / "model.xml"
    comment = (work / "a" / "model.xml").read_text("utf-8").split("-->")[0]
    assert all(x in comment for x in ("torque offsets", "direction", "on load", "Euler"))
    readme = (work / "a" / "README.md").read_text("utf-8")
    assert "Gaz, Cognetti" in readme
    assert "stiction: calibrated: `stiction calibrate` on table_4_3.csv" in readme
    assert "friction panda.toml as `dcmotor`" in (work / "a" / "CHANGELOG.md").read_text("utf-8")
    assert json.loads((work / "a" / "provenance.json").read_text())["files"] == [
        *("CHANGELOG.md", "README.md", "model.xml", "scene.xml"),
    ]


@pytest.mark.parametrize(
    ("options", "kind", "has"),
    [
        (["--friction", "dcmotor"], "dcmotor", 'input="ff"'),
        (["--friction", "frictionloss"], "frictionloss", "solreffriction"),
        (["--engine", "newton"], "dcmotor", 'input="voltage"'),
        (["--engine", "mjx"], "frictionloss", "noslip_iterations"),
        (["--engine", "warp", "--friction", "frictionloss"], "frictionloss", "solimpfriction"),
    ],
)
def test_kinds_and_engines(cli, two, work, options, kind, has):
    ran = cli("export", two, *options, "--out", "a", "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["kind"] == kind
    assert has in (work / "a" / "model.xml").read_text("utf-8")
    assert mujoco.MjModel.from_xml_path("a/scene.xml").nu == 2


SHORT = ConformanceSettings(hold_time=4.0, watched_time=1.0, rise_time=2.0)


def test_exported_frictionloss_does_not_creep_in_mujoco(cli, two):
    """By noslip; without it the hardest settings still creep, a hundredth of the default's."""
    assert cli("export", two, "--friction", "frictionloss", "--out", "a").code == 0
    assert conformance("a/model.xml", settings=SHORT, rates=()).passed
    creep = []
    for solver in ("hardest", "default"):
        model = mujoco.MjModel.from_xml_path("a/model.xml")
        model.opt.noslip_iterations = 0
        if solver == "default":
            stock = mujoco.MjModel.from_xml_string(
                "<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>"
            )
            model.dof_solref[:], model.dof_solimp[:] = stock.dof_solref[0], stock.dof_solimp[0]
        joints = conformance(model, settings=SHORT, rates=()).joints
        creep.append(min(j.creep for j in joints))
    assert 1e-8 < creep[0] < 1e-2 * creep[1]


# ---- conformance ---------------------------------------------------------------------------------


def test_a_model_that_sticks_and_one_that_creeps(cli, work, inputs):
    good, bad = inputs / "good.xml", inputs / "bad.xml"
    good.write_text(lugre("2000 12 0.5 0.6 0.003"))
    bad.write_text(stock())
    ran = cli("conformance", good)
    assert ran.code == 0
    assert "1 of 1 joints stick" in ran.out
    assert ran.out.endswith("written to runs/conformance-good: conformance.csv\n")
    (row,) = csv_rows(work / "runs/conformance-good/conformance.csv")
    assert (row["holds"], row["goes"], row["stiction_nm"]) == ("yes", "yes", "0.6")

    ran = cli("conformance", bad, "--json", "--out", "bad")
    assert ran.code == 1
    assert not json.loads(ran.out)["rows"][0]["holds"]
    note = "note: bad: taken from the file: dry friction 0.3 N·m"
    assert ran.lines == [note, "error: does not stick as it should: j"]
    found = json.loads((work / "bad" / "provenance.json").read_text())
    assert found["files"] == ["conformance.csv"]
    assert "robot" in found["inputs"]


@pytest.mark.usefixtures("two")
@pytest.mark.parametrize(
    "robot", ["{two.xml}", *(pytest.param(x, marks=pytest.mark.slow) for x in ("panda", "iiwa7"))]
)
def test_an_exported_arm_sticks(cli, robot):
    assert cli("export", robot, "--out", "model").code == 0
    assert conformance("model/model.xml", rates=()).passed
