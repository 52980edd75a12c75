"""Least squares on sums over blocks, with bounds, priors and random effects."""
