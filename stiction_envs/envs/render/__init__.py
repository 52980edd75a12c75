"""Frames of the environments."""
