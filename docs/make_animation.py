"""Draw the README's animation: `python docs/make_animation.py`.

The same push on joint 7 of the Panda, without dither and with the dither that `make tune` finds for
the joint: frames of `PandaSJE-v0`. Needs OpenGL (MUJOCO_GL=egl).
"""

from pathlib import Path

import gymnasium as gym
import numpy as np
from PIL import Image, ImageDraw, ImageFont

OUT = Path(__file__).with_name("push.gif")
FPS, LAST = 10, 15  # frames per second, of 0.1 s each; frames for which the end stays
PUSH = {"joint": 7, "load": "load", "direction": "+"}


def frames(title: str, amplitude: float, frequency: float) -> list[np.ndarray]:
    """Return the frames of one push until the joint breaks away."""
    env = gym.make(
        "stiction_envs:PandaSJE-v0", render_mode="rgb_array", scatter=False, max_episode_steps=1000
    )
    env.reset(seed=0, options=PUSH)
    action = env.action_space.low.copy()
    action[6] = amplitude
    action[13] = max(action[13], frequency)
    font, out, over = ImageFont.load_default(22), [], False
    while not over:
        *_, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        picture = Image.fromarray(env.render())
        state = "breaks away" if over else "push"
        text = f"{title}\n{state}: {info['torque']:.2f} N·m"
        ImageDraw.Draw(picture).multiline_text((14, 10), text, fill=(20, 20, 20), font=font)
        out.append(np.asarray(picture))
    env.close()
    return out


def main() -> None:
    """Push, draw, write."""
    left, right = frames("without dither", 0.0, 0.0), frames("dither 0.80 N·m, 15 Hz", 0.801, 15.0)
    count = max(len(left), len(right))
    both = [
        Image.fromarray(np.hstack([side[min(k, len(side) - 1)] for side in (left, right)]))
        for k in range(count)
    ]
    # one palette without dithering, so that what rests costs nothing
    palette = both[-1].quantize(250, Image.Quantize.MAXCOVERAGE)
    flat = [x.quantize(palette=palette, dither=Image.Dither.NONE) for x in both]
    flat += [flat[-1]] * LAST
    flat[0].save(OUT, save_all=True, append_images=flat[1:], duration=1000 // FPS, loop=0)
    print(f"{OUT}: {len(flat)} frames, {OUT.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
