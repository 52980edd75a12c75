"""The command line, ``stiction COMMAND``: exit code 0 done, 1 failed while working, 2 bad input."""

from stiction_envs.cli.dispatch import main

__all__ = ["main"]
