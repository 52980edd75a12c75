"""Tuning beside a real robot: which settings to measure next, and what to believe of the others."""
