"""Recordings for Rerun, read back with its own SDK."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from stiction_envs.errors import StictionError
from stiction_envs.gap.report.results import LogDiagnosis, ServoResult
from stiction_envs.gap.report.series import skeleton
from tests.gap.servo.small_arm import two_links

Array = NDArray[np.float64]


class Recording:
    """The chunks of a file by entity, static ones apart."""

    def __init__(self, path: Path) -> None:
        reader = RrdReader(path)
        assert len(reader.recordings()) == len(reader.blueprints()) == 1
        self.timed: dict[str, list[Any]] = {}
        self.static: dict[str, dict[str, Any]] = {}
        for chunk in reader.stream():
            batch = chunk.to_record_batch()
            if chunk.is_static:
                of = self.static.setdefault(chunk.entity_path, {})
                of |= {k: batch.column(k)[0].as_py() for k in batch.schema.names[1:]}
            else:
                self.timed.setdefault(chunk.entity_path, []).append(batch)

    def time(self, entity: str) -> Array:
        """Return (T,) time [s]."""
        of = [b.column("time").cast("int64").to_numpy() for b in self.timed[entity]]
        return np.concatenate(of) * 1e-9

    def values(self, entity: str, component: str) -> Array:
        """Return (T, ...) values of a component."""
        return np.concatenate(
            [np.array(b.column(component).to_pylist()) for b in self.timed[entity]]
        )

    def lines(self, entity: str) -> dict[str, Array]:
        """Return (T,) values of the lines of an entity by name."""
        names = self.static[entity]["SeriesLines:names"]
        return dict(zip(names, self.values(entity, "Scalars:scalars").T, strict=True))


def test_torques_residuals_and_causes_are_those_of_the_series(
    tmp_path: Path, torques: LogDiagnosis
) -> None:
    s, read = torques.series(), Recording(torques.write_rrd(tmp_path / "x.rrd"))
    np.testing.assert_allclose(read.time("/torque/joint_1"), s.time, atol=1e-9)
    models = {"nominal": s.nominal, "simulated": s.simulated}
    left = {name: s.measured - x for name, x in models.items()}
    groups = {"torque": {"measured": s.measured} | models, "residual": left, "cause": s.causes}
    for group, lines in groups.items():
        for j in range(2):
            found = read.lines(f"/{group}/joint_{j + 1}")
            assert list(found) == list(lines)
            for name, values in lines.items():
                np.testing.assert_array_equal(found[name], values[:, j])
    (text,) = read.static["/diagnosis"]["TextDocument:text"]
    assert torques.causes[0].evidence in text
    assert "one arm is drawn" in text
    assert not any(x.startswith("/arm/simulated") for x in read.timed)


def test_angles_contact_and_both_arms_are_those_of_the_series(
    tmp_path: Path, angles: ServoResult
) -> None:
    s, read = angles.series(), Recording(angles.write_rrd(tmp_path / "x.rrd"))
    for j in range(2):
        found = read.lines(f"/angle/joint_{j + 1}")
        for name, values in (("measured", s.q), ("simulated", s.simulated), ("commanded", s.q_cmd)):
            np.testing.assert_array_equal(found[name], values[:, j])
    np.testing.assert_array_equal(read.lines("/contact")["contact"], s.contact)
    assert s.contact.any()
    for name, q in (("measured", s.q), ("simulated", s.simulated)):
        strips = read.values(f"/arm/{name}", "LineStrips3D:strips")[:, 0]
        np.testing.assert_allclose(strips, skeleton(angles.arm, q), atol=1e-6)
        assert np.ptp(strips[:, -1], axis=0).max() > 0.01  # the flange moves


def test_what_cannot_be_written_is_refused(
    tmp_path: Path, torques: LogDiagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = tmp_path / "there.rrd"
    there.write_text("old")
    for path, says in (
        (tmp_path / "x.csv", "ends in '.csv': expected a path to a .rrd"),
        (tmp_path / "none" / "x.rrd", "none: expected a folder that is there"),
        (there, "there.rrd: exists: choose another name, or force"),
    ):
        with pytest.raises(StictionError, match=re.escape(says)):
            torques.write_rrd(path)
    assert there.read_text() == "old"
    torques.write_rrd(there, force=True)
    assert there.read_bytes()[:4] == b"RRF2"
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(StictionError, match=re.escape("pip install 'stiction-envs[rerun]'")):
        torques.write_rrd(tmp_path / "x.rrd")
    assert list(tmp_path.iterdir()) == [there]


def test_an_arm_is_drawn_where_it_is(tmp_path: Path) -> None:
    """Two links that lie flat, then the second hanging down."""
    drawn = skeleton(two_links(tmp_path), np.array([[0.0, 0.0], [0.0, np.pi / 2]]))
    np.testing.assert_allclose(drawn[:, 1:3], 2 * [[[0.0, 0.0, 1.0], [0.3, 0.0, 1.0]]], atol=1e-9)
    flange = drawn[:, -1] - drawn[:, 2]
    np.testing.assert_allclose(flange[1], flange[0][[2, 1, 0]] * [1, 1, -1], atol=1e-9)
