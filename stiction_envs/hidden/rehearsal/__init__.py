"""Hides a cause in the motion of a user's log, and diagnoses the simulated log."""
