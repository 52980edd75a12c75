"""The option ``--video``: where the video of an experiment goes, and how it is written."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from stiction_envs.cli.common import Parser
from stiction_envs.errors import StictionError, one_line

if TYPE_CHECKING:
    from stiction_envs.cli.progress import Progress
    from stiction_envs.envs.render.video import Video
    from stiction_envs.reporting.output_folder import OutputFolder


def add_video_option(parser: Parser, what: str) -> None:
    """Add ``--video``; ``what`` is the beginning of its help."""
    parser.add_argument(
        "--video",
        action="store_true",
        help=f"{what} as COMMAND.mp4 in --out (needs OpenGL and the extra video)",
    )


def video_file(args: argparse.Namespace, folder: OutputFolder) -> Path | None:
    """Return where the video goes, None for no video; nothing is written yet.

    Raises:
        StictionError: no video can be made here.
    """
    if not args.video:
        return None
    from stiction_envs.envs.render.video import check_video

    check_video()
    return folder.path / f"{args.command}.mp4"


def write_video(
    path: Path | None, make: Callable[[], Video], progress: Progress, failed: str | None
) -> dict[str, object]:
    """Write a video, if one was asked for, after all else has been written.

    Returns ``video`` and ``failed`` of the command's JSON values; a video that cannot be made is
    added to what had failed before.
    """
    if path is None:
        return {"failed": failed}
    try:
        make().write(path, lambda k, n: progress.set("video", k, n, "frames"))
        return {"video": str(path), "failed": failed}
    except (StictionError, OSError) as error:
        no_video = f"no video: {one_line(error)}; all else is written"
        return {"video": None, "failed": f"{failed}; {no_video}" if failed else no_video}
