"""How records show themselves in a notebook: as a table, and as a figure on request."""

from __future__ import annotations

import html
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Shown:
    """A record with a short `repr` and a table, shown in a notebook as both."""

    def _repr_html_(self) -> str:
        """Return line and table for a notebook, the table shortened."""
        table: Any = self.to_frame()  # type: ignore[attr-defined]
        return f"<p>{html.escape(repr(self))}</p>{table.to_html(index=False, max_rows=10, max_cols=12)}"

    def plot(self) -> Figure:
        """Return a figure of the record, for `savefig`.

        Raises:
            TypeError: there is no figure of such records.
        """
        # By name: a record is known to all stages, and what draws it is one of the last.
        figure: Figure = import_module("granite_lab.api.plots").plot(self)
        return figure
