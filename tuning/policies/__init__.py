"""Policies that dither: trained, kept in a file that runs no code, evaluated, made a table."""
