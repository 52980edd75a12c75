"""Table 4.11 as a page of its own: simulated beside measured.

    python -m benchmarks.thesis.table_4_11

The same as `python -m benchmarks.thesis --only table-4.11` has.
"""

from __future__ import annotations

from benchmarks.harness import Benchmark
from benchmarks.thesis.catalogue import chosen
from benchmarks.thesis.studies import Options, run_studies
from stiction_envs.cli.progress import Progress

STUDY = Benchmark(__file__, __doc__)


def main() -> None:
    options = STUDY.parser().parse_args()
    (item,) = chosen(["table-4.11"])
    options.work.mkdir(parents=True, exist_ok=True)
    with Progress("paths") as progress:
        found = run_studies(item.needs, Options(), progress.set)
    (_, sentence), table = item.write(found, options.work)
    STUDY.write_page(options, sentence=sentence, table=table)


if __name__ == "__main__":
    main()
