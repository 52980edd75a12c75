"""The thesis's dither tables as a test of the simulation."""
