"""Tests of a finished diagnosis: other logs, simulation, the thesis's lines."""
