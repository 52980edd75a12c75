"""Measured data: the thesis's tables and the user's, checked when they are read."""
