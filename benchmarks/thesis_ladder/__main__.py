"""Fit the nested models and write their page here: `python -m benchmarks.thesis_ladder`.

The same as `stiction reproduce gap`. Models are written to `ladder.json` as they are done: run it
again after an interruption and it goes on.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from stiction_envs.cli.progress import Progress
from stiction_envs.thesis.nested_models import SEEDS, NestedModels
from stiction_envs.thesis.nyquist_phase import study_phase
from stiction_envs.thesis.page import write_page

HERE = Path(__file__).parent


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE, help="folder (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="seeds of the optimiser")
    parser.add_argument("--processes", type=int, default=0, help="0: all processors")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    start = time.monotonic()
    nested = NestedModels(args.out, seeds=range(args.seeds), processes=args.processes)
    with Progress("steps") as progress:
        for _ in nested.fit(progress.set):
            pass
        study = study_phase(nthread=args.processes)
        write_page(args.out, nested.models, study=study, progress=progress.set)
    print((args.out / "ladder.md").read_text(encoding="utf-8"))
    print(f"{time.monotonic() - start:.0f} s; page: {args.out / 'gap.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
