"""Rerun recordings: the only package that imports rerun."""

from granite_lab.reporting.recording.viewer import open_viewer, save_picture, serve
from granite_lab.reporting.recording.write import record_study, record_trial

__all__ = ["open_viewer", "record_study", "record_trial", "save_picture", "serve"]
