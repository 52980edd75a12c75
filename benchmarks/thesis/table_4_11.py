"""Table 4.11 as a page of its own: simulated beside measured, in set-ups the thesis leaves open.

    python -m benchmarks.thesis.table_4_11

The same as `python -m benchmarks.thesis --only table-4.11` has.
"""

from __future__ import annotations

import shutil

from benchmarks.harness import Benchmark
from benchmarks.thesis.catalogue import chosen
from benchmarks.thesis.items import needs_of
from benchmarks.thesis.studies import Options, run_studies
from stiction_envs.cli.progress import Progress

STUDY = Benchmark(__file__, __doc__)


def main() -> None:
    options = STUDY.parser().parse_args()
    items = chosen(["table-4.11"])
    options.out.mkdir(parents=True, exist_ok=True)
    with Progress("s") as progress:
        found, _ = run_studies(needs_of(items), Options(folder=options.work), progress.set)
    written = items[0].write(items[0], found, options.work)
    shutil.copy(options.work / "ensemble.png", options.out / "ensemble.png")
    text = [
        "# Table 4.11, simulated beside measured",
        "",
        written.numbers[1],
        "",
        f"Made by `{STUDY.command}`. Panda, final dither of Table 4.9, ten iterations; sums of the "
        "absolute error over 200 samples.",
        "",
        written.body.replace("####", "##"),
    ]
    STUDY.write_page(options, "\n".join(text))


if __name__ == "__main__":
    main()
