"""Read, check and correct joint logs of real robots; every correction is recorded.

A log is a table ``t,q1..qn,dq1..dqn,tau1..taun`` [s, rad, rad/s, N·m]; dq may be missing,
``temperature1..n`` and ``tau_cmd1..n`` are taken along, a column ``run`` names recordings that
were put into one file. ``tau`` drives the joint: M(q)q̈ + C(q,q̇)q̇ + g(q) = tau − tau_friction.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.measured.checks.logs import check_channels, check_finite, check_units
from stiction_envs.measured.logs.corrections import (
    Correction,
    Rows,
    correct_stale,
    drop_repeats,
    fill_missing,
)
from stiction_envs.measured.logs.files import read_raw
from stiction_envs.measured.logs.formats.base import RawLog
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.robot_log import JointLog
from stiction_envs.measured.logs.timing import corrected, ignored, read_each
from stiction_envs.measured.settings import MotionThresholds, measured_settings

if TYPE_CHECKING:
    from stiction_envs.robots.tables import Limits

__all__ = ["Correction", "JointLog", "read_logs", "read_poses"]

Path = str | os.PathLike[str]


def read_logs(
    paths: Sequence[Path],
    n_joints: int,
    *,
    limits: Limits | None = None,
    naming: Naming | None = None,
    motion: MotionThresholds | None = None,
) -> list[JointLog]:
    """Read, check and correct the logs of one robot.

    Args:
        paths: one or more of the files of `formats.registry`.
        n_joints: joints of the robot.
        limits: its limits; without them fewer wrong units are seen.
        naming: names of its joints, for bags.
        motion: when a joint moves; None for ``[motion]`` of ``settings.toml``.

    Raises:
        StictionError: a file cannot be read, is no log of this robot, or cannot be a measurement.
            The message names file, row and column.
    """
    thresholds = motion or measured_settings().motion

    def read(path: Path) -> JointLog:
        return _corrected(read_raw(path, n_joints, naming=naming), limits, thresholds)

    return read_each(paths, read)


def read_poses(
    path: Path,
    n_joints: int,
    *,
    limits: Limits | None = None,
    naming: Naming | None = None,
) -> JointLog:
    """Read poses at rest without time: ``q1..qn,tau1..taun``, one pose in a row.

    Raises:
        StictionError: as :func:`read_logs`; also for fewer than two poses.
    """
    raw = read_raw(path, n_joints, time=False, naming=naming)
    rows = Rows(t=raw.t, data=raw.data, run=raw.run)
    check_finite(rows, raw.place)
    corrections, warnings = fill_missing(rows, raw.place)
    if len(rows.t) < 2:
        raise StictionError(f"{raw.source}: {len(rows.t)} pose: expected two or more")
    rows.data.pop("dq", None)
    warnings += check_units(rows, raw.place, limits)
    return JointLog(
        source=raw.source,
        t=np.arange(float(len(rows.t))),
        q=rows.data.pop("q"),
        dq=None,
        tau=rows.data.pop("tau"),
        extra=rows.data,
        corrections=(*raw.notes, *corrections),
        warnings=(*ignored(raw), *warnings),
        side=raw.side,
        static=True,
    )


def _corrected(raw: RawLog, limits: Limits | None, motion: MotionThresholds) -> JointLog:
    def check(rows: Rows) -> list[str]:
        return check_units(rows, raw.place, limits) + check_channels(rows, raw.place, motion)

    common, data = corrected(raw, limits, motion, check, correct=(drop_repeats, correct_stale))
    return JointLog(**common, tau=data.pop("tau"), extra=data, side=raw.side)
