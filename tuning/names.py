"""Names that users type; commands have them without loading what they stand for."""

from stiction_envs.control import COMPENSATIONS

SAMPLERS = ("gp", "tpe", "cmaes", "random", "grid")
OBJECTIVES = ("sje", "gte", "both")
"""Objective of a search: breakaway torque of joints, error at the goals of a path, or both."""
TREATMENTS: dict[str, tuple[str, ...]] = {
    **{name: (name,) for name in ("dither", *COMPENSATIONS)},
    "observer": ("lugre_observer", "momentum_observer"),
    "all": ("dither", *COMPENSATIONS),
}
"""Treatments to search, by the name of the option: dither, or a compensation."""
ALGORITHMS = ("sac", "ppo", "td3")
CHECKPOINT_EVERY = 20_000  # Steps between two checkpoints of a training
POLICIES = ("none", "gated", "random")  # Policies that need no file
GATED = "_gated"  # End of the name of a shipped table with gates
EPISODES = 32  # Episodes on which a policy is evaluated
PATHS = ("triangle", "pentagon", "random")  # Paths of the GTE: the thesis's, and drawn ones
