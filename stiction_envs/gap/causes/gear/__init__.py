"""Gears that are loose or soft: a cause per file."""
