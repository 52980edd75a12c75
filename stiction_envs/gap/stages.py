"""The progress of a diagnosis of logs: its stages, and the share of the whole of each one."""

from __future__ import annotations

from collections.abc import Callable, Collection
from itertools import accumulate

WEIGHTS = {
    "reading": 6,
    "inverse dynamics": 1,
    "columns of all causes": 10,
    "choosing causes": 40,
    "held-out rows": 20,
    "evidence": 4,
    "check": 10,
    "extended model": 1,
    "forward validation": 2,
    "report": 14,
}
"""Share of each stage, in order; assumed."""


class Stages:
    """Converts a stage and its part done into the share of the whole, which never falls."""

    def __init__(
        self, say: Callable[[str, float | None], None], without: Collection[str] = ("check",)
    ) -> None:
        """Start at zero.

        Args:
            say: called with a stage and the share of the whole that is done [0 to 1]; None for a
                stage of unknown share.
            without: stages that are skipped.
        """
        self._say = say
        weights = {k: 0 if k in without else x for k, x in WEIGHTS.items()}
        whole = sum(weights.values())
        ends = accumulate(weights.values(), initial=0)
        self._span = {
            k: (a / whole, x / whole) for (k, x), a in zip(weights.items(), ends, strict=False)
        }
        self._share = 0.0

    def __call__(self, stage: str, part: float) -> None:
        """Report that a part [0 to 1] of a stage is done."""
        if stage not in self._span:
            self._say(stage, None)
            return
        start, own = self._span[stage]
        self._share = max(self._share, start + own * min(max(part, 0.0), 1.0))
        self._say(stage, min(self._share, 1.0))
