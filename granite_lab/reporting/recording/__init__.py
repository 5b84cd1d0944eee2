"""Rerun recordings: the only package that imports rerun."""

from granite_lab.reporting.recording.viewer import open_viewer
from granite_lab.reporting.recording.write import record_trial

__all__ = ["open_viewer", "record_trial"]
