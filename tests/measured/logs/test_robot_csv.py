"""Logs of libfranka and franka_ros as CSV: what our own columns give."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.measured.checks.files import check
from stiction_envs.measured.kinds import LOG, file_kind
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.measured.logs.sources import torque_side
from stiction_envs.robots import load_arm
from tests.measured.logs.bad_logs import GOOD, VALUES, assert_holds, put, torque_log
from tests.refusal import refusal

LIMITS = load_arm("panda").limits


def _lines(columns: dict[str, list[str]], between: str) -> str:
    rows = zip(*columns.values(), strict=True)
    return "\n".join([between.join(columns), *(",".join(r) for r in rows)]) + "\n"


def libfranka(values: np.ndarray, between: str = ", ") -> str:
    """`franka::logToCSV` of ``t, q, dq, tau`` (T, 22): six digits, as a C++ stream prints them.

    Names are apart by a comma and a blank up to libfranka 0.13, by a comma since.
    """
    q, dq, tau = values[:, 1:8], values[:, 8:15], values[:, 15:]
    zero = np.zeros_like(q)
    groups = {
        "state.q": q,
        "state.q_d": zero,
        "state.dq": dq,
        "state.dq_d": zero,
        "state.tau_J": tau,
        "cmd.tau_J_d": zero + 5.0,
    }
    columns = {"time": [f"{1000 * t:.0f}" for t in values[:, 0]], "success_rate": ["1"] * len(q)}
    for name, array in groups.items():
        for j, x in enumerate(array.T):
            columns[f"{name}[{j}]"] = [f"{v:.6g}" for v in x]
    return _lines(columns, between)


def rostopic(values: np.ndarray, start: int = 1_700_000_000_000_000_000) -> str:
    """``rostopic echo -p`` of `franka_msgs/FrankaState`."""
    q, dq, tau = values[:, 1:8], values[:, 8:15], values[:, 15:]
    stamps = [str(start + round(1e9 * t)) for t in values[:, 0]]
    columns = {
        "%time": [str(int(x) + 400_000) for x in stamps],
        "field.header.seq": [str(k) for k in range(len(q))],
        "field.header.stamp": stamps,
        "field.header.frame_id": [""] * len(q),
    }
    groups = {"q": q, "q_d": 0 * q, "dq": dq, "tau_J": tau, "dtau_J": 0 * q, "tau_J_d": 0 * q}
    for name, array in groups.items():
        for j, x in enumerate(array.T):
            columns[f"field.{name}{j}"] = [repr(float(v)) for v in x]
    return _lines(columns, ",")


def read(path: Path, text: str) -> JointLog:
    """Read a log, of which `check` finds nothing wrong, with or without a robot."""
    put(path, text)
    assert file_kind(path) == LOG
    assert check(path).defects == check(path, robot="panda").defects == ()
    return torque_log(path, limits=LIMITS)


@pytest.mark.parametrize("between", [", ", ","])
def test_libfranka(tmp_path: Path, between: str) -> None:
    """Milliseconds become seconds, tau_J the torque; all to the digits that are printed."""
    log = read(tmp_path / "log.csv", libfranka(VALUES, between=between))
    assert_holds(log, VALUES, "t")
    assert_holds(log, VALUES, "q dq tau", rtol=5e-6)
    assert log.side == "link"
    assert log.warnings == ()
    assert [c.text for c in log.corrections] == [
        "a log of libfranka: tau is state.tau_J, measured behind the gear, with gravity"
    ]


def test_franka_ros(tmp_path: Path) -> None:
    """Dates of 19 digits: a float of them is good to 0.3 µs."""
    log = read(tmp_path / "log.csv", rostopic(VALUES))
    assert_holds(log, VALUES, "t", atol=5e-7)
    assert_holds(log, VALUES, "q dq tau")
    assert log.side == "link"
    assert log.date == pytest.approx(1.7e9)


def test_side_of_the_torque(tmp_path: Path) -> None:
    """The log's side is the default; an option that contradicts the log warns."""
    theirs = read(tmp_path / "theirs.csv", libfranka(VALUES))
    ours = read(tmp_path / "ours.csv", GOOD)
    assert torque_side(None, [theirs]) == "link"
    assert torque_side(None, [ours]) == "motor"
    assert torque_side("link", [ours, theirs]) == "link"
    says = r"ours\.csv does not say: expected torque"
    refusal(lambda: torque_side(None, [ours, theirs]), says)
    says = "unknown torque side 'gear': expected one of motor"
    refusal(lambda: torque_side("gear", [ours]), says)
    with pytest.warns(UserWarning, match=r"theirs\.csv was measured behind the gear"):
        assert torque_side("motor", [theirs]) == "motor"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert torque_side("motor", [ours]) == "motor"
