"""Draw the README's animation: `python docs/make_animation.py`.

The same push on a joint of the Panda, in real time, without dither and with it: the Single Joint
Experiment on joint 7 with the dither that `make tune` finds for it, as `stiction sje --video` shows
it. Needs OpenGL (MUJOCO_GL=egl).
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image

from stiction_envs.envs.render.sje_frames import sje_video
from stiction_envs.envs.render.video import FPS
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job

SIZE, COLOURS, NEAR = (600, 675), 250, 6
OUT = Path(__file__).with_name("push.gif")


def main() -> None:
    """Measure, draw, write."""
    experiment = SingleJointExperiment("panda", scatter=False)
    where = Configuration(7, "load", "+")
    jobs = [Job(where), Job(where, 15.0, 0.801)]
    video = sje_video(experiment, list(experiment.run(jobs, iterations=1)))
    # without dither above, with it below
    stacked = (np.concatenate(np.hsplit(frame, 2)) for frame in video.frames())
    frames = [Image.fromarray(f).resize(SIZE, Image.Resampling.LANCZOS) for f in stacked]
    save(frames, OUT)
    seconds = len(frames) / FPS
    print(f"{OUT}: {len(frames)} frames, {seconds:.1f} s, {OUT.stat().st_size / 1e6:.2f} MB")


def save(frames: list[Image.Image], path: Path) -> None:
    """Write a GIF that loops: one palette, no dithering, so that what rests costs nothing."""
    palette = _strip(frames[:: len(frames) // 5]).quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    flat = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    # noise of the renderer in what rests: keep the old colour where the new one is next to it
    colours = np.array(palette.getpalette()[: 3 * COLOURS]).reshape(-1, 3)
    for before, after in pairwise(flat):
        old, new = np.array(before), np.array(after)
        near = np.abs(colours[old] - colours[new]).max(axis=-1) <= NEAR
        after.putdata(np.where(near, old, new).ravel().tolist())
    flat[0].save(
        path, save_all=True, append_images=flat[1:], duration=round(1000 / FPS), loop=0, disposal=1
    )


def _strip(frames: list[Image.Image]) -> Image.Image:
    """Return frames below each other."""
    width, height = frames[0].size
    out = Image.new("RGB", (width, height * len(frames)))
    for k, frame in enumerate(frames):
        out.paste(frame, (0, k * height))
    return out


if __name__ == "__main__":
    main()
