"""Simulation against measurement: residual, causes, extended model, gain."""
