"""Search beyond the thesis's grid: continuous, constrained, under more than one friction."""
