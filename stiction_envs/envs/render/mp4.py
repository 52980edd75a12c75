"""Frames into an mp4, through the ffmpeg that imageio-ffmpeg brings (extra ``video``)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.render.screen import Screen
from stiction_envs.envs.render.timing import Timing
from stiction_envs.errors import ExperimentError, StictionError, missing_extra


class Film(Protocol):
    """What `write_film` writes."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a frame, even numbers [pixel]."""

    @property
    def timing(self) -> Timing:
        """How many frames, and how fast."""

    def frames(self) -> Iterable[NDArray[np.uint8]]:
        """Yield the frames, (height, width, 3)."""


def check_film() -> None:
    """Raise a StictionError where no film can be made: no encoder, or no OpenGL."""
    import mujoco

    _encoder()
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth = spec.visual.global_.offheight = 16
    Screen(spec.compile()).close()


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
    count = film.timing.count

    def counted() -> Iterable[NDArray[np.uint8]]:
        for k, frame in enumerate(film.frames()):
            yield frame
            if progress is not None:
                progress(k + 1, count)

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
    except OSError as error:  # a broken pipe brings all that ffmpeg said
        said = str(error).strip().splitlines() or [""]
        raise ExperimentError(f"{path}: the encoder failed: {said[-1].strip()}") from None
    finally:
        writer.close()
        part.unlink(missing_ok=True)


def _encoder() -> Any:
    """Return imageio-ffmpeg, which has found its ffmpeg."""
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except ImportError:
        raise missing_extra("a video", "imageio-ffmpeg", "video") from None
    except RuntimeError as error:
        raise StictionError(f"a video needs ffmpeg: {' '.join(str(error).split())}") from None
    return imageio_ffmpeg
