"""The progress of a diagnosis of logs: its stages, and the share of the whole of each one."""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate, pairwise

WEIGHTS = {
    "reading": 6,
    "inverse dynamics": 1,
    "columns of all causes": 10,
    "choosing causes": 40,
    "held-out rows": 20,
    "evidence": 4,
    "check": 10,
    "extended model": 1,
    "report": 16,
}
"""Share of each stage, in order; assumed."""


class Stages:
    """Converts a stage and its part done into the share of the whole, which never falls."""

    def __init__(self, say: Callable[[str, float | None], None], *, check: bool) -> None:
        """Start at zero.

        Args:
            say: called with a stage and the share of the whole that is done [0 to 1]; None for a
                stage of unknown share.
            check: whether there are logs to check with.
        """
        self._say, self._share = say, 0.0
        weights = {k: x for k, x in WEIGHTS.items() if check or k != "check"}
        ends = accumulate(weights.values(), initial=0)
        self._span = dict(
            zip(weights, pairwise(x / sum(weights.values()) for x in ends), strict=True)
        )

    def __call__(self, stage: str, part: float) -> None:
        """Report that a part [0 to 1] of a stage is done."""
        if stage not in self._span:
            self._say(stage, None)
            return
        start, end = self._span[stage]
        self._share = max(self._share, start + (end - start) * min(max(part, 0.0), 1.0))
        self._say(stage, min(self._share, 1.0))
