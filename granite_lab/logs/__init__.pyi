from .canonical import write_canonical, write_truth
from .inspection import Inspection, inspect_logs
from .reader import Excerpt, read_trial

__all__ = ["Excerpt", "Inspection", "inspect_logs", "read_trial", "write_canonical", "write_truth"]
