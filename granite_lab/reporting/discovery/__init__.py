"""What a search for the missing effect found, as a part of a report or as a report of its own."""

from granite_lab.reporting.discovery.section import section

__all__ = ["section"]
