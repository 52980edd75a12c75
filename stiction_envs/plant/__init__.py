"""N arms in lockstep: the only room of the project that steps physics."""

from stiction_envs.plant.plant import CONTROL_DT, SLOW_STEPS, Plant, raise_if_stopped

__all__ = ["CONTROL_DT", "SLOW_STEPS", "Plant", "raise_if_stopped"]
