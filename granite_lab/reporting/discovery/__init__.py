"""What a search for the missing effect found, as a part of a report or as a report of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granite_lab.reporting.discovery.evidence import section

__all__ = ["section"]


def __getattr__(name: str) -> Any:
    """Import the section when it is first asked for: recordings need the names only, not matplotlib."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from granite_lab.reporting.discovery import evidence  # noqa: PLC0415

    return getattr(evidence, name)
