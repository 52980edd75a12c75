"""Arms: kinematics, limits, sources, self-collision, payload and tilt, and what is refused."""

import re
import tomllib
from importlib.resources import files

import mujoco
import numpy as np
import pytest

from stiction_envs.robots import BUILTIN, load_arm
from tests.refusal import refusal
from tests.robots.arms import flange, states

# sources.md 1.1: a, d, alpha of the modified Denavit-Hartenberg table, m and rad.
PANDA_DH = [
    (0, 0.333, 0),
    (0, 0, -np.pi / 2),
    (0, 0.316, np.pi / 2),
    (0.0825, 0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0, 0, np.pi / 2),
    (0.088, 0, np.pi / 2),
    (0, 0.107, 0),
]
# sources.md 2.1: d1, d3, d5, wrist to flange [m].
IIWA_D = {"iiwa7": (0.34, 0.40, 0.40, 0.126), "iiwa14": (0.36, 0.42, 0.40, 0.126)}
IIWA_ALPHA = np.array([0, 1, -1, -1, 1, 1, -1]) * np.pi / 2
# These alphas (STZ17) turn joints 2, 4, 6 the other way round than the controller and LBRF, where
# positive joint 2 leans forward (+x).
IIWA_SIGN = np.array([1, -1, 1, -1, 1, -1, 1])


def _dh(q: np.ndarray, table: list[tuple[float, float, float]]) -> np.ndarray:
    """Flange pose (4, 4) by Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d)."""
    pose = np.eye(4)
    for theta, (a, d, alpha) in zip([*q, 0.0], table, strict=True):
        (ct, st), (ca, sa) = (np.cos(theta), np.sin(theta)), (np.cos(alpha), np.sin(alpha))
        pose = pose @ np.array(
            [
                [ct, -st, 0, a],
                [st * ca, ct * ca, -sa, -d * sa],
                [st * sa, ct * sa, ca, d * ca],
                [0, 0, 0, 1],
            ]
        )
    return pose


def _iiwa_dh(d1: float, d3: float, d5: float, wrist: float) -> list[tuple[float, float, float]]:
    d = (d1, 0, d3, 0, d5, 0, 0)
    return [*((0, x, alpha) for x, alpha in zip(d, IIWA_ALPHA, strict=True)), (0, wrist, 0)]


@pytest.mark.parametrize(
    ("name", "sign", "table"),
    [
        ("panda", 1, PANDA_DH),
        *((name, IIWA_SIGN, _iiwa_dh(*lengths)) for name, lengths in IIWA_D.items()),
    ],
)
def test_flange_follows_the_dh_table(name, sign, table):
    """The link frames of the iiwas differ (LBRF), joint axes and flange do not."""
    arm = load_arm(name)
    for q in states(arm, 100)[0]:
        np.testing.assert_allclose(flange(arm, q), _dh(sign * q, table), atol=1e-12)
    # joint 2 leans forward
    assert flange(arm, np.array([0, 0.5, 0, 0, 0, 0, 0]))[0, 3] > 0.3


@pytest.mark.parametrize("name", BUILTIN)
def test_builtin_arm_is_bare_and_complete(name):
    arm = load_arm(name)
    model = arm.model()
    assert 2 <= arm.n == model.nq == model.nv <= 9
    assert tuple(model.joint(i).name for i in range(arm.n)) == arm.joint_names
    assert tuple(model.body(int(b)).name for b in model.jnt_bodyid) == arm.link_names
    assert model.nbody == arm.n + 2  # the world and the foot
    assert (model.site(0).name, model.nsite, model.nu, model.nsensor) == (arm.end_effector, 1, 0, 0)
    for passive in (model.dof_armature, model.dof_damping, model.dof_frictionloss):
        assert not passive.any()
    assert not model.jnt_stiffness.any()
    np.testing.assert_array_equal(model.opt.gravity, [0, 0, -9.81])
    assert arm.registered
    assert arm.on_floor
    assert arm.payload is None
    assert arm.tilt == (0.0, 0.0)


@pytest.mark.parametrize("name", BUILTIN)
def test_bare_model_has_the_same_dynamics(name):
    """Without geometry, to the bit: inertia, gravity and velocity terms, tilt and payload too."""
    arm = load_arm(name, payload=(1.5, 0.0, 0.02, 0.1), tilt=(0.1, -0.2))
    model, bare = arm.model(), arm.bare_model()
    assert (bare.ngeom, bare.nq) == (0, arm.n)
    a, b = mujoco.MjData(model), mujoco.MjData(bare)
    for q, dq, _ in zip(*states(arm, 20), strict=True):
        a.qpos[:] = b.qpos[:] = q
        a.qvel[:] = b.qvel[:] = dq
        mujoco.mj_forward(model, a)
        mujoco.mj_forward(bare, b)
        np.testing.assert_array_equal(a.M, b.M)
        np.testing.assert_array_equal(a.qfrc_bias, b.qfrc_bias)


@pytest.mark.parametrize("name", [*BUILTIN, "generic"])
def test_every_number_has_a_source(name):
    table = tomllib.loads(files("stiction_envs.robots").joinpath(f"{name}.toml").read_text())
    seen = []

    def walk(node: dict, where: str) -> None:
        if "value" in node or "source" in node:
            seen.append(where)
            assert node["source"] in table["sources"], where
            assert node["trust"] in "VMIDG", where
            assert len(node["trust"]) == 1, where
            assert "value" not in node or "unit" in node, where
            # A number of our own says so.
            assert (node["trust"] == "G") == node.get("assumed", False), where
            return
        for key, child in node.items():
            if key == "sources":
                continue
            assert isinstance(child, dict | str), f"{where}.{key}: a number without a source"
            if isinstance(child, dict):
                walk(child, f"{where}.{key}")

    walk(table, name)
    assert len(seen) >= 7
    used = set(re.findall(r'^source = "(.*)"', _text(f"{name}.toml"), re.MULTILINE))
    assert used == set(table["sources"])
    if name != "generic":
        assert set(re.findall(r"\[([A-Z]+[0-9]*)\]", _text(f"{name}.xml"))) <= used


def _text(name: str) -> str:
    return files("stiction_envs.robots").joinpath(name).read_text()


def test_payload_and_tilt_are_recorded_and_in_the_text():
    arm = load_arm("panda", payload=[0.5, 0, 0, 0.1], tilt=np.array([0.1, 0.0]))
    assert arm.payload == (0.5, 0.0, 0.0, 0.1)
    assert arm.tilt == (0.1, 0.0)
    model = mujoco.MjModel.from_xml_string(arm.xml)
    assert model.body("payload").mass == 0.5
    np.testing.assert_allclose(model.body("payload").inertia, 0.4 * 0.5 * 0.03**2)
    assert load_arm("panda", payload=(0, 0, 0, 0)).model().nbody == 9


@pytest.mark.parametrize("name", ["ur5", "", "panda.stl", "Panda"])
def test_unknown_robot(name):
    line = refusal(lambda: load_arm(name), "unknown robot")
    assert all(allowed in line for allowed in (*BUILTIN, ".xml", ".mjcf", ".urdf"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"payload": (-1, 0, 0, 0)}, "payload mass is -1: expected .* from 0 kg"),
        ({"payload": (np.nan, 0, 0, 0)}, "4 finite numbers, mass in kg"),
        ({"payload": (1, 0, 0)}, "4 finite numbers, mass in kg"),
        ({"payload": "heavy"}, "4 finite numbers, mass in kg"),
        ({"tilt": (0, np.inf)}, "2 finite numbers, roll and pitch in rad"),
        ({"tilt": 0.1}, "2 finite numbers, roll and pitch in rad"),
    ],
)
def test_bad_payload_or_tilt(options, message):
    assert next(iter(options)) in refusal(lambda: load_arm("panda", **options), message)
