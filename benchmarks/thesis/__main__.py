"""``python -m benchmarks.thesis``: the thesis's tables and figures, simulated beside measured."""

import sys

from benchmarks.thesis import command
from stiction_envs.cli import main

if __name__ == "__main__":
    sys.exit(main(["reproduce", *sys.argv[1:]], [command]))
