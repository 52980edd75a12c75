"""A diagnosis as a recording of Rerun: series, contact, evidence and the arm in 3-D."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError, missing_extra
from stiction_envs.gap.report.series import Series
from stiction_envs.reporting.output_folder import check_file
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Rerun = Any
"""Objects of Rerun, and arrays for them: Rerun's types are there with the extra only."""
WIDTH = 0.02
"""Radius of the line that an arm is drawn as, over its length [-]; assumed."""
Colour = tuple[int, int, int]
"""Red, green, blue [0 to 255]."""
TIMELINE = "time"
BEFORE: Colour = (224, 108, 24)
AFTER: Colour = (70, 140, 220)
MEASURED: Colour = (160, 160, 160)
"""Colours of the report's pictures, lighter, since Rerun's viewer is dark."""
COMMANDED: Colour = (110, 110, 110)
CAUSES: tuple[Colour, ...] = (
    *((214, 39, 140), (44, 160, 44), (188, 189, 34)),
    *((148, 103, 189), (23, 190, 207), (227, 119, 194)),
)
"""Colours of causes, in turn."""


def check_rrd(path: Path, *, force: bool = False, made: Path | None = None) -> None:
    """Raise if a recording cannot be written.

    Args:
        path: the file.
        force: whether it may replace another.
        made: a folder that will be there.

    Raises:
        StictionError: Rerun's SDK is not installed, or the name or place is wrong.
    """
    try:
        import rerun  # noqa: F401
    except ImportError:
        raise missing_extra("writing for Rerun", "rerun-sdk", "rerun") from None
    check_file(path, ".rrd", force=force)
    if not path.parent.is_dir() and (made is None or path.parent.resolve() != made.resolve()):
        raise StictionError(f"output {path}: {path.parent}: expected a folder that is there")


def rrd_bytes(s: Series, words: str) -> bytes:
    """Return the file, with ``words`` in Markdown; starts no viewer and opens no connection."""
    import rerun as rr

    recording = rr.RecordingStream(f"stiction_envs {s.arm.name}", send_properties=False)
    kept = recording.memory_recording()
    for group, drawn in _lines(s).items():
        for j in range(s.arm.n):
            alone = {name: (values[:, j], colour) for name, (values, colour) in drawn.items()}
            _send_lines(recording, f"{group}/joint_{j + 1}", s.time, alone)
    if s.contact is not None:
        _send_lines(recording, "contact", s.time, {"contact": (s.contact.astype(float), BEFORE)})
    text = f"# {s.arm.name}\n\n{words}"
    if s.quantity == "torque":
        text += "\n\nTorques are simulated along the measured motion: one arm is drawn."
    recording.log("diagnosis", rr.TextDocument(text, media_type="text/markdown"), static=True)
    _send_arm(recording, "arm/measured", s, s.q, MEASURED)
    if s.quantity == "angle":
        _send_arm(recording, "arm/simulated", s, s.simulated, AFTER)
    recording.send_blueprint(_blueprint(s))
    recording.flush()
    return bytes(kept.drain_as_bytes())


def _lines(s: Series) -> dict[str, dict[str, tuple[Array, Colour]]]:
    """Return (T, n) values and colour of each line by name, by group."""
    commanded = {} if s.q_cmd is None else {"commanded": (s.q_cmd, COMMANDED)}
    models = {"nominal": (s.nominal, BEFORE), "simulated": (s.simulated, AFTER)}
    left = {name: (s.measured - x, colour) for name, (x, colour) in models.items()}
    causes = {
        name: (torque, colour)
        for (name, torque), colour in zip(s.causes.items(), cycle(CAUSES), strict=False)
    }
    measured = {"measured": (s.measured, MEASURED)}
    out = {s.quantity: commanded | measured | models, "residual": left}
    return out | ({"cause": causes} if causes else {})


def _send_lines(
    recording: Rerun, path: str, time: Array, drawn: dict[str, tuple[Array, Colour]]
) -> None:
    """Send (T,) values of lines that are drawn together, and how."""
    import rerun as rr

    values = np.stack([x for x, _ in drawn.values()], axis=1)
    look = rr.SeriesLines(colors=[colour for _, colour in drawn.values()], names=list(drawn))
    recording.log(path, look, static=True)
    clock = rr.TimeColumn(TIMELINE, duration=time)
    recording.send_columns(path, [clock], rr.Scalars.columns(scalars=values))


def _blueprint(s: Series) -> Rerun:
    """Return the layout of the viewer: arm and words beside a tab for each joint."""
    import rerun.blueprint as rrb

    def joint(j: int) -> Rerun:
        of = f"joint_{j + 1}"
        groups = [(s.quantity, f"{s.quantity} [{s.unit}]"), ("residual", f"residual [{s.unit}]")]
        if s.causes:
            groups.append(("cause", "torque of each cause [N·m]"))
        views = [rrb.TimeSeriesView(origin=f"{g}/{of}", name=title) for g, title in groups]
        if s.contact is not None and s.contact.any():
            views.append(rrb.TimeSeriesView(origin="contact", name="touches something"))
        return rrb.Vertical(*views, name=f"joint {j + 1}")

    left = rrb.Vertical(
        rrb.Spatial3DView(origin="arm", name="arm"),
        rrb.TextDocumentView(origin="diagnosis", name="diagnosis"),
    )
    joints = rrb.Tabs(*(joint(j) for j in range(s.arm.n)))
    return rrb.Blueprint(rrb.Horizontal(left, joints), auto_views=False)


def _send_arm(recording: Rerun, path: str, s: Series, q: Array, colour: Colour) -> None:
    """Send the arm at angles (T, n) [rad] as a line from base to flange."""
    import rerun as rr

    line = skeleton(s.arm, q)
    reach = np.linalg.norm(np.diff(line[0], axis=0), axis=1).sum()
    look = rr.LineStrips3D.from_fields(radii=[WIDTH * reach], colors=[colour])
    recording.log(path, look, static=True)
    clock = rr.TimeColumn(TIMELINE, duration=s.time)
    recording.send_columns(path, [clock], rr.LineStrips3D.columns(strips=list(line)))


def skeleton(arm: Arm, q: Array) -> Array:
    """Return (T, n + 2, 3) places of the base, the joints and the flange at (T, n) angles [m]."""
    model = arm.model()
    data = mujoco.MjData(model)
    flange = model.site(arm.end_effector).id
    out = np.empty((len(q), arm.n + 2, 3))
    for k, angles in enumerate(q):
        data.qpos[:] = angles
        mujoco.mj_kinematics(model, data)
        out[k, 0] = data.xpos[model.body_parentid[model.jnt_bodyid[0]]]
        out[k, 1:-1], out[k, -1] = data.xanchor, data.site_xpos[flange]
    return out
