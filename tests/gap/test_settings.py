"""A user's own constants reach every stage of a diagnosis, and are known by their hash."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.gap.causes import Part, cause_named, default_settings, registered
from stiction_envs.gap.diagnosis import Diagnosis, diagnose
from stiction_envs.gap.extended_model import extend
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.settings import gap_settings
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.method_settings import fingerprint, override
from tests.gap.small_logs import hidden, panda, write_csv

ARM = panda()


@pytest.fixture(scope="module")
def log() -> JointLog:
    """An offset of 1 N·m on joint 2."""
    return hidden(ARM, lambda q, dq, ddq: np.eye(7)[1] + 0 * q, seconds=8.0)


def found(log: JointLog | Path, settings=None, *also: str) -> Diagnosis:
    causes = [cause_named(x) for x in ("torque_offset", *also)]
    return diagnose([log], ARM, causes=causes, settings=settings)


def test_the_defaults_name_the_offset(log):
    d = found(log)
    assert [(c.name, c.joints) for c in d.causes] == [("torque_offset", (2,))]
    assert d.settings == default_settings()


@pytest.mark.parametrize(
    ("settings", "changed"),
    [
        ({"selection.least_torque": 1e6}, lambda d: not d.causes),
        ({"verdict": {"close": 1e-3, "small": 1e-9}}, lambda d: d.verdict == "partly explained"),
        ({"measured.motion.travel_span": 100.0}, lambda d: d.verdict == "cannot tell"),
        ({"recording": {"blocks": 5}}, lambda d: d.data.blocks == 5),
        ({"recording.most_rows": 300}, lambda d: len(d.data.t) <= 300),
        ({"spectra.lowest_hz": 15.0, "spectra.highest": 0.075}, lambda d: d.data.cutoff == 15.0),
        ({"estimates.model_error": 0.5}, lambda d: interval(d) > 0.5),
        ({"noise.least_noise": 0.7}, lambda d: (d.noise >= 0.7).all()),
    ],
)
def test_a_changed_constant_is_felt(log, settings, changed):
    d = found(log, settings)
    assert changed(d)
    assert not changed(found(log))
    assert fingerprint(d.settings) != fingerprint(default_settings())


def interval(d: Diagnosis) -> float:
    low, high = d.causes[0].parameters[2]["offset_nm"].ci95
    return high - low


def test_files_are_read_with_them_and_a_toml_holds_them(log, tmp_path):
    write_csv(tmp_path / "log.csv", log)
    (tmp_path / "own.toml").write_text("[measured.reader]\nleast_seconds = 60\n", "utf-8")
    with pytest.raises(StictionError, match="s of samples: expected 60 s or more"):
        found(tmp_path / "log.csv", tmp_path / "own.toml")
    with pytest.raises(StictionError, match=r"selection\.chanse: no such setting: expected one of"):
        found(log, {"selection.chanse": 0.1})


def given(name: str, **changes):
    """Return a cause with some of its constants changed."""
    changed = {f"causes.{name}.{field}": value for field, value in changes.items()}
    return cause_named(name).given(override(default_settings(), changed))


def test_a_cause_takes_its_constants_from_a_diagnosis_and_is_not_changed_itself():
    before = cause_named("backlash").settings
    narrow = given("backlash", largest=0.01, count=5)
    assert narrow.settings.gaps == pytest.approx(np.geomspace(2e-3, 0.01, 5))
    assert (cause_named("backlash").settings, len(before.gaps)) == (before, 161)
    assert cause_named("backlash").given(default_settings()) is cause_named("backlash")
    # one without any, and settings of the room alone, which hold none
    assert all(c.given(gap_settings()) is c for c in registered())


@pytest.mark.parametrize(
    ("name", "changes", "of"),
    [
        ("stribeck_friction", {"most_ratio": 2.0}, lambda c: c.resized((0.1,), np.array([9.0]), 1)),
        ("presliding_hysteresis", {"longest": 0.1}, lambda c: c.shapes(None, 0, None)),
        ("torque_scale", {"least_error": 0.1}, lambda c: c.negligible(np.array([0.05]), ())),
        ("torque_scale", {"highest": 3.0}, lambda c: c.bounds(None, 0)[1].tolist()),
        ("payload", {"small": 2.0}, lambda c: c.values(np.ones(10), ())["com_m"]),
        ("backlash", {"least": 0.1}, lambda c: c.bounds(None, 0)[0].tolist()),
        ("backlash", {"count": 21}, lambda c: c.between((0.01,), [])),
        ("joint_elasticity", {"softest": 2000.0}, lambda c: c.at_edge((1500.0,), [], 1.02)),
        ("actuator_delay", {"delays": [0.005]}, lambda c: c.shapes(None, 0, None)),
        ("actuator_delay", {"steps": [0.5]}, lambda c: c.nearby((0.1,))),
        # one that was made from it to shift another torque
        (
            "actuator_delay",
            {"steps": [0.5]},
            lambda c: c.acting_on(np.ones(1)).nearby((0.1,)),
        ),
    ],
)
def test_a_changed_constant_of_a_cause_is_felt(name, changes, of):
    assert of(given(name, **changes)) != of(cause_named(name))


def test_constants_of_causes_reach_the_diagnosis_and_its_model(log):
    plain = found(log, None, "warm_up_drift")
    longer = found(log, {"causes.warm_up_drift.shortest_log": 5.0}, "warm_up_drift")
    assert "s long" in plain.not_identifiable["warm_up_drift"]
    assert "warm_up_drift" not in longer.not_identifiable
    assert fingerprint(plain.settings) != fingerprint(longer.settings)

    part = Part(cause="joint_elasticity", joint=4, shape=(5000.0,), coefficients=(1.0,))
    rotor = Part(cause="link_inertia", joint=4, shape=(), coefficients=(0.1,))
    nominal = Nominal(robot="panda", parts=(rotor, part))
    light = found(log, {"causes.joint_elasticity.least_rotor": 0.2})
    assert not any("no rotor" in x for x in extend(plain.base, nominal).missing)
    assert any("no rotor" in x for x in extend(light.base, nominal).missing)


def test_a_constant_that_no_cause_has_is_one_clear_line(log):
    with pytest.raises(StictionError, match=r"causes\.payload\.x: no such .* heavy, small"):
        found(log, {"causes.payload.x": 1})
    with pytest.raises(StictionError, match=r"causes\.friction: no such setting: expected one of"):
        found(log, {"causes": {"friction": {"x": 1}}})
    with pytest.raises(StictionError, match=r"BacklashSettings: flank is -1\.0: expected"):
        found(log, {"causes.backlash.flank": -1})
