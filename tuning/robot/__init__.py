"""Tuning on a real robot: which settings to measure next, and what to expect of the others."""
