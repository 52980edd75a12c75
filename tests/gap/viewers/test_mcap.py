"""MCAP files, read back by rosbags and by our own reader of logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader

from stiction_envs.gap.report.log_result import LogDiagnosis
from stiction_envs.gap.report.servo_result import ServoResult
from stiction_envs.gap.viewers import mcap
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.reader import read_logs

Array = NDArray[np.float64]


def _read(path: Path) -> dict[str, tuple[Array, dict[str, Array], list[object]]]:
    """Return by topic the times [ns], the channels of JointState, and the data of others."""
    out = {}
    with AnyReader([path]) as reader:
        for c in reader.connections:
            times, fields, data = [], {x: [] for x in mcap.FIELDS}, []
            for _, time, raw in reader.messages(connections=[c]):
                message = reader.deserialize(raw, c.msgtype)
                times.append(time)
                if c.msgtype == mcap.JOINT_STATE:
                    stamp = message.header.stamp
                    assert stamp.sec * 10**9 + stamp.nanosec == time
                    assert tuple(message.name) == ("shoulder", "elbow")
                    for x in mcap.FIELDS:
                        fields[x].append(getattr(message, x))
                else:
                    data.append(message.data)
            channels = {k: np.array(v) for k, v in fields.items()}
            out[c.topic] = np.array(times), channels, data
    return out


def test_topics_hold_the_series_of_a_joint_log(tmp_path: Path, torques: LogDiagnosis) -> None:
    s, d = torques.series(), torques.diagnosis
    read = _read(torques.write_mcap(tmp_path / "x.mcap"))
    assert set(read) == {
        *("/measured", "/nominal", "/simulated", "/residual", "/nominal_residual"),
        *("/cause/coulomb_friction", "/diagnosis"),
    }
    time, channels, _ = read["/measured"]
    np.testing.assert_allclose(time * 1e-9, s.time, atol=1e-9)
    np.testing.assert_array_equal(channels["position"], d.data.q)
    np.testing.assert_array_equal(channels["effort"], d.data.tau)
    np.testing.assert_array_equal(read["/nominal_residual"][1]["effort"], d.data.residual)
    np.testing.assert_array_equal(read["/simulated"][1]["effort"], s.simulated)
    assert read["/simulated"][1]["position"].size == 0
    assert read["/diagnosis"][2] == [s.text]


def test_topics_hold_the_series_of_a_servo_log(tmp_path: Path, angles: ServoResult) -> None:
    s, d = angles.series(), angles.diagnosis
    read = _read(angles.write_mcap(tmp_path / "x.mcap"))
    np.testing.assert_array_equal(read["/commanded"][1]["position"], d.logs[0].q_cmd)
    np.testing.assert_array_equal(read["/simulated"][1]["position"], d.angles[0])
    np.testing.assert_array_equal(read["/residual"][1]["position"], d.logs[0].q - d.angles[0])
    assert s.contact is not None
    assert read["/contact"][2] == s.contact.tolist()
    # the log of a hidden cause begins a little before zero, which no stamp can
    assert read["/measured"][0][0] >= 0


def test_our_reader_reads_the_measured_topic_again(tmp_path: Path, torques: LogDiagnosis) -> None:
    path = torques.write_mcap(tmp_path / "x.mcap")
    d = torques.diagnosis
    (log,) = read_logs([path], 2, naming=Naming(robot=("shoulder", "elbow"), topic="/measured"))
    np.testing.assert_allclose(log.t, d.data.t - d.data.t[0], atol=1e-9)
    np.testing.assert_array_equal(log.q, d.data.q)
    np.testing.assert_array_equal(log.tau, d.data.tau)


def test_same_diagnosis_same_bytes(tmp_path: Path, torques: LogDiagnosis) -> None:
    one, two = (torques.write_mcap(tmp_path / f"{x}.mcap").read_bytes() for x in "ab")
    assert one == two
