"""The bristle of a LuGre joint over one step, compiled, as MuJoCo's ``dcmotor`` integrates it."""

from __future__ import annotations

import numpy as np

from stiction_envs.compiled import compiled


@compiled
def bristle_after(deflection, speed, decay, step):  # type: ignore[no-untyped-def]
    """Return the deflection after a step at constant speed: exact solution of ż = v − |v| σ0/g z.

    ``deflection`` is z [rad], ``speed`` v [rad/s], ``decay`` |v| σ0/g times the step, above 0 [-].
    """
    e = np.expm1(-decay)
    return deflection + (e * deflection - e / decay * step * speed)
