"""Masses, inertias and the direction of gravity: a cause per file."""
