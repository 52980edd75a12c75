"""Work on Warp's device that is repeated: captured once, as one graph.

On a graphics card a graph is a CUDA graph; on a processor Warp replays the same launches, without
Python between them, on one thread.
"""

from __future__ import annotations

from collections.abc import Callable

import warp as wp

# compiling is told of with INFO, on standard output, where commands write their result
wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)


def captured(work: Callable[[], object]) -> Callable[[], None]:
    """Do some work, which loads its kernels, and return a function that does it again.

    Args:
        work: launches kernels, always the same, and nothing else; called twice.
    """
    work()
    with wp.ScopedCapture() as capture:
        work()
    return lambda: wp.capture_launch(capture.graph)
