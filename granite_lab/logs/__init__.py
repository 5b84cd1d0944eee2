"""From CSV logs to a Trial: columns and units, clocks, wraps and gaps."""

from granite_lab.logs.canonical import write_canonical, write_truth
from granite_lab.logs.inspected import Inspection
from granite_lab.logs.inspection import inspect_logs
from granite_lab.logs.reader import read_trial

__all__ = ["Inspection", "inspect_logs", "read_trial", "write_canonical", "write_truth"]
