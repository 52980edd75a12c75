import dataclasses
import gzip
import re
import resource
import time
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from stiction_envs.measured.logs.formats import base, csv_file
from stiction_envs.measured.logs.reader import read_logs, read_poses
from stiction_envs.robots import load_arm
from tests.measured.logs.bad_logs import (
    BAD_FILES,
    GOOD,
    HEADER,
    SIX,
    VALUES,
    assert_holds,
    good_values,
    header_of,
    put,
    refuses,
    text_of,
    torque_log,
)
from tests.refusal import refusal

LIMITS = load_arm("panda").limits
read = partial(torque_log, limits=LIMITS)


def says(paths: list[Path]) -> str:
    """The one line about logs that cannot be read."""
    start = time.perf_counter()
    message = refuses(lambda: read_logs(paths, 7, limits=LIMITS), "")
    assert time.perf_counter() - start < 10
    assert len(message.replace(str(paths[0].parent), "")) < 300
    assert any(str(path) in message for path in paths)
    return message


@pytest.mark.parametrize(
    ("name", "expected"), [(name, x) for name, files in BAD_FILES.items() for x in files]
)
def test_a_bad_log_is_one_clear_line(tmp_path: Path, name: str, expected: str) -> None:
    assert re.search(expected, says([put(tmp_path / name, BAD_FILES[name][expected])]))


def test_what_is_no_file_or_not_one_log_is_one_clear_line(tmp_path: Path) -> None:
    assert "gone.csv: no such file" in says([tmp_path / "gone.csv"])
    (tmp_path / "log.csv").mkdir()
    assert "log.csv: a directory: expected a log file" in says([tmp_path / "log.csv"])
    assert "/dev/zero: no regular file" in says([Path("/dev/zero")])
    refusal(lambda: read_logs([], 7), "one or more")
    one, copy = (put(tmp_path / name, GOOD) for name in ("one.csv", "copy.csv"))
    assert re.search(r"copy\.csv: the same log as .*one\.csv", says([one, copy]))
    six = put(tmp_path / "six.csv", SIX)
    assert "six.csv: columns for 6 joints, but the robot has 7" in says([one, six])


def test_a_packed_bomb_is_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small file that unpacks to a lot: an error after the limit, and no memory for it."""
    monkeypatch.setattr(csv_file, "MOST_BYTES", 2**22)
    row = (",".join(["0"] * 22) + "\n").encode()
    bomb = gzip.compress((HEADER + "\n").encode() + row * (2**26 // len(row)), 1)
    assert len(bomb) < 2**20
    path = put(tmp_path / "bomb.csv.gz", bomb)
    del bomb
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refusal(lambda: read(path), "over 4 MiB of text")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # KiB


def test_too_many_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(base, "MOST_VALUES", 1000)
    path = put(tmp_path / "log.csv", GOOD)
    refuses(lambda: read(path), "46 rows or more: expected at most 1000 numbers")
    np.savez(tmp_path / "log.npz", t=VALUES[:, 0], q=VALUES[:, 1:8], tau=VALUES[:, 15:])
    refuses(lambda: read(tmp_path / "log.npz"), "200 rows or more")


@pytest.mark.parametrize(
    ("torque", "origin"),
    [
        (np.full(7, 100.0), "assumed, the robot's file states none"),
        (np.full(7, 0.1), "stated by the robot's file"),
        (np.r_[np.full(6, 200.0), 0.1], "stated by the robot's file"),
    ],
)
def test_a_torque_limit_that_may_fill_a_gap_warns(tmp_path: Path, torque, origin: str) -> None:
    """Assumed, the same number for all, or tiny: the limit is a suspect as the torque's unit is."""
    values = good_values()
    values[:, 21] = 190.0 + values[:, 21]
    path = put(tmp_path / "strong.csv", text_of(values))
    log = torque_log(path, limits=dataclasses.replace(LIMITS, torque=torque))
    (text,) = [w for w in log.warnings if w.startswith("tau7 reaches")]
    assert f"({origin}; a TOML beside it corrects it: [limits.torque])" in text
    known = dataclasses.replace(LIMITS, torque=100.0 + np.arange(7))
    says = r"tau7 is .* looks like per cent .*\[limits.torque\]"
    refuses(lambda: torque_log(path, limits=known), says)


def test_a_speed_limit_that_may_fill_a_gap_warns(tmp_path: Path) -> None:
    """No joint moves at 20 rad/s, so these are degrees for every limit."""
    limits = dataclasses.replace(LIMITS, velocity=np.full(7, 0.1))
    values = good_values()
    log = torque_log(put(tmp_path / "log.csv", text_of(values)), limits=limits)
    text = next(w for w in log.warnings if w.startswith("q1 moves at"))
    assert "can do 0.1 rad/s (stated by the robot's file; a TOML beside it corrects it" in text
    values[:, 1] += 4.8 * np.sin(6 * values[:, 0])
    path = put(tmp_path / "fast.csv", text_of(values))
    says = "which looks like degrees: expected rad, or units deg"
    refuses(lambda: torque_log(path, limits=limits), says)


def test_units_without_limits(tmp_path: Path) -> None:
    values = good_values()
    values[:, 1:15] *= 180 / np.pi
    path = put(tmp_path / "log.csv", text_of(values))
    refuses(lambda: torque_log(path), "looks like degrees: expected radians")


def test_values_arrive_as_they_stand(tmp_path: Path) -> None:
    log = read(put(tmp_path / "log.csv", GOOD))
    assert_holds(log, np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=1))
    assert (log.breaks, log.corrections, log.warnings, log.extra) == ((), (), (), {})
    assert log.source == str(tmp_path / "log.csv")
    assert log.step == pytest.approx(0.01)
    assert not log.q.flags.writeable
    assert log.date is None


def test_the_same_log_in_every_kind_of_file(tmp_path: Path) -> None:
    text = GOOD
    v = np.loadtxt(text.splitlines()[1:], delimiter=",")
    np.savez(tmp_path / "matrices.npz", t=v[:, 0], q=v[:, 1:8], dq=v[:, 8:15], tau=v[:, 15:])
    named = dict(zip(HEADER.split(","), v.T, strict=True))
    np.savez_compressed(tmp_path / "columns.npz", **named)
    parquet.write_table(pa.table(named), tmp_path / "log.parquet")
    quoted = ",".join(f'"{name}"' for name in HEADER.split(","))
    others = {
        "LOG.CSV.GZ": gzip.compress(text.encode()),
        "crlf.csv": text.replace("\n", "\r\n"),
        "bom.csv": b"\xef\xbb\xbf" + text.encode(),
        "no_end.csv": text.rstrip("\n"),
        "blank_lines.csv": "\n\n" + text.replace("\n", "\n\n", 30),
        "spaces.csv": text.replace(",", " , "),
        "utf16.csv": text.encode("utf-16"),
        "utf16.csv.gz": gzip.compress(text.encode("utf-16-le")),
        "semicolons.csv": text.replace(",", ";"),
        "commas.csv": "sep=;\n" + text.replace(",", ";").replace(".", ","),
        "tabs.tsv": text.replace(",", "\t"),
        "blanks.txt": "# a robot\n# " + text.replace(",", " "),
        "cut.csv": text + "2.0,0.1,-",
        "quoted.csv": text.replace(HEADER, quoted),
        "numpy.csv": "# " + text,
    }
    files = [put(tmp_path / name, data) for name, data in others.items()]
    files += [tmp_path / name for name in ("matrices.npz", "columns.npz", "log.parquet")]
    for path in files:
        assert_holds(read(path), v)


def test_columns_in_any_order_and_others_ignored(tmp_path: Path) -> None:
    order = np.random.default_rng(0).permutation(22)
    names = np.array(HEADER.split(","))
    mixed = text_of(VALUES[:, order], ",".join(names[order])).splitlines()
    lines = [f"{line},{'note' if i == 0 else 'a b'}," for i, line in enumerate(mixed)]
    other = read(put(tmp_path / "mixed.csv", "\n".join(lines)))
    assert_holds(other, np.loadtxt(GOOD.splitlines()[1:], delimiter=","))
    assert other.warnings == ("columns not used: 'note'",)


def test_extra_channels_are_taken_along(tmp_path: Path) -> None:
    warm = np.full((200, 7), np.nan)
    warm[::50] = 30 + np.arange(4)[:, None]
    data = np.column_stack([VALUES, warm, VALUES[:, 15:] + 1])
    header = header_of("q", "dq", "tau", "temperature", "tau_cmd")
    text = text_of(data, header).replace("nan", "")
    log = read(put(tmp_path / "log.csv", text))
    assert set(log.extra) == {"temperature", "tau_cmd"}
    assert np.allclose(log.extra["tau_cmd"], log.tau + 1)
    # Temperatures come once in half a second: lines between them, the last one held.
    assert np.allclose(log.extra["temperature"][[0, 25, 199], 2], [30, 30.5, 33])
    assert log.corrections == ()


def test_runs_with_a_clock_of_their_own(tmp_path: Path) -> None:
    """Two recordings in one file: time goes on rising, the second begins a segment."""
    v = np.vstack([VALUES, VALUES[:150]])
    names = ["run", *(["slow"] * 200), *(["fast"] * 150)]
    lines = [f"{a},{b}" for a, b in zip(names, text_of(v).splitlines(), strict=True)]
    log = read(put(tmp_path / "log.csv", "\n".join(lines)))
    assert log.breaks == (200,)
    assert log.segments == (slice(0, 200), slice(200, 350))
    assert np.all(np.diff(log.t) > 0)
    assert log.t[200] - log.t[199] == pytest.approx(1)
    assert [m.kind for m in log.corrections] == ["run"]
    run = np.array(names[1:])
    np.savez(tmp_path / "log.npz", run=run, t=v[:, 0], q=v[:, 1:8], tau=v[:, 15:])
    assert read(tmp_path / "log.npz").breaks == (200,)


def test_a_robot_at_rest_is_a_log(tmp_path: Path) -> None:
    """Nothing moves and the torque is noise: that is for the diagnosis to say, not an error."""
    v = good_values()
    v[:, 1:15] = 0
    v[:, 4], v[:, 6] = -1.5, 1.5
    log = read(put(tmp_path / "log.csv", text_of(v)))
    assert any("no q ever changes" in w for w in log.warnings)


def test_poses_at_rest(tmp_path: Path) -> None:
    v = good_values(20)
    header = header_of("q", "tau").removeprefix("t,")
    lines = text_of(np.column_stack([v[:, 1:8], v[:, 15:]]), header)
    text = "\n".join(f"{'A' if i else 'session'},{x}" for i, x in enumerate(lines.splitlines()))
    log = read_poses(put(tmp_path / "poses.csv", text), 7, limits=LIMITS)
    assert log.static
    assert_holds(log, v, "q tau", rtol=1e-8, atol=1e-8)
    assert np.array_equal(log.t, np.arange(20))
    refuses(lambda: read(tmp_path / "poses.csv"), "missing column 't'")
    one = put(tmp_path / "one.csv", "\n".join(text.splitlines()[:2]))
    refuses(lambda: read_poses(one, 7), "1 pose: expected two")
