"""The Generated Trajectory Experiment as a film: the path, and where the tool point went.

Runs do not keep joint angles: the film runs their first iteration again, which is the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from stiction_envs.envs.render.panel import (
    BLUE,
    INK,
    ORANGE,
    PAPER,
    PURPLE,
    SOFT,
    Plot,
    font,
)
from stiction_envs.envs.render.scene import MARK, PATH, ArmScene, ball, connect
from stiction_envs.envs.render.timing import Timing
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import Case, Run
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.experiments.gte.rows import case_name
from stiction_envs.robots.registry import arm_title

Array = NDArray[np.float64]
WIDTH, HEADER, SCENE, BELOW = 480, 62, 320, 178
"""Of a column: its width; heights of title, arm and plot [pixel]."""
_SAMPLE = 0.05  # between two arms that are kept [s]
_LINE, _GOAL = 0.0022, 0.007  # radius of lines and goals [m]
_TRAIL = 300  # segments at most
_ALPHA = 0.25  # of the arm, which is above its path
_ELEVATION, _ASIDE = -48.0, 35.0  # of the camera, from the side to which the arm points [°]


class PathVideo:
    """Frames of one path; a column for each case."""

    def __init__(
        self,
        experiment: GeneratedTrajectoryExperiment,
        cases: Sequence[Case],
        *,
        fps: float = 10.0,
        most: float = 20.0,
    ) -> None:
        """Run the cases once; OpenGL is not touched yet.

        Args:
            experiment: that runs them.
            cases: of one path.
            fps: frames per second.
            most: length of the film [s]; what takes longer is shown faster.

        Raises:
            StictionError: as `GeneratedTrajectoryExperiment.run`.
            ExperimentError: a simulation that the engine stopped.
        """
        self._arm, self._start = experiment.sticking.arm, experiment.start
        kept: list[Array] = []
        corners: list[Array] = []

        def steering(rig: GTERig, _: Sequence[Case]) -> Callable[[], None]:
            path = experiment.path(cases[0].trajectory)
            home, turned = rig.start_position[None], rig.start_quaternion[None]
            corners.append(np.vstack([home, path.goals(home, turned)[0].reshape(-1, 3)]))
            return lambda: kept.append(rig.plant.position.copy())

        self._runs = experiment.run(cases, iterations=1, steering=steering, interval=_SAMPLE)
        self._path = corners[0]
        self._q = np.stack(kept, axis=1)
        self._titles = [case_name(c).replace("_", " ") for c in cases]
        self._heading = f"{arm_title(self._arm.name)}, {cases[0].trajectory}"
        kt, kr, kn = cases[0].stiffness
        self._stiffness = f"{kt:g} N/m, {kr:g} N·m/rad" + (f", {kn:g} N·m/rad" if kn else "")
        self._away = [1e3 * np.linalg.norm(r.error[0, :, :3], axis=1) for r in self._runs]
        self._end = max(float(r.time[-1]) for r in self._runs)
        self.timing = Timing(self._end, fps=fps, most=most)
        self.size = (WIDTH * len(self._runs), HEADER + SCENE + BELOW)
        """Width and height of a frame [pixel]."""

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """Yield the frames, (height, width, 3).

        Raises:
            StictionError: no OpenGL.
        """
        scene = ArmScene(self._arm, WIDTH, SCENE)
        try:
            scene.pose(self._start)
            scene.fade(_ALPHA)
            camera = self._camera(scene)
            for t in self.timing.times():
                columns = [self._column(scene, camera, i, t) for i in range(len(self._runs))]
                yield np.concatenate(columns, axis=1)
        finally:
            scene.close()

    def _camera(self, scene: ArmScene) -> mujoco.MjvCamera:
        """Return a camera near enough to see by how much the tool point is off the path."""
        camera = scene.camera(scene.points)
        low, high = self._path.min(axis=0), self._path.max(axis=0)
        camera.lookat = (low + high) / 2
        camera.distance = scene.distance(0.55 * float(np.linalg.norm(high - low)) + 0.05)
        camera.azimuth += 60.0 + _ASIDE  # `scene.camera` has turned by 120 already
        camera.elevation = _ELEVATION
        return camera

    def _column(
        self, scene: ArmScene, camera: mujoco.MjvCamera, i: int, t: float
    ) -> NDArray[np.uint8]:
        run = self._runs[i]
        k = min(int(np.searchsorted(run.time, t, side="right")), len(run.time)) - 1
        scene.pose(self._q[i, min(round(t / _SAMPLE), self._q.shape[1] - 1)])
        picture = scene.picture(camera, lambda drawn: self._decorate(scene, drawn, run, k))
        image = Image.new("RGB", (WIDTH, HEADER + SCENE + BELOW), PAPER)
        image.paste(Image.fromarray(picture), (0, HEADER))
        draw = ImageDraw.Draw(image)
        draw.text((14, 7), self._titles[i], font=font(19, bold=True), fill=INK)
        draw.text((14, 35), f"{self._heading}, {self._stiffness}", font=font(14), fill=SOFT)
        place = (WIDTH - 14, 7)
        away = f"{self._away[i][k]:.1f} mm off"
        draw.text(place, away, font=font(19, bold=True), fill=ORANGE, anchor="ra")
        clock = f"{min(t, run.time[-1]):.1f} s{self.timing.faster}"
        draw.text((WIDTH - 14, 35), clock, font=font(14), fill=SOFT, anchor="ra")
        self._error_plot(draw, i, k)
        return np.array(image, dtype=np.uint8)

    def _decorate(self, scene: ArmScene, drawn: mujoco.MjvScene, run: Run, k: int) -> None:
        """Draw the path and its goals, the reference, and where the tool point has been."""
        capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
        scene.draw_chain(drawn, 0.03)
        for a, b in pairwise(self._path):
            connect(drawn, capsule, _LINE, a, b, PATH)
        for goal in self._path[1:]:
            ball(drawn, _GOAL, goal, PATH)
        actual = run.actual[0, : k + 1, :3]
        trail = np.vstack([actual[:: 1 + k // _TRAIL], actual[-1:]])
        for a, b in pairwise(trail):
            connect(drawn, capsule, _LINE, a, b, MARK)
        ball(drawn, _GOAL, run.reference[0, k, :3], PATH)
        ball(drawn, 1.2 * _GOAL, actual[-1], MARK)

    def _error_plot(self, draw: ImageDraw.ImageDraw, i: int, k: int) -> None:
        run, top = self._runs[i], HEADER + SCENE + 28
        high = 1.1 * max(float(a.max()) for a in self._away)
        box = (58, top, WIDTH - 14, HEADER + SCENE + BELOW - 40)
        title = "distance of the tool point from its reference [mm]"
        plot = Plot(draw, box, (0.0, 1.01 * self._end), (0.0, high), title)
        reached = run.reached[0]
        plot.marks(reached[np.isfinite(reached) & (reached <= run.time[k])], PURPLE)
        plot.legend([("goal", PURPLE)])
        if k:
            plot.line(run.time[: k + 1], self._away[i][: k + 1], BLUE)
        plot.time_label()
