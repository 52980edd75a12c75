"""Generators that hide an effect in data, and the reference law: for tests and benchmarks."""
