"""CSV logs as robots' own loggers print them, from the numbers of a log."""

from __future__ import annotations

import numpy as np


def _lines(columns: dict[str, list[str]], between: str) -> str:
    rows = zip(*columns.values(), strict=True)
    return "\n".join([between.join(columns), *(",".join(r) for r in rows)]) + "\n"


def libfranka(values: np.ndarray, between: str = ", ") -> str:
    """`franka::logToCSV` of ``t, q, dq, tau`` (T, 22): six digits, as a C++ stream prints them.

    Names are apart by a comma and a blank up to libfranka 0.13, by a comma since.
    """
    q, dq, tau = values[:, 1:8], values[:, 8:15], values[:, 15:]
    zero = np.zeros_like(q)
    groups = {
        "state.q": q,
        "state.q_d": zero,
        "state.dq": dq,
        "state.dq_d": zero,
        "state.tau_J": tau,
        "cmd.tau_J_d": zero + 5.0,
    }
    columns = {"time": [f"{1000 * t:.0f}" for t in values[:, 0]], "success_rate": ["1"] * len(q)}
    for name, array in groups.items():
        for j, x in enumerate(array.T):
            columns[f"{name}[{j}]"] = [f"{v:.6g}" for v in x]
    return _lines(columns, between)


def rostopic(values: np.ndarray, start: int = 1_700_000_000_000_000_000) -> str:
    """``rostopic echo -p`` of `franka_msgs/FrankaState`."""
    q, dq, tau = values[:, 1:8], values[:, 8:15], values[:, 15:]
    stamps = [str(start + round(1e9 * t)) for t in values[:, 0]]
    columns = {
        "%time": [str(int(x) + 400_000) for x in stamps],
        "field.header.seq": [str(k) for k in range(len(q))],
        "field.header.stamp": stamps,
        "field.header.frame_id": [""] * len(q),
    }
    groups = {"q": q, "q_d": 0 * q, "dq": dq, "tau_J": tau, "dtau_J": 0 * q, "tau_J_d": 0 * q}
    for name, array in groups.items():
        for j, x in enumerate(array.T):
            columns[f"field.{name}{j}"] = [repr(float(v)) for v in x]
    return _lines(columns, ",")
