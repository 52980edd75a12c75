"""Which moments of an experiment a film shows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

_AFTER = 1.0  # how long the last moment is shown [s]


class Timing:
    """Frames evenly spaced in time: in real time, or a whole number of times as fast."""

    def __init__(self, duration: float, *, fps: float, most: float) -> None:
        """Plan a film of ``duration`` [s] with ``fps`` frames per second in ``most`` s at most."""
        self.fps = fps
        self.speed = max(1, int(np.ceil(duration / most)))
        """How many times as fast as real time."""
        self._moving = int(np.ceil(duration / self.speed * fps)) + 1
        self.count = self._moving + round(_AFTER * fps)
        """Frames in all."""

    @property
    def faster(self) -> str:
        """For a caption: empty in real time."""
        return f"  (shown ×{self.speed})" if self.speed > 1 else ""

    def times(self) -> Iterator[float]:
        """Yield the moment of each frame [s]; the last one stays for a while."""
        for k in range(self.count):
            yield min(k, self._moving - 1) * self.speed / self.fps
