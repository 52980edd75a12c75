"""Policies that dither: training, files that run no code, evaluation, conversion to a table."""
