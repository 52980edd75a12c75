"""Frames of the GTE: the arm, the path through its goals, where it is, its errors and dither."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from PIL import ImageDraw

from stiction_envs.arrays import Array
from stiction_envs.control.rotation import from_rpy, to_matrix
from stiction_envs.envs.render.arm_scene import MARK, PATH, ball, connect, polyline
from stiction_envs.envs.render.env_frames import HEIGHT, PANEL_WIDTH, Frame, Renderer
from stiction_envs.envs.render.panel import (
    BAND,
    BLUE,
    GRID,
    INK,
    PURPLE,
    SOFT,
    Plot,
    font,
    round_up,
)
from stiction_envs.envs.render.video import Video
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import Case, Run, Stiffness
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.experiments.gte.rows import case_name
from stiction_envs.experiments.observation import STICTION_FACTOR, largest_stiction
from stiction_envs.experiments.poses import find_poses
from stiction_envs.experiments.rig import dither_arrays
from stiction_envs.plant import CONTROL_DT

if TYPE_CHECKING:
    from stiction_envs.experiments.gte.episodes import GTEEpisodes

_AXES = np.array(
    [[0.85, 0.15, 0.15, 1.0], [0.1, 0.6, 0.2, 1.0], [0.15, 0.3, 0.9, 1.0]], dtype=np.float32
)
# what follows is assumed: chosen by eye
_TRAIL = 400  # most segments of the tool point's trail
_LINE, _GOAL, _AXIS = 0.0025, 0.009, 0.12  # radius of lines and goals, length of an axis [m]
_NEARER = 0.8  # camera's distance over that for any pose [-]: the arm keeps its shape
_SAMPLE = 0.05  # between two poses of a video [s]


@dataclass(frozen=True, kw_only=True)
class Motion:
    """One run along one path, so far."""

    title: str
    stiffness: Stiffness
    start: Array
    """(n,) joint angles at the start [rad]."""
    position: Array
    """(n,) joint angles [rad]."""
    path: Array
    """(goals + 1, 3) start and goals [m]."""
    reached: int
    accepted: Array
    """(goals,) when each was accepted [s]; NaN where it was not."""
    reference: Array
    """(3,) where the tool point should be [m]."""
    turn: Array
    """(3, 3) how the hand should be oriented; columns are its axes."""
    trail: Array
    """(K, 3) where the tool point was [m]."""
    time: Array
    """(S,) of the errors [s]."""
    error: Array
    """(S, 6) position [m] and orientation [rad] less the reference's."""
    tolerance: Array
    """(2,) errors that are always on the plots [m], [rad]."""
    end: float
    """When the undithered run ends [s]."""
    amplitude: Array
    """(n,) of the dither [N·m]."""
    frequency: Array
    """(n,) of the dither [Hz]."""
    most: Array
    """(n,) amplitude that fills a bar [N·m]."""
    now: str


class PathRenderer(Renderer[Motion]):
    """Draws the GTE."""

    @staticmethod
    def state(core: GTEEpisodes, i: int) -> Motion:
        """Return the present moment of episode ``i``."""
        assert core.recorder.trace is not None
        rig, n, trace = core.rig, core.n, core.recorder.trace[i]
        trajectory, stiffness = core.case[i]
        t = np.multiply(rig.step, CONTROL_DT, dtype=np.float64)
        x, quaternion, _, _ = rig.sequencer.reference(t)
        reached, goals = int(rig.sequencer.index[i]), int(core.goals[i])
        now = f"on the way to goal {reached + 1} of {goals}, {t[i]:.1f} s"
        if not core.alive[i]:
            ratio = core.tracking_error(np.array([i]))[0]
            now = f"over: error {100 * ratio:.0f} % of undithered"
        elif reached == goals:
            now = f"last goal reached, {t[i]:.1f} s"
        return Motion(
            title=f"{core.arm.name}  {trajectory}",
            stiffness=stiffness,
            start=rig.start,
            position=rig.plant.position[i],
            path=core.path_points(i),
            reached=reached,
            accepted=rig.sequencer.accepted_at[i],
            reference=x[i],
            turn=to_matrix(quaternion[i]),
            trail=np.concatenate([*trace.position, rig.end_effector.position[i][None]]),
            time=np.concatenate([np.zeros(0), *trace.time]),
            error=np.concatenate([np.zeros((0, 6)), *trace.error]),
            tolerance=np.array(core.tolerance),
            end=core.undithered_duration(i),
            amplitude=core.action[i, :n],
            frequency=core.action[i, n : 2 * n],
            most=core.action_space.high[:n].astype(float),
            now=now,
        )

    def _camera(self, state: Motion) -> mujoco.MjvCamera:
        """Return a camera that sees the path and the arm at its start, so that it rests."""
        self._arm.pose(state.start)
        camera = self._arm.camera(np.vstack([state.path, self._arm.points]))
        self._arm.pose(state.position)
        camera.distance *= _NEARER
        return camera

    def _decorate(self, scene: mujoco.MjvScene, state: Motion) -> None:
        self._arm.draw_chain(scene)
        polyline(scene, _LINE, state.path, PATH)
        for k, goal in enumerate(state.path[1:]):
            aim = k == state.reached
            ball(scene, _GOAL * (1.6 if aim else 1.0), goal, MARK if aim else PATH)
        trail = state.trail
        polyline(scene, _LINE, np.vstack([trail[:: 1 + len(trail) // _TRAIL], trail[-1:]]))
        arrow, x = mujoco.mjtGeom.mjGEOM_ARROW, state.reference
        for axis, colour in zip(state.turn.T, _AXES, strict=True):
            connect(scene, arrow, 2.0 * _LINE, x, x + _AXIS * axis, colour)

    def _lines(self, state: Motion) -> list[str]:
        translational, rotational, nullspace = state.stiffness
        stiffness = f"stiffness {translational:g} N/m, {rotational:g} N·m/rad"
        stiffness += f", {nullspace:g} N·m/rad" if nullspace else ""
        return [state.title, stiffness, state.now]

    def _plot(self, draw: ImageDraw.ImageDraw, state: Motion) -> None:
        right, time, error = PANEL_WIDTH - 14, state.time, state.error
        end = round_up(max([state.end, *time[-1:]]))
        accepted = state.accepted[np.isfinite(state.accepted) & (state.accepted > 0)]
        for top, part, title, least in (
            (94, error[:, :3], "distance from reference [mm]", state.tolerance[0]),
            (222, error[:, 3:], "rotation from reference [mrad]", state.tolerance[1]),
        ):
            size = 1e3 * np.sqrt((part**2).sum(axis=1))
            high = max([1e3 * least, *(1.1 * size)])
            plot = Plot(draw, (58, top, right, top + 96), (0.0, end), (0.0, high), title)
            plot.marks(accepted, PURPLE)
            plot.legend([("new goal", PURPLE)] if top < 200 else [])
            if len(time):
                plot.line(time, size, BLUE)
        plot.time_label()
        self._bars(draw, state, (58, 380, right, HEIGHT - 38))

    def _bars(
        self, draw: ImageDraw.ImageDraw, state: Motion, box: tuple[int, int, int, int]
    ) -> None:
        """Draw amplitude (share of A_max) and frequency of every joint's dither."""
        left, top, right, bottom = box
        text = "dither: share of A_max, frequency [Hz]"
        draw.text((14, top - 20), text, font=font(12), fill=INK)
        share = np.minimum(state.amplitude / state.most, 1.0)
        pitch = (right - left) / len(share)
        draw.rectangle(box, outline=SOFT)
        for j in range(len(share)):
            low, high = left + (j + 0.18) * pitch, left + (j + 0.82) * pitch
            middle = 0.5 * (low + high)
            draw.rectangle((low, top + 1, high, bottom - 1), fill=GRID)
            if share[j] > 0:
                edge = bottom - share[j] * (bottom - top - 1)
                draw.rectangle((low, min(edge, bottom - 1), high, bottom - 1), fill=BAND)
                draw.line((low, edge, high, edge), fill=BLUE, width=2)
                place, hertz = (middle, bottom + 18), state.frequency[j]
                draw.text(place, f"{hertz:.0f}", font=font(11), fill=INK, anchor="mt")
            draw.text((middle, bottom + 4), f"J{j + 1}", font=font(11), fill=SOFT, anchor="mt")


def gte_video(experiment: GeneratedTrajectoryExperiment, cases: Sequence[Case]) -> Video:
    """Return the first iteration of every case of one path.

    Runs do not keep joint angles: the iteration is run again, which is the same bits.
    """
    poses: list[Array] = []
    paths: list[Array] = []

    def steering(rig: GTERig, _: Sequence[Case]) -> Callable[[], None]:
        home, turned = rig.start_position[None], rig.start_quaternion[None]
        goals, _turns = experiment.path(cases[0].trajectory).goals(home, turned)
        paths.append(np.vstack([home, goals[0]]))
        return lambda: poses.append(rig.plant.position.copy())

    runs = experiment.run(cases, iterations=1, steering=steering, interval=_SAMPLE)
    positions = np.stack(poses, axis=1)
    renderer = PathRenderer(experiment.sticking.arm)
    return Video(
        runs=[
            _drawing(experiment, run, positions[i], paths[0], float(runs[0].time[-1]), renderer)
            for i, run in enumerate(runs)
        ],
        duration=max(float(run.time[-1]) for run in runs),
        close=renderer.close,
    )


def _drawing(
    experiment: GeneratedTrajectoryExperiment,
    run: Run,
    positions: Array,
    path: Array,
    end: float,
    renderer: PathRenderer,
) -> Callable[[float], Frame]:
    """Return a function that draws the first iteration of a run at a time [s].

    Joint angles are (K, n), one per `_SAMPLE` [rad]; the undithered run ends at ``end`` [s].
    """
    arm, case, e = experiment.sticking.arm, run.case, experiment
    stiction = largest_stiction(e.sticking.parameters, find_poses(arm))
    dither = dither_arrays(case.dither, e.n)
    amplitude, frequency = (
        np.array(dither[name], dtype=float) for name in ("amplitude", "frequency")
    )

    def draw(t: float) -> Frame:
        k = max(1, int(np.searchsorted(run.time, t + 1e-9, side="right")))
        x = run.reference[0, k - 1]
        off = 1e3 * float(np.linalg.norm(run.error[0, k - 1, :3]))
        state = Motion(
            title=f"{arm.name}  {case.trajectory}, {case_name(case).replace('_', ' ')}",
            stiffness=case.stiffness,
            start=e.start,
            position=positions[min(round(t / _SAMPLE), len(positions) - 1)],
            path=path,
            reached=int(np.sum(run.reached[0] <= t)),
            accepted=run.accepted[0][run.accepted[0] <= t],
            reference=x[:3],
            turn=to_matrix(from_rpy(x[3:])),
            trail=run.actual[0, :k, :3],
            time=run.time[:k],
            error=run.error[0, :k],
            tolerance=np.array([e.motion.position_tolerance, e.motion.rotation_tolerance]),
            end=end,
            amplitude=amplitude,
            frequency=frequency,
            most=np.minimum(e.interface.torque_limit, STICTION_FACTOR * stiction),
            now=f"{run.time[k - 1]:.1f} s, {off:.1f} mm off",
        )
        return renderer.picture(state)

    return draw
