"""A progress bar on standard error: tqdm on a terminal, a line now and then elsewhere."""

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn, Self

EVERY = 10.0
"""Least time between two lines where standard error is no terminal [s]; assumed."""

_interrupted = threading.Event()
"""Whether Ctrl-C was pressed within `interruptible`."""


@contextmanager
def interruptible() -> Iterator[None]:
    """End work that shows its `Progress` after Ctrl-C, even where Python loses the interrupt.

    Python ignores exceptions in finalizers and callbacks of weak references, `KeyboardInterrupt`
    too: `Progress` raises it again. In other threads than the main one nothing changes.
    """

    def interrupt(*_: object) -> NoReturn:
        _interrupted.set()
        raise KeyboardInterrupt

    main = threading.current_thread() is threading.main_thread()
    ours = main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if ours:
        signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            _interrupted.clear()


def _raise_again() -> None:
    if _interrupted.is_set():
        raise KeyboardInterrupt


class Progress:
    """Progress of long work; a context manager that leaves no half-drawn bar."""

    def __init__(self, unit: str = "s simulated") -> None:
        """Start at zero; ``unit`` is what is counted."""
        self._unit = unit
        self._bar: Any = None
        self._stage = ""
        self._done = 0.0
        self._printed = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def add(self, stage: str, amount: float, total: float) -> None:
        """Add ``amount`` to what is done of a stage."""
        self.set(stage, (self._done if stage == self._stage else 0.0) + amount, total)

    def set(self, stage: str, done: float, total: float, unit: str | None = None) -> None:
        """Show how much of a stage is done; more than an estimated ``total`` may be done.

        ``unit`` names what is counted from here on; None leaves the unit as it was.
        """
        _raise_again()
        self._unit = unit or self._unit
        if stage != self._stage:
            self._close()
        self._stage, self._done = stage, done
        shown = min(done, total)
        if sys.stderr.isatty():
            self._draw(shown, total)
        elif time.monotonic() - self._printed >= EVERY and total > 0:
            self._printed = time.monotonic()
            percent = 100 * shown / total
            print(
                f"{stage}: {percent:.0f} % ({shown:.0f} of {total:.0f} {self._unit})",
                file=sys.stderr,
                flush=True,
            )

    def whole(self, stage: str, share: float | None) -> None:
        """Show the share of all work that is done [0 to 1]: one bar, or a line per stage.

        None is an unknown share.
        """
        _raise_again()
        if sys.stderr.isatty() and share is not None:
            if self._bar is None:
                self._stage = stage
                self._draw(0.0, 100.0)
            self._bar.set_description_str(stage, refresh=False)
            self._draw(100 * share, 100.0)
        elif stage != self._stage:
            known = "" if share is None else f"{100 * share:3.0f} % "
            print(f"{known}{stage}", file=sys.stderr, flush=True)
        self._stage = stage

    def _draw(self, shown: float, total: float) -> None:
        if self._bar is None:
            from tqdm import tqdm

            self._bar = tqdm(
                desc=self._stage,
                total=total,
                leave=False,
                file=sys.stderr,
                bar_format="{desc}: {percentage:3.0f} %|{bar}| {elapsed} elapsed, {remaining} left",
            )
        self._bar.total = total
        self._bar.update(shown - self._bar.n)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
        self._bar, self._done = None, 0.0
