"""The Generated Trajectory Experiment as a film: the path, and where the tool point went.

Runs do not keep joint angles: the film runs their first iteration again, which is the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from stiction_envs.envs.render.arm_scene import MARK, PATH, ArmScene, ball, polyline
from stiction_envs.envs.render.film import HEADER, WIDTH, Film
from stiction_envs.envs.render.panel import BLUE, ORANGE, PURPLE, Colour, Plot
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.experiments.gte.rows import case_name

Array = NDArray[np.float64]
# what follows is assumed: chosen by eye
_SAMPLE = 0.05  # between two poses that are kept [s]
_LINE, _GOAL = 0.0022, 0.007  # radius of lines and goals [m]
_TRAIL = 300  # most segments of the trail
_ALPHA = 0.25  # opacity of the arm, which is above its path [-]
_ELEVATION, _ASIDE = -48.0, 35.0  # of the camera, from the side to which the arm points [°]


class PathFilm(Film):
    """One path; a column for each case."""

    SCENE, PLOTS = 320, 178
    LONGEST = 20.0

    def __init__(
        self,
        experiment: GeneratedTrajectoryExperiment,
        cases: Sequence[Case],
        *,
        fps: float = 10.0,
    ) -> None:
        """Run the cases once; OpenGL is not touched yet.

        Args:
            experiment: that runs them.
            cases: of one path.
            fps: as of `Film`.

        Raises:
            StictionError: as `GeneratedTrajectoryExperiment.run`.
            ExperimentError: a simulation that the engine stopped.
        """
        arm, self._start = experiment.sticking.arm, experiment.start
        poses: list[Array] = []
        corners: list[Array] = []

        def steering(rig: GTERig, _: Sequence[Case]) -> Callable[[], None]:
            path = experiment.path(cases[0].trajectory)
            home, turned = rig.start_position[None], rig.start_quaternion[None]
            corners.append(np.vstack([home, path.goals(home, turned)[0].reshape(-1, 3)]))
            return lambda: poses.append(rig.plant.position.copy())

        self._runs = experiment.run(cases, iterations=1, steering=steering, interval=_SAMPLE)
        self._path = corners[0]
        self._q = np.stack(poses, axis=1)
        self._distance = [1e3 * np.linalg.norm(r.error[0, :, :3], axis=1) for r in self._runs]
        kt, kr, kn = cases[0].stiffness
        heading = f"{arm.title}, {cases[0].trajectory}, {kt:g} N/m, {kr:g} N·m/rad"
        heading += f", {kn:g} N·m/rad" if kn else ""
        titles = [case_name(c).replace("_", " ") for c in cases]
        columns = [(title, r.time) for title, r in zip(titles, self._runs, strict=True)]
        super().__init__(arm, heading, columns, fps=fps)

    def _prepare(self, scene: ArmScene) -> mujoco.MjvCamera:
        """Return a camera near enough to see by how much the tool point is off the path."""
        scene.pose(self._start)
        scene.fade(_ALPHA)
        camera = scene.camera(scene.points)
        low, high = self._path.min(axis=0), self._path.max(axis=0)
        camera.lookat = (low + high) / 2
        camera.distance = scene.distance(0.55 * float(np.linalg.norm(high - low)) + 0.05)
        camera.azimuth += 60.0 + _ASIDE  # `scene.camera` has turned by 120 already
        camera.elevation = _ELEVATION
        return camera

    def _joints(self, i: int, k: int, t: float) -> Array:
        q: Array = self._q[i, min(round(t / _SAMPLE), self._q.shape[1] - 1)]
        return q

    def _decorate(self, scene: ArmScene, drawn: mujoco.MjvScene, i: int, k: int) -> None:
        """Draw the path and its goals, the reference, and where the tool point has been."""
        run = self._runs[i]
        scene.draw_chain(drawn)
        polyline(drawn, _LINE, self._path, PATH)
        for goal in self._path[1:]:
            ball(drawn, _GOAL, goal, PATH)
        actual = run.actual[0, : k + 1, :3]
        polyline(drawn, _LINE, np.vstack([actual[:: 1 + k // _TRAIL], actual[-1:]]), MARK)
        ball(drawn, _GOAL, run.reference[0, k, :3], PATH)
        ball(drawn, 1.2 * _GOAL, actual[-1], MARK)

    def _state(self, i: int, k: int, t: float) -> tuple[str, Colour]:
        return f"{self._distance[i][k]:.1f} mm off", ORANGE

    def _plot(self, draw: ImageDraw.ImageDraw, i: int, k: int, t: float) -> None:
        run, top = self._runs[i], HEADER + self.SCENE + 28
        high = 1.1 * max(float(a.max()) for a in self._distance)
        box = (58, top, WIDTH - 14, self.size[1] - 40)
        title = "distance of the tool point from its reference [mm]"
        plot = Plot(draw, box, (0.0, 1.01 * self._end), (0.0, high), title)
        reached = run.reached[0]
        plot.marks(reached[np.isfinite(reached) & (reached <= run.time[k])], PURPLE)
        plot.legend([("goal", PURPLE)])
        if k:
            plot.line(run.time[: k + 1], self._distance[i][: k + 1], BLUE)
        plot.time_label()
