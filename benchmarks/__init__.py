"""Measurements of the package itself, kept outside of the wheel: ``python -m benchmarks.NAME``."""
