"""Control: controllers, and the path of a commanded torque to the joint."""

COMPENSATIONS = ("feedforward", "push", "lugre_observer", "momentum_observer")
"""Names of the laws of friction compensation; written out, so that --help loads no law."""
