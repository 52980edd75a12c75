"""Friction in the joint: a cause per file."""
