"""How fast this machine is just now: a loop of plain Python, whose seconds stand beside the tests'.

The machine's speed varies by half: a slow hour lengthens this loop as it does the tests, slow
tests do not.
"""

from time import perf_counter

USUAL_S = 1.4
"""On two quiet cores, in the hour in which the tests before took 568 s; they vary by half."""


def seconds() -> float:
    began = perf_counter()
    total = 0
    for i in range(30_000_000):
        total += i * i
    return perf_counter() - began


if __name__ == "__main__":
    print(f"reference loop: {seconds():.1f} s (usual: {USUAL_S} s)")
