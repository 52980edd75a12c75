"""Errors of the log itself: offsets, gains, delays; one file per cause."""
