"""Videos of experiments: their frames as an mp4.

It is made by the ffmpeg that imageio-ffmpeg brings (extra ``video``).
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np

from stiction_envs.envs.render.arm_scene import Offscreen
from stiction_envs.envs.render.env_frames import HEIGHT, WIDTH, Frame
from stiction_envs.errors import ExperimentError, StictionError, missing_extra, one_line

FPS = 10.0
"""Frames per second; assumed."""
LONGEST = 20.0
"""Length of a video [s]; longer experiments are shown faster; assumed."""
_LAST_FRAME = 1.0  # how long the last moment is shown [s]; assumed


@dataclass(frozen=True, kw_only=True)
class Video:
    """Runs of one arm, two in a row."""

    runs: Sequence[Callable[[float], Frame]]
    """Each draws a run at a time since its start [s]; after its end, its last moment."""
    duration: float
    """Duration of the longest run [s]."""
    close: Callable[[], None]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a frame, even numbers [pixel]."""
        count = len(self.runs)
        return WIDTH * min(2, count), HEIGHT * math.ceil(count / 2)

    def times(self) -> list[float]:
        """Return the time of each frame [s]: real time, or a whole number of times as fast."""
        speed = max(1, math.ceil(self.duration / LONGEST))
        moving = math.ceil(self.duration / speed * FPS) + 1
        last = round(_LAST_FRAME * FPS)
        return [min(k, moving - 1) * speed / FPS for k in range(moving + last)]

    def frames(self) -> Iterator[Frame]:
        """Yield the frames, (height, width, 3).

        Raises:
            StictionError: no OpenGL.
        """
        width, height = self.size
        frame, drawn = np.full((height, width, 3), 255, dtype=np.uint8), -1.0
        try:
            for t in self.times():
                if t > drawn:
                    frame, drawn = frame.copy(), t
                    for k, draw in enumerate(self.runs):
                        top, left = HEIGHT * (k // 2), WIDTH * (k % 2)
                        frame[top : top + HEIGHT, left : left + WIDTH] = draw(t)
                yield frame
        finally:
            self.close()

    def write(self, path: Path, progress: Callable[[int, int], None]) -> None:
        """Write an mp4; errors as `write_frames`. ``progress`` takes frames drawn and all."""

        def counted() -> Iterator[Frame]:
            for k, frame in enumerate(self.frames()):
                yield frame
                progress(k + 1, len(self.times()))

        write_frames(counted(), path, size=self.size)


def check_video() -> None:
    """Raise a StictionError if no video can be made: no encoder, or no OpenGL."""
    _encoder()
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth = spec.visual.global_.offheight = 16
    Offscreen(spec.compile()).close()


def write_frames(frames: Iterable[Frame], path: Path, *, size: tuple[int, int]) -> None:
    """Write frames (height, width, 3) as an mp4 of a size, width and height, even numbers [pixel].

    A failure leaves the file that was there before.

    Raises:
        StictionError: no encoder, or no OpenGL.
        ExperimentError: the encoder failed.
    """
    encoder = _encoder()
    part = path.with_name(f".{path.stem}.{os.getpid()}.part.mp4")
    writer = encoder.write_frames(
        str(part), size, fps=FPS, codec="libx264", macro_block_size=2, output_params=["-an"]
    )
    try:
        writer.send(None)
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
        writer.close()
        os.replace(part, path)
    except OSError as error:  # a broken pipe has all messages of ffmpeg
        last = (str(error).strip().splitlines() or [""])[-1].strip()
        raise ExperimentError(f"{path}: the encoder failed: {last}") from None
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
