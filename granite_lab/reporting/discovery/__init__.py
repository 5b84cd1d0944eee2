"""What a search for the missing effect found, as a part of a report or as a report of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from granite_lab.lazily import lazily

if TYPE_CHECKING:
    from granite_lab.reporting.discovery.evidence import bare_section, section

__all__ = ["bare_section", "section"]


# recordings need the names only, not matplotlib
__getattr__ = lazily(__name__, {"granite_lab.reporting.discovery.evidence": __all__})
