"""Report, figures and recordings: leaves of the chain that nothing else imports."""

from __future__ import annotations

from typing import TYPE_CHECKING

from granite_lab.lazily import lazily

if TYPE_CHECKING:
    from granite_lab.reporting.write import write_comparison, write_discovery, write_finding, write_report

__all__ = ["write_comparison", "write_discovery", "write_finding", "write_report"]


# they need matplotlib and Jinja
__getattr__ = lazily(__name__, {"granite_lab.reporting.write": __all__})
