"""Films of the experiments, and how frames become an mp4.

The mp4 is made by the ffmpeg that imageio-ffmpeg brings (extra ``video``).
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from stiction_envs.envs.render.arm_scene import ArmScene
from stiction_envs.envs.render.offscreen import Offscreen
from stiction_envs.envs.render.panel import INK, PAPER, SOFT, Colour, font
from stiction_envs.errors import ExperimentError, StictionError, missing_extra, one_line
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
WIDTH, HEADER = 480, 62
"""Width of a column and height of its title [pixel]."""
_LAST_FRAME = 1.0  # how long the last moment is shown [s]; assumed


class Timing:
    """Frames evenly spaced in time: in real time, or a whole number of times as fast."""

    def __init__(self, duration: float, *, fps: float, longest: float) -> None:
        """Plan a film of ``duration`` [s] with ``fps`` frames per second in ``longest`` s."""
        self.fps = fps
        self.speed = max(1, int(np.ceil(duration / longest)))
        """How many times as fast as real time."""
        self._moving = int(np.ceil(duration / self.speed * fps)) + 1
        self.count = self._moving + round(_LAST_FRAME * fps)
        """Frames in all."""

    @property
    def caption(self) -> str:
        """How fast the film is; empty in real time."""
        return f"  (shown ×{self.speed})" if self.speed > 1 else ""

    def times(self) -> Iterator[float]:
        """Yield the time that each frame shows [s]; the last time is shown for a while."""
        for k in range(self.count):
            yield min(k, self._moving - 1) * self.speed / self.fps


class Film(ABC):
    """Runs of one arm side by side; a column is a title, the arm in its scene, and plots."""

    SCENE: ClassVar[int]
    """Height of the arm [pixel]."""
    PLOTS: ClassVar[int]
    """Height of what is below it [pixel]."""
    LONGEST: ClassVar[float]
    """Length of the film [s]; longer experiments are shown faster; assumed."""
    STATE: ClassVar[tuple[int, int, int]] = (7, 19, 35)
    """Top of the state, its size, and top of the clock [pixel]."""

    def __init__(
        self, arm: Arm, heading: str, columns: Sequence[tuple[str, Array]], *, fps: float
    ) -> None:
        """Prepare the frames; OpenGL is not touched yet.

        Args:
            arm: that is shown.
            heading: of all columns.
            columns: title and times (K,) of the samples [s] of each.
            fps: frames per second.
        """
        self._arm, self._heading, self._columns = arm, heading, columns
        self._end = max(float(time[-1]) for _, time in columns)
        self.timing = Timing(self._end, fps=fps, longest=self.LONGEST)
        self.size = (WIDTH * len(columns), HEADER + self.SCENE + self.PLOTS)
        """Width and height of a frame, even numbers [pixel]."""

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """Yield the frames, (height, width, 3).

        Raises:
            StictionError: no OpenGL.
        """
        scene = ArmScene(self._arm, WIDTH, self.SCENE)
        try:
            camera = self._prepare(scene)
            for t in self.timing.times():
                columns = [self._column(scene, camera, i, t) for i in range(len(self._columns))]
                yield np.concatenate(columns, axis=1)
        finally:
            scene.close()

    def _column(
        self, scene: ArmScene, camera: mujoco.MjvCamera, i: int, t: float
    ) -> NDArray[np.uint8]:
        title, time = self._columns[i]
        k = max(0, int(np.searchsorted(time, t, side="right")) - 1)
        scene.pose(self._joints(i, k, t))
        picture = scene.picture(camera, lambda drawn: self._decorate(scene, drawn, i, k))
        image = Image.new("RGB", (WIDTH, self.size[1]), PAPER)
        image.paste(Image.fromarray(picture), (0, HEADER))
        draw, right = ImageDraw.Draw(image), WIDTH - 14
        draw.text((14, 7), title, font=font(19, bold=True), fill=INK)
        draw.text((14, 35), self._heading, font=font(14), fill=SOFT)
        top, size, clock_top = self.STATE
        state, colour = self._state(i, k, t)
        draw.text((right, top), state, font=font(size, bold=True), fill=colour, anchor="ra")
        clock = f"{min(t, time[-1]):.1f} s{self.timing.caption}"
        draw.text((right, clock_top), clock, font=font(14), fill=SOFT, anchor="ra")
        self._plot(draw, i, k, t)
        return np.array(image, dtype=np.uint8)

    @abstractmethod
    def _prepare(self, scene: ArmScene) -> mujoco.MjvCamera:
        """Return the camera of all frames."""

    @abstractmethod
    def _joints(self, i: int, k: int, t: float) -> Array:
        """Return the joint angles (n,) [rad] of column ``i`` at sample ``k``, time ``t`` [s]."""

    @abstractmethod
    def _decorate(self, scene: ArmScene, drawn: mujoco.MjvScene, i: int, k: int) -> None:
        """Draw markers of the experiment into the scene."""

    @abstractmethod
    def _state(self, i: int, k: int, t: float) -> tuple[str, Colour]:
        """Return the arm's state as text, and its colour."""

    @abstractmethod
    def _plot(self, draw: ImageDraw.ImageDraw, i: int, k: int, t: float) -> None:
        """Draw what is below the scene."""


# ---- the file ------------------------------------------------------------------------------------


def check_film() -> None:
    """Raise a StictionError if no film can be made: no encoder, or no OpenGL."""
    _encoder()
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth = spec.visual.global_.offheight = 16
    Offscreen(spec.compile()).close()


def write_film(
    film: Film, path: Path, *, progress: Callable[[int, int], None] | None = None
) -> None:
    """Write a film; a failure leaves what was there before.

    Args:
        film: what is shown.
        path: the mp4.
        progress: called with frames drawn and their number.

    Raises:
        StictionError: no encoder, or no OpenGL.
        ExperimentError: the encoder failed.
    """

    def counted() -> Iterable[NDArray[np.uint8]]:
        for k, frame in enumerate(film.frames()):
            yield frame
            if progress is not None:
                progress(k + 1, film.timing.count)

    write_frames(counted(), path, size=film.size, fps=film.timing.fps)


def write_frames(
    frames: Iterable[NDArray[np.uint8]], path: Path, *, size: tuple[int, int], fps: float
) -> None:
    """Write frames (height, width, 3) as an mp4; errors as `write_film`.

    Args:
        frames: are drawn while they are written.
        path: the mp4.
        size: width and height, even numbers [pixel].
        fps: frames per second.
    """
    encoder = _encoder()
    part = path.with_name(f".{path.stem}.{os.getpid()}.part.mp4")
    writer = encoder.write_frames(
        str(part), size, fps=fps, codec="libx264", macro_block_size=2, output_params=["-an"]
    )
    try:
        writer.send(None)
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
        writer.close()
        os.replace(part, path)
    except OSError as error:  # a broken pipe has all messages of ffmpeg
        said = str(error).strip().splitlines() or [""]
        raise ExperimentError(f"{path}: the encoder failed: {said[-1].strip()}") from None
    finally:
        writer.close()
        part.unlink(missing_ok=True)


def _encoder() -> ModuleType:
    """Return imageio-ffmpeg, which has found its ffmpeg."""
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except ImportError:
        raise missing_extra("a video", "imageio-ffmpeg", "video") from None
    except RuntimeError as error:
        raise StictionError(f"a video needs ffmpeg: {one_line(error)}") from None
    return imageio_ffmpeg
