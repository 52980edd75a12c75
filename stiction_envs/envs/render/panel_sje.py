"""The panel of the SJE: which joint, how it is dithered, torque and angle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.render.panel import BAND, BLUE, ORANGE, SOFT, Plot, new_panel, round_up
from stiction_envs.envs.trace import RampTrace

if TYPE_CHECKING:
    from stiction_envs.envs.sje_core import SJECore


def draw_sje_panel(core: SJECore, i: int, width: int, height: int) -> NDArray[np.uint8]:
    """Return the panel of simulation ``i``, (height, width, 3)."""
    assert core.trace is not None
    trace, c, base = core.trace[i], core.configuration[i], float(core.tau_base[i])
    pose = "load pose" if c.load == "load" else "no-load pose"
    lines = [
        f"{core.arm.name}  joint {c.joint}",
        f"{pose}, direction {c.direction}",
        _dither_line(trace),
    ]
    image, draw = new_panel(width, height, lines, _state_line(core, i, base))

    time = np.array(trace.time)
    torque, size = np.array(trace.torque), np.array(trace.amplitude)
    ramp = abs(base) / core.rig.protocol.ramp_rate
    end = round_up(max(1.2 * ramp, float(time[-1]) if len(time) else 0.0))
    low, high = min(0.0, 1.25 * base), max(0.0, 1.25 * base)
    if len(time):
        low, high = min(low, float((torque - size).min())), max(high, float((torque + size).max()))
    top = Plot(draw, (58, 112, width - 14, 254), (0.0, end), (low, high), "torque [N·m]")
    top.level(base, SOFT, "τ_base")
    if len(time):
        top.band(time, torque - size, torque + size, BAND)
        top.line(time, torque, BLUE)
    top.legend([("with dither", BAND), ("without", BLUE)])

    threshold = c.sign * core.rig.protocol.threshold
    moved = np.array(trace.displacement)
    low, high = min(-0.02, 1.2 * threshold), max(0.02, 1.2 * threshold)
    if len(time):
        low, high = min(low, float(moved.min())), max(high, float(moved.max()))
    below = (58, 296, width - 14, height - 42)
    bottom = Plot(draw, below, (0.0, end), (low, high), "angle since start [rad]")
    bottom.level(threshold, SOFT, "threshold")
    if len(time):
        bottom.line(time, moved, ORANGE)
    bottom.time_label()
    return np.array(image, dtype=np.uint8)


def _dither_line(trace: RampTrace) -> str:
    if not trace.time or trace.amplitude[-1] == 0:
        return "no dither on this joint"
    return f"dither {trace.amplitude[-1]:.2f} N·m at {trace.frequency[-1]:.0f} Hz"


def _state_line(core: SJECore, i: int, base: float) -> str:
    if core.alive[i]:
        seconds = core.trace[i].time[-1] if core.trace and core.trace[i].time else 0.0
        return f"ramp: {seconds:.1f} s, {core.torque(np.array([i]))[0]:+.2f} N·m"
    tau = float(core.rig.tau[i])
    if not np.isfinite(tau):
        return "given up"
    return f"broke away at {tau:+.2f} N·m (base {base:+.2f})"
