"""Measurements of speed and accuracy; run as ``python -m benchmarks.<name>``."""
