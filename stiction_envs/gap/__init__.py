"""Measured log or table, named causes, extended model, forward validation."""
