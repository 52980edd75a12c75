"""The Generated Trajectory Experiment: paths under Cartesian impedance control."""
