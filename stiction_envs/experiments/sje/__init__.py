"""The Single Joint Experiment: the torque at which a joint breaks away."""
