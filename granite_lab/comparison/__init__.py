"""Measured against simulated, channel by channel and phase by phase."""

from granite_lab.comparison.compare import compare
from granite_lab.comparison.record import Comparison, Misfit

__all__ = ["Comparison", "Misfit", "compare"]
