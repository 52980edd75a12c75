"""Causes in a model: exactly in the model file, and as physics that MuJoCo runs."""

import dataclasses
import tomllib

import mujoco
import numpy as np
import pytest

from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.gap.causes import CAUSES, Part, cause_named
from stiction_envs.gap.causes.base import OF_ARM, torque_of
from stiction_envs.gap.extended_model import extend, load_model
from stiction_envs.gap.model_file import Nominal, changed_arm, read
from stiction_envs.hidden.worlds import inverse_torque
from stiction_envs.plant import Plant
from stiction_envs.robots import load_arm
from stiction_envs.robots.regressor import consistent, inertial_parameters
from stiction_envs.robots.stated import STICTION
from tests.gap.small_logs import data_of, hidden, panda, part

BALL = 0.4 * 1.2 * 0.03**2  # inertia of 1.2 kg as `load_arm` makes it
COM = np.array([0.02, -0.01, 0.06])
ABOUT_FLANGE = BALL * np.eye(3) + 1.2 * (COM @ COM * np.eye(3) - np.outer(COM, COM))
PAYLOAD = (1.2, *(1.2 * COM), *ABOUT_FLANGE[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]])
FALL = 1 - np.sqrt(1 - 0.02**2 - 0.01**2)  # what leaning takes off the vertical part


ALL = (
    part("coulomb_friction", 4, 0.6),
    part("viscous_friction", 4, 0.8),
    part("stribeck_friction", 4, 0.2, shape=(0.05,)),
    part("direction_asymmetry", 4, 0.1),
    part("load_dependent_friction", 4, 0.03),
    part("presliding_hysteresis", 4, 0.6, shape=(0.01,)),
    part("position_dependent_friction", 4, 0.2, 0.1, shape=(20.0,)),
    part("warm_up_drift", 4, 0.01),
    part("torque_offset", 4, 0.7),
    part("torque_scale", 4, 0.1),
    part("falling_torque", 4, 0.4),
    part("position_dependent_torque", 4, 0.3, 0.2, -0.1, 0.4, 0.1, shape=(2.0,)),
    part("payload", 0, *PAYLOAD),
    part("base_tilt", 0, 0.02, -0.01, FALL),
    part("link_parameters", 4, 0.3, 0.02, -0.01, 0.03, shape=(4.0, 3.6)),
    part("link_inertia", 4, 0.3),
    part("joint_elasticity", 4, 1.0, shape=(8000.0,)),
    part("actuator_delay", 0, 0.005, shape=(0.005,)),
    part("encoder_offset", 4, 0.05, shape=(0.05,)),
    part("gravity_compensation_missing", 0, 0.3),
    part("external_spring", 4, 3.0, -1.5),
)
PARTS = {p.cause: p for p in ALL}
PHANTOM = tuple(-x for x in PAYLOAD)
"""A body that only the model has: what is left of the last link is less than it was."""
SMOOTH = ("base_tilt", "link_inertia", "external_spring", "viscous_friction", "encoder_offset")
LISTED = (
    *("direction_asymmetry", "load_dependent_friction", "warm_up_drift", "torque_scale"),
    *("falling_torque", "joint_elasticity", "actuator_delay", "gravity_compensation_missing"),
)
MADE = {"title": "made up"}


@pytest.fixture(scope="module")
def data():
    arm = panda()
    return data_of(arm, hidden(arm))


def found(*names: str) -> Nominal:
    return Nominal(robot="panda", parts=tuple(PARTS[n] for n in names))


@pytest.fixture(scope="module", autouse=True)
def _as_wide_as_their_columns(data):
    """Give parts zeros for columns that this file has nothing to say about."""
    for name, p in PARTS.items():
        if cause_named(name).adds_to in OF_ARM:
            continue
        width = cause_named(name).columns(data, p.joint - 1, p.shape).shape[-1]
        full = (*p.coefficients, *[0.0] * width)[:width]
        PARTS[name] = dataclasses.replace(p, coefficients=full)


def rows_of(data):
    return np.linspace(50, len(data.q) - 50, 12).astype(int)


def forces(xml: str, data) -> tuple[np.ndarray, np.ndarray]:
    """Angles of joint 4 in some rows, and what actuators of stock MuJoCo add there at rest."""
    model = mujoco.MjModel.from_xml_string(xml)
    work, rows, out = mujoco.MjData(model), rows_of(data), []
    for k in rows:
        work.qpos[:], work.qvel[:] = data.q[k], 0.0
        mujoco.mj_forward(model, work)
        out.append(work.qfrc_actuator[3])
    return data.q[rows, 3], np.array(out)


def inverse(xml: str, data, rows) -> np.ndarray:
    """Torque that stock MuJoCo wants for the measured motion; friction of actuators apart."""
    model = mujoco.MjModel.from_xml_string(xml)
    return inverse_torque(model, data.q[rows], data.dq[rows], data.ddq[rows])


def test_there_is_a_part_for_every_cause():
    assert set(PARTS) == {c.name for c in CAUSES}


def test_cables_that_push_away_are_said_to_be_left_out(data):
    """Small errors have either sign; MuJoCo's springs have one."""
    pushes = part("external_spring", 4, -0.05, 0.02)
    made = extend(data, Nominal(robot="panda", parts=(pushes,)))
    model = mujoco.MjModel.from_xml_string(made.xml)
    assert not model.jnt_stiffness.any()
    assert made.left_out.any()
    assert made.missing == ("external_spring of joint 4: MuJoCo's springs pull back",)


@pytest.mark.parametrize("name", PARTS)
def test_every_cause_is_held_or_said_to_be_left_out(data, name):
    """Nothing is dropped in silence, and the comment of the MJCF says it too."""
    needs = cause_named(name).needs
    made = extend(data, found(*needs, name))
    mujoco.MjModel.from_xml_string(made.xml)
    assert bool(made.missing) == (name in LISTED)
    assert made.left_out.any() == (name in LISTED)
    for text in made.missing:
        assert text in made.xml


@pytest.mark.parametrize("robot", ["panda", "iiwa7", "iiwa14"])
@pytest.mark.parametrize("body", ["on the flange", "only in the model"])
def test_model_file_and_mjcf_want_the_same_torque(robot, body, tmp_path):
    """All that changes the arm at once, level on level, is read back from the file."""
    load = (1.2, *COM) if body == "only in the model" else None
    arm = load_arm(robot, payload=load)
    log = hidden(load_arm(robot), seconds=3.0)
    judged = data_of(arm, log)
    links = []
    for j in (2, 3, 5, 6):
        numbers = 0.4 * (-1) ** j, 0.02, -0.03, 0.01
        link = part("link_parameters", j, *numbers, shape=(j, 1.0))
        links.append(dataclasses.replace(link, level=1 + j // 5))
    body = PAYLOAD if load is None else PHANTOM
    own = dataclasses.replace(PARTS["payload"], coefficients=body, level=2)
    more = [PARTS[x] for x in SMOOTH]
    model = Nominal(robot=arm.name, payload=arm.payload, parts=(*links, *more, own))
    made = extend(judged, model)
    path = tmp_path / "model.toml"
    path.write_text(made.toml(meta=MADE, provenance={}), encoding="utf-8")
    rows = rows_of(judged)
    want = read(path).extend(judged).nominal[rows]
    assert np.abs(want - judged.nominal[rows]).max() > 1.0
    np.testing.assert_allclose(inverse(made.xml, judged, rows), want, atol=1e-9)
    assert consistent(inertial_parameters(changed_arm(arm, model.parts).pinocchio())).all()
    if load is not None:  # what is taken out is what was put in
        alone = changed_arm(arm, [own]).pinocchio()
        bare = load_arm(robot).pinocchio()
        np.testing.assert_allclose(inertial_parameters(alone), inertial_parameters(bare), atol=1e-9)


@pytest.mark.parametrize(
    ("name", "torque"),
    [
        ("position_dependent_friction", lambda q: 0.2 * np.sin(20 * q) + 0.1 * np.cos(20 * q)),
        ("torque_offset", lambda q: 0.7),
        (
            "position_dependent_torque",
            lambda q: 0.3 + np.cos([q, 2 * q]) @ [0.2, 0.4] + np.sin([q, 2 * q]) @ [-0.1, 0.1],
        ),
    ],
)
def test_actuators_push_against_what_the_motor_must_overcome(data, name, torque):
    """Also where the model file has the cause twice."""
    twice = (PARTS[name], dataclasses.replace(PARTS[name], level=2))
    made = extend(data, Nominal(robot="panda", parts=twice))
    assert not made.missing
    q, force = forces(made.xml, data)
    np.testing.assert_allclose(force, [-2 * torque(x) for x in q], rtol=0, atol=1e-9)


def test_friction_tables_hold_levels_by_direction(data):
    made = extend(data, found("coulomb_friction", "direction_asymmetry", "stribeck_friction"))
    f = made.friction
    np.testing.assert_allclose(f.stiction[3], [0.9, 0.7])
    np.testing.assert_allclose((f.stiction * f.coulomb_ratio)[3], [0.7, 0.5])
    assert f.stribeck_velocity[3, 0] == 0.05
    assert np.delete(f.stiction, 3, axis=0).max() <= 1e-6


def test_drift_starts_at_its_level_with_its_slope(data):
    f = extend(data, found("coulomb_friction", "warm_up_drift")).friction
    level = f.stiction[3, 0] * (1 + f.warm_up_friction[3])
    slope = -f.stiction[3, 0] * f.warm_up_friction[3] / f.warm_up_time[3]
    assert level == pytest.approx(0.6)
    assert slope == pytest.approx(0.01)


def sticky(**quantities: float) -> FrictionParameters:
    """The Panda's friction without elastic gears and load, some quantities of joint 4 set."""
    friction = load_friction("panda")
    values = {name: getattr(friction, name).copy() for name in quantities}
    for name, x in quantities.items():
        values[name][3] = x
    rigid = {"joint_stiffness": np.full(7, np.inf), "load_coefficient": np.zeros(7)}
    return friction.replace(**rigid, **values)


def ripples(*parts: Part) -> Nominal:
    """A nominal friction whose joint 4 has 12 ripples a turn, and parts."""
    friction = sticky(ripple_amplitude=0.3, ripple_periods=12.0, ripple_phase=0.4)
    return Nominal(robot="panda", friction=friction, parts=parts)


def judged_by(nominal: Nominal):
    """A log against the nominal friction, without the parts."""
    return data_of(panda(), hidden(panda()), nominal.friction)


@pytest.mark.parametrize("periods", [12.0, 33.0])
def test_a_found_ripple_is_added_to_that_of_the_nominal_friction(periods):
    """Also where the nominal friction, or an earlier diagnosis, has one already."""
    own = part("position_dependent_friction", 4, 0.2, 0.1, shape=(periods,))
    nominal = ripples(own)
    data = judged_by(nominal)
    made = extend(data, nominal)
    assert made.missing == ()
    assert not made.left_out.any()
    assert bool(made.friction_missing) == (periods == 33.0)
    q, force = forces(made.xml, data)
    found = 0.2 * np.sin(periods * q) + 0.1 * np.cos(periods * q)
    want = 0.3 * np.sin(12.0 * q + 0.4) - found - nominal.friction.offset[3]
    np.testing.assert_allclose(force, want, rtol=0, atol=1e-9)


def test_the_nominal_torque_has_the_friction_s_ripple_and_warm_up():
    """The plant simulates both, and the model file contains both."""
    ripple = {"ripple_amplitude": 0.3, "ripple_periods": 12.0, "ripple_phase": 0.4}
    warm_up = {"warm_up_friction": 0.5, "warm_up_viscous": 0.2, "warm_up_time": 20.0}
    with_both = sticky(**ripple, **warm_up)
    plain = judged_by(Nominal(robot="panda", friction=sticky()))
    both = judged_by(Nominal(robot="panda", friction=with_both))
    added = (both.nominal - plain.nominal)[:, 3]
    cold = np.exp(-plain.recording.since_session / 20.0)
    dry = plain.smooth(plain.directions[:, 3]) * plain.friction.level[3]
    fast = np.abs(plain.dq[:, 3]) > 0.3  # friction is at its level in motion
    want = -0.3 * np.sin(12.0 * plain.q[:, 3] + 0.4) + cold * (
        0.5 * dry + 0.2 * with_both.viscous[3].mean() * plain.dq[:, 3]
    )
    assert np.abs(want[fast]).max() > 0.3
    np.testing.assert_allclose(added[fast], want[fast], atol=0.03)


def test_mjcf_has_the_nominal_warm_up_half_way_through_the_logs():
    friction = sticky(warm_up_friction=0.5, warm_up_viscous=0.2, warm_up_time=20.0)
    data = judged_by(Nominal(robot="panda", friction=friction))
    half = np.exp(-0.5 * np.ptp(data.recording.since_session) / 20.0)
    cold, warm = (
        mujoco.MjModel.from_xml_string(extend(data, Nominal(robot="panda", friction=f)).xml)
        for f in (friction, sticky())
    )
    name = panda().joint_names[3]
    levels = [x.actuator(f"{name}_torque").biasprm[STICTION] for x in (cold, warm)]
    assert levels[0] / levels[1] == pytest.approx(1.0 + 0.5 * half)
    damping = cold.joint(name).damping[0] / warm.joint(name).damping[0]
    assert damping == pytest.approx(1.0 + 0.2 * half)


def test_a_drift_on_a_nominal_warm_up_is_left_out_whole():
    friction = sticky(warm_up_friction=0.5, warm_up_time=20.0)
    nominal = Nominal(robot="panda", friction=friction, parts=(part("warm_up_drift", 4, 0.01),))
    data = judged_by(nominal)
    made = extend(data, nominal)
    drift = torque_of(cause_named("warm_up_drift"), data, nominal.parts[0])
    np.testing.assert_array_equal(made.left_out, drift)


def test_toml_is_exact_and_loads_in_the_plant(data, tmp_path):
    distance = tuple(data.friction.presliding_distance)
    everything = dataclasses.replace(
        found(*PARTS), distance=distance, friction=load_friction("panda")
    )
    made = extend(data, everything)
    path = tmp_path / "model.toml"
    path.write_text(made.toml(meta=MADE, provenance={}), encoding="utf-8")
    tomllib.loads(path.read_text("utf-8"))
    again = read(path)
    assert again.parts == everything.parts
    np.testing.assert_array_equal(again.friction.stiction, everything.friction.stiction)
    np.testing.assert_array_equal(read(path).extend(data).nominal, everything.extend(data).nominal)
    model = load_model(path)
    assert sum(model.arm.model().body_mass) == pytest.approx(
        sum(panda().model().body_mass) + 1.2 + 0.3
    )
    plant = Plant(model, 1, threads=1)
    assert np.isfinite(plant.run(np.zeros((1, 50, 7)))).all()


def test_levels_are_added_one_on_the_other(data):
    """A gain of a later diagnosis multiplies what the earlier one made of the nominal torque."""
    first = PARTS["torque_offset"]
    second = dataclasses.replace(PARTS["torque_scale"], level=2)
    both = Nominal(robot="panda", parts=(second, first)).extend(data).nominal
    np.testing.assert_allclose(both[:, 3], 1.1 * (data.nominal[:, 3] + 0.7), atol=1e-9)
