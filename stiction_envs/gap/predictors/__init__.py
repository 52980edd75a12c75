"""Predictors of what was measured, one per kind of data, as equations of the judge."""
