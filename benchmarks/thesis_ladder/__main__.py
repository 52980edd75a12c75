"""Climb the ladder and write its page beside this file: `python -m benchmarks.thesis_ladder`.

The same as `stiction reproduce gap`. Rungs are written to `ladder.json` as they are done: run it
again after an interruption and it goes on.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from stiction_envs.cli.progress import Progress
from stiction_envs.thesis.nested_models import SEEDS, Ladder
from stiction_envs.thesis.nyquist_phase import study_phase
from stiction_envs.thesis.page import ladder_table, write_page
from stiction_envs.thesis.scores import Findings

HERE = Path(__file__).parent


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE, help="folder (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="seeds of the optimiser")
    parser.add_argument("--processes", type=int, default=0, help="0: all processors")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    start = time.monotonic()
    ladder = Ladder(args.out, seeds=range(args.seeds), processes=args.processes)
    with Progress("steps") as progress:
        for _ in ladder.climb(progress.set):
            pass
        study = study_phase(nthread=args.processes)
        write_page(args.out, ladder.rungs, study=study, progress=progress.set)
    print("\n".join(ladder_table(Findings(ladder.rungs, ladder.cells))))
    print(f"{time.monotonic() - start:.0f} s; page: {args.out / 'gap.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
