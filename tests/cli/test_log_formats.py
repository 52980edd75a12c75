"""A kind of log from outside the package works wherever a log can be named."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import stiction_envs as st
from stiction_envs.errors import StictionError
from stiction_envs.measured.kinds import LOG, file_kind
from stiction_envs.measured.logs.formats import registry
from stiction_envs.measured.logs.formats.base import ColumnFile
from stiction_envs.measured.logs.formats.header import Header
from stiction_envs.measured.logs.reader import read_logs
from stiction_envs.robots import load_arm
from tests.gap.small_logs import hidden, write_csv


class Semicolons(ColumnFile):
    """Columns between semicolons."""

    ends: ClassVar = (".semi",)

    def columns(self, where: str) -> dict[str, Any]:
        """Read the columns."""
        with open(where, encoding="utf-8") as file:
            names, *rows = csv.reader(file, delimiter=";")
        return dict(zip(names, np.array(rows, float).T, strict=True))


OURS = {"time_us": "t", "angle1": "q1", "angle2": "q2", "torque1": "tau1", "torque2": "tau2"}
MINE = Header(
    mark="time_us",
    column=lambda name: OURS.get(name, name),
    per_second=1e6,
    side="link",
    note="a log of mine",
)


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Both kinds come from the entry points of another package; afterwards they are forgotten."""
    points = [SimpleNamespace(load=lambda new=new: new) for new in (Semicolons(), MINE)]
    monkeypatch.setattr(registry, "_formats", [*registry._formats])
    before = [*registry.HEADERS]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)
    registry._load_entry_points.cache_clear()
    yield
    registry.HEADERS[:] = before
    registry._load_entry_points.cache_clear()


@pytest.mark.usefixtures("known")
def test_a_format_from_outside_is_read_by_library_and_commands(cli, inputs, two) -> None:
    log = inputs / "log.csv"
    write_csv(log, hidden(load_arm(two), seconds=4.0))
    (own,) = read_logs([log], 2)
    semi, mine = inputs / "log.semi", inputs / "mine.csv"
    semi.write_text(log.read_text("utf-8").replace(",", ";"), "utf-8")
    table = np.column_stack([1e6 * own.t, own.q, own.tau])
    np.savetxt(mine, table, delimiter=",", header=",".join(OURS), comments="", fmt="%.17g")
    registry._load_entry_points.cache_clear()
    registry.HEADERS.remove(MINE)
    registry._formats.pop()
    assert file_kind(mine) == LOG  # before anything else has asked for formats
    for path, side in ((semi, None), (mine, "link")):
        (read,) = read_logs([path], 2)
        assert read.side == side
        np.testing.assert_allclose(read.t, own.t, atol=1e-9)
        np.testing.assert_array_equal(read.tau, own.tau)
        assert not st.check(path, robot=two).defects
        assert cli("check", path, "--robot", two).code == 0
        ran = cli("diagnose", path, "--robot", two, "--out", path.stem, "--force")
        assert ran.code == 0, ran.err


@pytest.mark.usefixtures("known")
def test_what_another_kind_has_is_refused(tmp_path: Path) -> None:
    assert ".semi" in registry.log_ends()
    for new in (Semicolons(), MINE):
        with pytest.raises(StictionError, match="expected"):
            registry.register(new)
    (tmp_path / "a.none").touch()
    with pytest.raises(StictionError, match=r"unknown kind of file: expected one of .*\.semi"):
        read_logs([tmp_path / "a.none"], 2)
