"""Files for viewers: what is refused, in one line and before anything is written."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from stiction_envs.errors import StictionError
from stiction_envs.gap.report.log_result import LogDiagnosis
from stiction_envs.gap.viewers import mcap


def _refused(write: Callable[[], object], folder: Path) -> str:
    before = sorted(folder.rglob("*"))
    with pytest.raises(StictionError) as error:
        write()
    assert sorted(folder.rglob("*")) == before
    assert "\n" not in str(error.value)
    return str(error.value)


def test_a_wrong_place_is_refused(tmp_path: Path, torques: LogDiagnosis) -> None:
    there = tmp_path / "there.rrd"
    there.write_text("old")
    for path, says in (
        (tmp_path / "x.mcap", "ends in '.mcap': expected a path to a .rrd"),
        (tmp_path / "none" / "x.rrd", "none: expected a folder that is there"),
        (there, "there.rrd: exists: choose another name, or force"),
    ):
        assert says in _refused(lambda path=path: torques.write_rrd(path), tmp_path)
    assert "a path to a .mcap" in _refused(lambda: torques.write_mcap(there), tmp_path)
    torques.write_rrd(there, force=True)
    assert there.read_bytes()[:4] == b"RRF2"


@pytest.mark.parametrize(
    ("package", "suffix", "says"),
    [
        ("rerun", "rrd", "needs rerun-sdk: pip install 'stiction-envs[rerun]'"),
        ("rosbags.rosbag2", "mcap", "needs rosbags: pip install 'stiction-envs[ros]'"),
    ],
)
def test_a_missing_package_is_named(
    tmp_path: Path,
    torques: LogDiagnosis,
    monkeypatch: pytest.MonkeyPatch,
    package: str,
    suffix: str,
    says: str,
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    write = getattr(torques, f"write_{suffix}")
    assert says in _refused(lambda: write(tmp_path / f"x.{suffix}"), tmp_path)


def test_nothing_is_left_of_a_file_that_fails(
    tmp_path: Path, torques: LogDiagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(mcap, "stamps", fail)
    with pytest.raises(KeyboardInterrupt):
        torques.write_mcap(tmp_path / "x.mcap")
    assert list(tmp_path.iterdir()) == []
