"""Does a learned policy shake better than a constant table, and than a rule?

    python -m benchmarks.policies [--work DIR] [--minutes M] [--only agents|train|policies|page …]

Measures the agents that learn nothing, trains the others (two at a time, each in a process of its
own), measures what was trained, and writes policies.md with its pictures. Stopped, it goes on:
trainings from their last checkpoint, episodes from the last agent that was measured. ``--minutes``
stops by itself, and writes the page of what is there. ``--small`` does a little of everything into
``--work``, to see that it runs; its numbers mean nothing.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
import warnings
from functools import partial
from pathlib import Path

from benchmarks._policies_page import write
from benchmarks._policies_plan import (
    EPISODE,
    SMALL,
    Cell,
    Contestant,
    Plan,
    Training,
    cells,
    learned,
    trainings,
    unlearned,
)
from benchmarks._policies_results import Results
from benchmarks._policies_rows import Rows
from benchmarks._policies_training import RATES, Folder, best_algorithm, folder, train_all

HERE = Path(__file__).parent
STAGES = ("agents", "train", "policies", "page")


class Whole:
    """How much of everything is done, in seconds that it is thought to take."""

    def __init__(self, seconds: dict[str, float]) -> None:
        """Prepare; ``seconds`` of each part."""
        self._seconds, self._share = seconds, dict.fromkeys(seconds, 0.0)
        self._start, self._at_start = time.monotonic(), 0.0
        self._stage = ""

    @property
    def share(self) -> float:
        """Share of all that is done."""
        return sum(self._seconds[k] * self._share[k] for k in self._seconds) / (
            sum(self._seconds.values()) or 1.0
        )

    def there(self, name: str, share: float = 1.0) -> None:
        """Count what was done before."""
        self._share[name] = share
        self._at_start = self.share

    def tell(self, stage: str, shares: dict[str, float]) -> None:
        """Print how far it is."""
        self._share |= shares
        gone, went = time.monotonic() - self._start, self.share - self._at_start
        left = gone * (1 - self.share) / went if went > 1e-4 else math.nan
        rest = f"{left / 60:.0f} min left" if math.isfinite(left) else "time left: not known yet"
        line = f"{100 * self.share:5.1f} % of the whole, {rest}: {stage}"
        print(f"\r{line:<100}", end="", flush=True)


class Benchmark:
    """All of it, in a folder."""

    def __init__(self, work: Path, plan: Plan, deadline: float) -> None:
        """Look at what is there."""
        self.work, self.plan, self.deadline = work, plan, deadline
        self.rows = Rows(work / "rows", plan)
        self.cells = cells(plan)
        self.wrong: list[str] = []
        self._agents = {
            (r, e): unlearned(r, e)
            for r, e in dict.fromkeys((c.robot, c.experiment) for c in self.cells)
        }
        self._whole = Whole(self._seconds())
        for one in self.folders():
            self._whole.there(one.training.name, one.share)
        for cell, agent in self._unlearned():
            if self.rows.there(cell, agent):
                self._whole.there(_name(cell, agent))

    # ---- what there is -----------------------------------------------------------------------

    def folders(self) -> list[Folder]:
        """Return the folders of all trainings that are known so far."""
        best = best_algorithm(self.work, self.plan)
        return [folder(self.work, self.plan, t) for t in trainings(self.plan, best)]

    def _unlearned(self) -> list[tuple[Cell, Contestant]]:
        return [(c, a) for c in self.cells for a in self._agents[c.robot, c.experiment]]

    def _learned(self) -> list[tuple[Cell, Contestant]]:
        done = [(f.training, learned(f.training, f.policy)) for f in self.folders() if f.done]
        return [
            (cell, agent)
            for cell in self.cells
            for t, agent in done
            if (t.robot, t.experiment) == (cell.robot, cell.experiment)
        ]

    def _seconds(self) -> dict[str, float]:
        """Return how long each part is thought to take."""
        out = {
            _name(cell, agent): EPISODE * self.rows.episodes(cell, agent)
            for cell, agent in self._unlearned()
        }
        # the algorithm of the iiwa is not known yet; the slowest is as good
        for t in trainings(self.plan, best_algorithm(self.work, self.plan) or "sac"):
            out[t.name] = self.plan.steps / RATES[t.algorithm] / 2
            episodes = sum(
                len(c.options)
                for c in self.cells
                if (c.robot, c.experiment) == (t.robot, t.experiment)
            )
            out[_measured(t)] = EPISODE * episodes
        return out

    # ---- stages ------------------------------------------------------------------------------

    def agents(self) -> None:
        """Measure the agents that learn nothing."""
        self._measure(self._unlearned(), count=_name)

    def train(self) -> None:
        """Train; the iiwa's when it is known who is best."""
        for _ in range(2):
            todo = [f for f in self.folders() if not f.done]
            if todo and time.monotonic() < self.deadline:
                names = ", ".join(dict.fromkeys(f.training.robot for f in todo))
                tell = partial(self._training, names)
                self.wrong += train_all(todo, tell, self.deadline)

    def policies(self) -> None:
        """Measure what was trained."""
        self._measure(self._learned())
        for one in self.folders():
            if one.done:
                self._whole.there(_measured(one.training))

    def page(self) -> None:
        """Write the page of what is there."""
        there = [(c, a) for c, a in self._unlearned() + self._learned() if self.rows.there(c, a)]
        results = Results(
            rows=self.rows,
            plan=self.plan,
            there=there,
            folders=[f for f in self.folders() if f.done],
            best=best_algorithm(self.work, self.plan),
            in_all=self._unlearned(),
        )
        write(self.work if self.plan == SMALL else HERE, results)

    def _training(self, names: str, shares: dict[Training, float]) -> None:
        running = ", ".join(f"{t.name} {100 * s:.0f} %" for t, s in shares.items() if 0 < s < 1)
        known = {t.name: s for t, s in shares.items()}
        self._whole.tell(running or f"training, {names}", known)

    def _measure(self, todo: list[tuple[Cell, Contestant]], count: object = None) -> None:
        for cell, agent in todo:
            if time.monotonic() > self.deadline:
                return
            name = _name(cell, agent)
            if not self.rows.there(cell, agent):
                self._whole.tell(name, {})
                self.rows.measure(cell, agent)
            if count is not None:
                self._whole.tell(name, {name: 1.0})


def _name(cell: Cell, agent: Contestant) -> str:
    run = "" if agent.run is None else f" {agent.run}"
    return f"{cell.robot}, {cell.task}, friction × {cell.friction:g}: {agent.name}{run}"


def _measured(training: Training) -> str:
    return f"{training.name}, measured"


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("runs/benchmarks/policies"))
    parser.add_argument("--minutes", type=float, default=math.inf, help="stop after so many")
    parser.add_argument("--only", nargs="+", choices=STAGES, default=STAGES)
    parser.add_argument("--small", action="store_true", help="a little of all, page into --work")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    deadline = time.monotonic() + 60 * asked.minutes
    work = asked.work / "small" if asked.small else asked.work
    whole = Benchmark(work, SMALL if asked.small else Plan(), deadline)
    try:
        for stage in STAGES:
            if stage in asked.only:
                getattr(whole, stage)()
    except KeyboardInterrupt:
        print("\nstopped: the same command goes on", file=sys.stderr)
        return 130
    print()
    for line in whole.wrong:
        print(line, file=sys.stderr)
    return 1 if whole.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
