"""The face that every diagnosis has, of logs and of torque tables: verdict, causes, save."""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from stiction_envs.reporting.result import Result


class FoundCause(Protocol):
    """What causes of logs and of tables have in common."""

    @property
    def name(self) -> str:
        """As in ``diagnosis.json``."""

    @property
    def joints(self) -> tuple[int, ...]:
        """From 1; none for the arm as a whole."""

    @property
    def gain_percent(self) -> float:
        """What is lost when it alone is taken out [%]."""

    @property
    def evidence(self) -> str:
        """One sentence that can be checked in the data."""

    @property
    def confused_with(self) -> Iterable[str]:
        """Causes that the data cannot tell from it."""


class DiagnosisResult(Result):
    """What a simulation gets wrong about measured data."""

    @property
    @abc.abstractmethod
    def robot(self) -> str:
        """Name of the arm."""

    @property
    @abc.abstractmethod
    def verdict(self) -> str:
        """``explained``, ``partly explained``, ``no discrepancy`` or ``cannot tell``."""

    @property
    @abc.abstractmethod
    def causes(self) -> Sequence[FoundCause]:
        """Strongest first."""

    @property
    @abc.abstractmethod
    def gain_percent(self) -> float:
        """100 (1 − mean over joints of extended over nominal held-out error) [%]."""

    @property
    @abc.abstractmethod
    def summary(self) -> str:
        """The verdict in sentences."""

    @abc.abstractmethod
    def write(self, folder: Path, *, progress: Callable[[str, float], None] | None = None) -> None:
        """Write the files of `stiction diagnose` into a folder that is there.

        Args:
            folder: where to.
            progress: called with a stage and its part done.
        """

    def __repr__(self) -> str:
        names = ", ".join(c.name for c in self.causes) or "no cause"
        return f"<{type(self).__name__} of {self.robot}: {self.verdict}, {names}>"

    def __str__(self) -> str:
        causes = [
            {
                "name": c.name,
                "joints": c.joints,
                "gain_percent": c.gain_percent,
                "confused_with": list(c.confused_with),
            }
            for c in self.causes
        ]
        return describe(self.verdict, self.summary, causes)


def describe(verdict: str, summary: str, causes: Iterable[Mapping[str, Any]]) -> str:
    """Return verdict and causes as readable lines, a cause in a line.

    Args:
        verdict: one of the four.
        summary: it in sentences.
        causes: entries of ``diagnosis.json``.
    """
    lines = [f"{verdict}: {summary}", ""]
    for cause in causes:
        confused = cause["confused_with"]
        also = f"  (or {', '.join(confused)})" if confused else ""
        where = ",".join(map(str, cause["joints"])) or "arm"
        lines.append(f"{cause['gain_percent']:6.1f} %  {cause['name']:<28} joints {where}{also}")
    return "\n".join(lines)
