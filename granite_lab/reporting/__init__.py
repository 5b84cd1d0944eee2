"""Report, figures and recordings: leaves of the chain that nothing else imports."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granite_lab.reporting.write import write_comparison, write_discovery, write_report

__all__ = ["write_comparison", "write_discovery", "write_report"]


def __getattr__(name: str) -> Any:
    """Import the writers when they are first asked for: they need matplotlib and Jinja."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from granite_lab.reporting import write  # noqa: PLC0415

    return getattr(write, name)
