"""What the residuals of a finding look like: means over repetitions, and discrepancies as shares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granite_lab.discovery.finding import Finding, Residual
from granite_lab.logs.trial import Array
from granite_lab.reporting.discovery.names import channels_of


def means(finding: Finding) -> list[tuple[int, Residual]]:
    """Average over the trials of each command, slow commands first, channels in the order of the report.

    Returns:
        how many trials went in, and their mean, NaN where no trial was measured; the discrepancy is shared.
    """
    groups: dict[tuple[str, float, tuple[str, ...]], list[Residual]] = {}
    for r in finding.residuals:
        groups.setdefault((r.channel, r.variant, r.phase), []).append(r)
    order = channels_of(finding)
    ranked = sorted(groups.items(), key=lambda g: (g[0][1], order.index(g[0][0])))
    return [(len(group), _mean(group)) for _, group in ranked]


def _mean(group: list[Residual]) -> Residual:
    known = np.array([np.isfinite(r.measured) for r in group])
    count = known.sum(axis=0)

    def average(name: str) -> Array:
        rows = np.array([getattr(r, name) for r in group])
        total = np.where(known & np.isfinite(rows), rows, 0.0).sum(axis=0)
        return np.where(count > 0, total / np.fmax(count, 1), np.nan)

    return replace(group[0], measured=average("measured"), before=average("before"), after=average("after"))


def discrepancies(finding: Finding) -> dict[str, tuple[float, float]]:
    """Return channel to the rms of its discrepancy in motion over the channel's rms, before and after."""
    found = {}
    for channel in channels_of(finding):
        own = [r for r in finding.residuals if r.channel == channel and r.size > 0]
        found[channel] = (_share(own, "discrepancy_before"), _share(own, "discrepancy_after"))
    return found


def _share(own: list[Residual], name: str) -> float:
    """Pool the squares over the bins in which a discrepancy is looked for, those of the motion."""
    parts = [getattr(r, name)[r.std > 0] / r.size for r in own]
    values = np.concatenate(parts) if parts else np.zeros(0)
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
