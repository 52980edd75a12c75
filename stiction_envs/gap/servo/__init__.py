"""Logs of commanded and measured positions: what a simulated position servo gets wrong."""
