"""Does a learned policy shake better than a constant table, and than a rule?

    python -m benchmarks.learning.policies [--minutes M] [--small]

Trains policies (two at a time), measures their episodes and those of agents that learn nothing, and
writes the page with its pictures. Stopped, it goes on: trainings from their last checkpoint,
episodes from the last agent that was measured. ``--small`` does a little of everything into
``--work``, to see that it runs; its numbers mean nothing.
"""

from __future__ import annotations

import os
import time
import warnings

from benchmarks.harness import Benchmark
from benchmarks.learning.policies_page import page
from benchmarks.learning.policies_plan import SMALL, Plan, cells, learned, trainings, unlearned
from benchmarks.learning.policies_results import Results
from benchmarks.learning.policies_run import Episodes, best_algorithm, train_all

STUDY = Benchmark(__file__, __doc__)


def main() -> int:
    parser = STUDY.parser()
    parser.add_argument("--small", action="store_true", help="a little of all, page into --work")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    # two trainings at once: threads of linear algebra would only be in each other's way
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    end, plan, work = time.monotonic() + 60 * options.minutes, Plan(), options.work
    if options.small:
        plan, work = SMALL, options.work / "small"
        options.out = work
    trained, best, wanted = {}, None, trainings(plan, None)
    for _ in range(2):  # the iiwa's when it is known who is best
        left = (end - time.monotonic()) / 60
        trained = train_all(work, plan, wanted, left)
        best = best_algorithm(trained, wanted)
        wanted = trainings(plan, best)
    all_of = [(cell, one) for cell in cells(plan) for one in unlearned(cell.robot, cell.experiment)]
    all_of += [
        (cell, learned(t, found.policy))
        for cell in cells(plan)
        for t, found in trained.items()
        if (t.robot, t.experiment) == (cell.robot, cell.experiment)
    ]
    episodes = Episodes(work, plan)
    missing = episodes.measure(all_of, (end - time.monotonic()) / 60)
    if best is None or len(trained) < len(wanted) or missing:
        print(f"no page yet: {len(wanted) - len(trained)} trainings and {missing} agents to go")
        return 1
    results = Results(
        episodes=episodes, plan=plan, there=all_of, trained=list(trained.values()), best=best
    )
    STUDY.write_page(options, **page(results, options.out))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
