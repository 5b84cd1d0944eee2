"""Where simulation and measurement disagree, which effect is missing, and how sure that is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from granite_lab.lazily import lazily

if TYPE_CHECKING:
    from granite_lab.discovery.as_json import finding_as_json
    from granite_lab.discovery.discover import discover
    from granite_lab.discovery.finding import Finding

__all__ = ["Finding", "discover", "finding_as_json"]

__getattr__ = lazily(
    __name__,
    {
        "granite_lab.discovery.as_json": ("finding_as_json",),
        "granite_lab.discovery.discover": ("discover",),
        "granite_lab.discovery.finding": ("Finding",),
    },
)
