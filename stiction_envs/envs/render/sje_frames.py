"""Frames of the SJE: the arm, the angle of the joint under test, its dither, torque and angle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from PIL import ImageDraw

from stiction_envs.arrays import Array
from stiction_envs.envs.render.arm_scene import MARK, PATH, ArmScene, ball, connect, polyline
from stiction_envs.envs.render.env_frames import HEIGHT, PANEL_WIDTH, Frame, Renderer
from stiction_envs.envs.render.panel import BAND, BLUE, ORANGE, SOFT, Plot, round_up
from stiction_envs.envs.render.video import Video
from stiction_envs.experiments.sje.episodes import RampTrace
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Measurement, Protocol

if TYPE_CHECKING:
    from stiction_envs.experiments.sje.episodes import SJEEpisodes

# what follows is assumed: chosen by eye
_RING = 36  # number of segments
_SIZE = 0.15  # radius of the ring over the extent of the arm, at most 1 m [-]
_FAN = 12  # number of lines that fill the angle
_FILL = np.array([1.0, 0.62, 0.25, 1.0], dtype=np.float32)


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """One ramp of one configuration, so far."""

    robot: str
    configuration: Configuration
    position: Array
    """(n,) joint angles [rad]."""
    trace: RampTrace
    protocol: Protocol
    base: float
    """Torque at which the joint breaks away without dither [N·m]; NaN where it does not."""
    tau: float
    """Torque at which it broke away [N·m]; NaN where it has not."""
    over: bool


class JointRenderer(Renderer[Ramp]):
    """Draws the SJE."""

    @staticmethod
    def state(core: SJEEpisodes, i: int) -> Ramp:
        """Return the present moment of episode ``i``."""
        assert core.trace is not None
        return Ramp(
            robot=core.arm.name,
            configuration=core.configuration[i],
            position=core.rig.plant.position[i],
            trace=core.trace[i],
            protocol=core.rig.protocol,
            base=float(core.tau_base[i]),
            tau=float(core.rig.tau[i]),
            over=not core.alive[i],
        )

    def _decorate(self, scene: mujoco.MjvScene, state: Ramp) -> None:
        c, moved = state.configuration, state.trace.displacement
        angle = moved[-1] if moved else 0.0
        draw_joint(scene, self._arm, c.joint - 1, angle, c.sign * state.protocol.threshold)

    def _lines(self, state: Ramp) -> list[str]:
        trace, c = state.trace, state.configuration
        dither = "no dither on this joint"
        if trace.time and trace.amplitude[-1] != 0:
            dither = f"dither {trace.amplitude[-1]:.2f} N·m at {trace.frequency[-1]:.0f} Hz"
        pose = "load pose" if c.load == "load" else "no-load pose"
        if not state.over:
            now = "at rest"
            if trace.time:
                now = f"ramp: {trace.time[-1]:.1f} s, {trace.torque[-1]:+.2f} N·m"
        elif np.isfinite(state.tau):
            now = f"broke away at {state.tau:+.2f} N·m (base {state.base:+.2f})"
        else:
            now = "given up"
        title = f"{state.robot}  joint {c.joint}"
        return [title, f"{pose}, direction {c.direction}", dither, now]

    def _plot(self, draw: ImageDraw.ImageDraw, state: Ramp) -> None:
        trace, right = state.trace, PANEL_WIDTH - 14
        base = state.base if np.isfinite(state.base) else 0.0
        threshold = state.configuration.sign * state.protocol.threshold
        time, moved = np.array(trace.time), np.array(trace.displacement)
        torque, size = np.array(trace.torque), np.array(trace.amplitude)
        end = round_up(max([1.0, 1.2 * abs(base) / state.protocol.ramp_rate, *time[-1:]]))
        edges = [-0.01, 0.01, 1.25 * base, *(torque - size), *(torque + size)]
        limits = min(edges), max(edges)
        top = Plot(draw, (58, 112, right, 254), (0.0, end), limits, "torque [N·m]")
        if base:
            top.level(base, SOFT, "τ_base")
        if len(time):
            top.band(time, torque - size, torque + size, BAND)
            top.line(time, torque, BLUE)
        top.legend([("with dither", BAND), ("without", BLUE)])
        edges = [-0.02, 0.02, 1.2 * threshold, *moved]
        limits, below = (min(edges), max(edges)), (58, 296, right, HEIGHT - 42)
        bottom = Plot(draw, below, (0.0, end), limits, "angle since start [rad]")
        bottom.level(threshold, SOFT, "threshold")
        if len(time):
            bottom.line(time, moved, ORANGE)
        bottom.time_label()


def draw_joint(
    scene: mujoco.MjvScene, arm: ArmScene, joint: int, angle: float, threshold: float
) -> None:
    """Draw a ring about the axis of a joint (from 0), with an arrow along its push and a pointer.

    ``angle`` is the joint's since it rested, ``threshold`` that of breakaway, signed [rad].
    """
    arm.draw_chain(scene)
    index = arm.joints[joint]
    centre, axis = arm.data.xanchor[index], arm.data.xaxis[index]
    first = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    radius = _SIZE * max(0.3, min(1.0, float(np.ptp(arm.points, axis=0).max())))

    def at(turn: float, share: float = 1.0) -> Array:
        out: Array = centre + share * radius * (np.cos(turn) * first + np.sin(turn) * second)
        return out

    side = float(np.sign(threshold))
    turns = side * np.linspace(0, 1.75 * np.pi, _RING)
    polyline(scene, 0.06 * radius, np.array([at(turn) for turn in turns]))
    tangent = side * (np.cos(turns[-1]) * second - np.sin(turns[-1]) * first)
    arrow = mujoco.mjtGeom.mjGEOM_ARROW
    connect(scene, arrow, 0.12 * radius, at(turns[-1]), at(turns[-1]) + 0.45 * radius * tangent)
    ends = np.array([centre - 1.3 * radius * axis, centre + 1.3 * radius * axis])
    polyline(scene, 0.03 * radius, ends)
    for turn in np.linspace(0.0, angle, _FAN):
        polyline(scene, 0.02 * radius, np.array([centre, at(turn, 1.5)]), _FILL)
    for turn in (0.0, threshold):
        polyline(scene, 0.03 * radius, np.array([centre, at(turn, 1.6)]), PATH)
    polyline(scene, 0.05 * radius, np.array([centre, at(angle, 1.6)]))
    ball(scene, 0.12 * radius, at(angle, 1.6), MARK)


def sje_video(experiment: SingleJointExperiment, measurements: Sequence[Measurement]) -> Video:
    """Return the first ramp of each measurement of one configuration, without dither first.

    The configuration is the first one with dither, else the first.
    """
    dithered = [m for m in measurements if not m.is_base]
    c = (dithered or list(measurements))[0].job.configuration
    mine = [m for m in measurements if m.job.configuration == c]
    mine.sort(key=lambda m: m.is_base, reverse=True)
    base = float(mine[0].tau[0]) if mine[0].is_base else float("nan")
    renderer = JointRenderer(experiment.sticking.arm)
    runs = [_run(experiment, m, base, renderer) for m in mine]
    longest = max(len(m.traces[0]) * m.trace_dt for m in mine)
    return Video(runs=runs, duration=longest, close=renderer.close)


def _run(
    experiment: SingleJointExperiment, m: Measurement, base: float, renderer: JointRenderer
) -> Callable[[float], Frame]:
    """Return a function that draws the first ramp of a measurement at a time [s]."""
    from stiction_envs.experiments.sje.plots import ramps  # loads Matplotlib

    c, protocol = m.job.configuration, experiment.protocol
    along, angle = ramps(m, protocol.ramp_rate)[0]
    moved = angle - m.start[0]
    joint, load, _ = c.index
    time = m.trace_dt * np.arange(1, len(along) + 1)

    def draw(t: float) -> Frame:
        k = int(np.searchsorted(time, t + 1e-9, side="right"))
        position = experiment.poses.q[joint, load].copy()
        position[joint] += angle[max(k - 1, 0)]
        trace = RampTrace(
            time=list(time[:k]),
            torque=list(c.sign * along[:k]),
            amplitude=[m.job.amplitude_nm] * k,
            frequency=[m.job.frequency_hz] * k,
            displacement=list(moved[:k]),
        )
        over = k == len(time)
        state = Ramp(
            robot=experiment.sticking.arm.name,
            configuration=c,
            position=position,
            trace=trace,
            protocol=protocol,
            base=base,
            tau=float(m.tau[0]) if over else float("nan"),
            over=over,
        )
        return renderer.picture(state)

    return draw
