"""How work is done: in which processes, on which cluster, and what need not be done again."""

from granite_lab.running.cache import Cache
from granite_lab.running.each import Execution, each_trial, split_failures

__all__ = ["Cache", "Execution", "each_trial", "split_failures"]
