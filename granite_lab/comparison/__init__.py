"""Measured against simulated, channel by channel and phase by phase."""

from granite_lab.comparison.compare import compare
from granite_lab.comparison.record import Comparison, Misfit
from granite_lab.comparison.table import Table3Row, table3

__all__ = ["Comparison", "Misfit", "Table3Row", "compare", "table3"]
