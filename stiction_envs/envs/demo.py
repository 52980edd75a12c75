"""A first look at an environment: one episode of an agent that has not learned anything.

    python -m stiction_envs.envs.demo PandaGTE-v0 --agent gated

opens the viewer; without a display it writes an mp4 (extra `video`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import gymnasium as gym
import numpy as np

from stiction_envs.envs.agents import AGENTS
from stiction_envs.envs.gym_env import Info
from stiction_envs.envs.registration import EXPERIMENTS
from stiction_envs.envs.render.film import check_film, write_frames
from stiction_envs.envs.render.window import has_display
from stiction_envs.errors import ExperimentError, StictionError, unknown

SPEED = 2.0
"""Of the video over real time [-]: an episode of the SJE takes half a minute; assumed."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code: 0 done, 1 failed while working, 2 bad input."""
    parser = argparse.ArgumentParser(
        prog="python -m stiction_envs.envs.demo",
        description="Show one episode: in the viewer, or as an mp4 where there is no display.",
    )
    parser.add_argument("environment", help="such as PandaGTE-v0 or IiwaSJE-v0")
    parser.add_argument("--agent", choices=AGENTS, default="gated", help="default: gated")
    parser.add_argument("--seed", type=int, default=0, help="of the episode (default: 0)")
    parser.add_argument("--path", type=int, help="GTE: number of a random path")
    parser.add_argument("--out", type=Path, help="write this mp4 even where there is a display")
    given = parser.parse_args(arguments)
    try:
        show(given.environment, given.agent, seed=given.seed, path=given.path, out=given.out)
    except StictionError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1 if isinstance(error, ExperimentError) else 2
    return 0


def show(
    name: str, agent: str, *, seed: int = 0, path: int | None = None, out: Path | None = None
) -> Info:
    """Show an episode, print its result, and return its last info.

    Args:
        name: of a registered environment.
        agent: one of `agents.AGENTS`.
        seed: of the episode.
        path: number of a random path of the GTE; None draws triangle or pentagon.
        out: where to write an mp4; None opens the viewer, or writes ``NAME-AGENT.mp4`` where there
            is no display.

    Raises:
        StictionError: an unknown environment, a wrong option or seed, no encoder or no OpenGL for a
            video, or a file that exists already.
    """
    known = sorted(
        x for x in gym.registry if x.endswith(tuple(e.suffix for e in EXPERIMENTS.values()))
    )
    if name not in known:
        raise unknown("environment", name, known)
    if seed < 0:
        raise StictionError(f"seed {seed}: expected a whole number from 0")
    if out is None and not has_display():
        out = Path(f"{name}-{agent}.mp4")
    if out is not None:
        check_film()
        if out.exists():
            raise StictionError(f"{out} is there already: expected a new file")
        if not out.parent.is_dir():
            raise StictionError(f"{out.parent}: no such folder: expected one that is there")
    env = gym.make(name, render_mode="human" if out is None else "rgb_array")
    try:
        acting = AGENTS[agent](env)
        options = {} if path is None else {"path": path}
        observation, info = env.reset(seed=seed, options=options)
        frames, total, over = [], 0.0, False
        while not over:
            action, _ = acting.predict(observation)
            observation, reward, terminated, truncated, info = env.step(action)
            total, over = total + float(reward), terminated or truncated
            if out is not None:
                frames.append(np.asarray(env.render()))
        if out is not None:
            fps, (height, width) = SPEED * env.metadata["render_fps"], frames[0].shape[:2]
            write_frames(frames, out, size=(width, height), fps=fps)
            print(f"{out}: {len(frames)} frames")
    finally:
        env.close()
    print(f"{name}, agent {agent}, seed {seed}: return {total:.3f}")
    for key in ("reduction", "settling_error", "tracking_error"):
        if key in info:
            print(f"  {key}: {info[key]:.3f}")
    return info


if __name__ == "__main__":
    sys.exit(main())
