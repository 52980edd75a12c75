"""Joint friction."""
