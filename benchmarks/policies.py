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

from tqdm import tqdm

from benchmarks._policies_page import write
from benchmarks._policies_plan import (
    EPISODE,
    SMALL,
    TRAINED,
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
from benchmarks._policies_training import (
    RATES,
    TOGETHER,
    Folder,
    best_algorithm,
    folder,
    train_all,
)

HERE = Path(__file__).parent
STAGES = ("agents", "train", "policies", "page")
BAR = "{percentage:5.1f} %|{bar}| {elapsed}<{remaining}{postfix}"


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
        self._seconds, self._shares = self._parts(), self._done()
        total = math.fsum(self._seconds.values())
        self._bar = tqdm(total=total, initial=self._gone(), bar_format=BAR, dynamic_ncols=True)

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

    def _there(self) -> list[tuple[Cell, Contestant]]:
        """Return what was measured."""
        return [(c, a) for c, a in self._unlearned() + self._learned() if self.rows.there(c, a)]

    # ---- how far it is -----------------------------------------------------------------------

    def _parts(self) -> dict[str, float]:
        """Return how long each part is assumed to take [s]."""
        out = {
            _name(cell, agent.name, agent.run): EPISODE * self.rows.episodes(cell, agent)
            for cell, agent in self._unlearned()
        }
        # while the algorithm of the iiwa is not known, the slowest is as good
        for t in trainings(self.plan, best_algorithm(self.work, self.plan) or "sac"):
            out[t.name] = self.plan.steps / RATES[t.algorithm] / TOGETHER
            for c in self.cells:
                if (c.robot, c.experiment) == (t.robot, t.experiment):
                    out[_name(c, TRAINED[t.algorithm], t.run)] = EPISODE * len(c.options)
        return out

    def _done(self) -> dict[str, float]:
        """Return the share of each part that was done before."""
        return {one.training.name: one.share for one in self.folders()} | {
            _name(cell, agent.name, agent.run): 1.0 for cell, agent in self._there()
        }

    def _gone(self) -> float:
        # exact sums: all parts are no more than the total
        return math.fsum(self._seconds.get(name, 0.0) * x for name, x in self._shares.items())

    def _tell(self, stage: str, shares: dict[str, float]) -> None:
        self._shares |= shares
        self._bar.n = self._gone()
        self._bar.set_postfix_str(stage)

    def close(self) -> None:
        """Leave the bar as it is."""
        self._bar.close()

    # ---- stages ------------------------------------------------------------------------------

    def agents(self) -> None:
        """Measure the agents that learn nothing."""
        self._measure(self._unlearned())

    def train(self) -> None:
        """Train; the iiwa's when it is known who is best."""
        for _ in range(2):
            self._seconds = self._parts()
            self._bar.total = math.fsum(self._seconds.values())
            todo = [f for f in self.folders() if not f.done]
            if todo and time.monotonic() < self.deadline:
                names = ", ".join(dict.fromkeys(f.training.robot for f in todo))
                tell = partial(self._training, names)
                self.wrong += train_all(todo, tell, self.deadline)

    def policies(self) -> None:
        """Measure what was trained."""
        self._measure(self._learned())

    def page(self) -> None:
        """Write the page of what is there."""
        results = Results(
            rows=self.rows,
            plan=self.plan,
            there=self._there(),
            folders=[f for f in self.folders() if f.done],
            best=best_algorithm(self.work, self.plan),
            in_all=self._unlearned(),
        )
        write(self.work if self.plan == SMALL else HERE, results)

    def _training(self, names: str, shares: dict[Training, float]) -> None:
        running = ", ".join(f"{t.name} {100 * s:.0f} %" for t, s in shares.items() if 0 < s < 1)
        known = {t.name: s for t, s in shares.items()}
        self._tell(running or f"training, {names}", known)

    def _measure(self, todo: list[tuple[Cell, Contestant]]) -> None:
        for cell, agent in todo:
            if time.monotonic() > self.deadline:
                return
            name = _name(cell, agent.name, agent.run)
            self._tell(name, {})
            self.rows.measure(cell, agent)
            self._tell(name, {name: 1.0})


def _name(cell: Cell, agent: str, run: int | None) -> str:
    one = agent if run is None else f"{agent} {run}"
    return f"{cell.robot}, {cell.task}, friction × {cell.friction:g}: {one}"


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
        whole.close()
        print("stopped: the same command goes on", file=sys.stderr)
        return 130
    whole.close()
    for line in whole.wrong:
        print(line, file=sys.stderr)
    return 1 if whole.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
