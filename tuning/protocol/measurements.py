"""Measurements as plain data that read back exactly; traces are thinned for plots."""

from __future__ import annotations

import numpy as np

from stiction_envs.experiments.sje.protocol import Job, Measurement
from stiction_envs.reporting.json_text import JsonRecord

TRACE_POINTS = 150
"""Most points kept of a trace (assumed)."""


def change(m: Measurement, base: Measurement) -> float:
    """Return the change of |τ| against the base, per cent; negative is less torque."""
    return 100.0 * (abs(m.mean) / abs(base.mean) - 1.0)


def as_data(m: Measurement) -> dict[str, object]:
    """Return the results of a measurement for JSON, without its job."""
    longest = max(len(t) for t in m.traces)
    stride = max(1, -(-longest // TRACE_POINTS))
    return {
        "tau": m.tau.tolist(),
        "start": m.start.tolist(),
        "start_torque": m.start_torque.tolist(),
        "shaken_speed": m.shaken_speed.tolist(),
        "traces": [[round(float(x), 6) for x in t[stride - 1 :: stride]] for t in m.traces],
        "trace_dt": m.trace_dt * stride,
    }


def from_data(job: Job, data: JsonRecord) -> Measurement:
    """Return the measurement of a job."""
    return Measurement(
        job=job,
        tau=np.array(data["tau"], dtype=float),
        start=np.array(data["start"]),
        start_torque=np.array(data["start_torque"]),
        shaken_speed=np.array(data["shaken_speed"]),
        traces=tuple(np.array(t, dtype=np.float32) for t in data["traces"]),
        trace_dt=data["trace_dt"],
    )
