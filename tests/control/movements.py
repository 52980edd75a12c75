"""Movements and goals of several arms at once, for tests."""

import numpy as np

from stiction_envs.control.trajectory import GoalSequencer, MotionLimits, new_movements
from stiction_envs.control.trapezoid import accept, plan, sample


class Segment:
    """One movement of each of N arms."""

    def __init__(self, nsim: int, limits: MotionLimits) -> None:
        self.arrays = new_movements(nsim, limits)
        self.duration = self.arrays.duration

    def start(self, *poses) -> None:
        """Plan from positions (N, 3), quaternions (N, 4) to those of the goals."""
        for i, rows in enumerate(zip(*poses, strict=True)):
            plan(i, *(np.array(x, dtype=float) for x in rows), self.arrays)

    def sample(self, t):
        return sample(np.broadcast_to(t, len(self.duration)).astype(float), self.arrays)


class Goals(GoalSequencer):
    """Sequencers whose arms all start, and look at their goals, together."""

    def start_all(self, ids, goals, turns, position, quaternion) -> None:
        for row, i in enumerate(ids):
            self.start(i, goals[row], turns[row], position[row], quaternion[row])

    def accept(self, position, quaternion, t):
        now = np.broadcast_to(t, len(position)).astype(float)
        arms = enumerate(zip(position, quaternion, now, strict=True))
        return np.array([accept(i, *look, self.arrays, self.movement) for i, look in arms])
