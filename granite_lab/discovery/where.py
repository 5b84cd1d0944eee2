"""Where the model and the trials disagree: intervals of the discrepancy that noise does not explain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from granite_lab.discovery.finding import Disagreement
from granite_lab.estimation.motion import PhaseName
from granite_lab.inference.constants import CREDIBLE, SMOOTH
from granite_lab.inference.gap import Discrepancy
from granite_lab.inference.problem import Problem


def disagreements(
    problem: Problem, discrepancies: Sequence[Discrepancy], tolerance: float
) -> tuple[Disagreement, ...]:
    """Return the intervals in which a discrepancy exceeds tolerance and noise, the largest first.

    Args:
        problem: gives times and phases.
        discrepancies: the discrepancies.
        tolerance: as a share of a channel's rms.
    """
    rows = []
    for d in discrepancies:
        o = problem.trials[problem.commands[d.command][0]].observation
        phase = o.phase
        certain = -ndtri((1 - CREDIBLE) / 2 / d.value.size)  # no instant by chance in nine of ten intervals
        hit = (np.abs(d.value) > certain * d.std) & (np.abs(d.value) > tolerance * d.size) & (d.std > 0)
        for a, b in intervals(hit, phase, round(SMOOTH[0] / o.width)):
            value, std = d.value[a:b], d.std[a:b]
            rows.append(
                Disagreement(
                    channel=d.channel,
                    phase=cast(PhaseName, phase[(a + b) // 2]),
                    variant=o.variant.velocity,
                    start=float(o.t[a] - o.width / 2),
                    end=float(o.t[b - 1] + o.width / 2),
                    frequency=_frequency(value, o.width),
                    share=float(np.sqrt(np.mean(value**2))) / d.size,
                    score=float(np.sqrt(np.mean((value[std > 0] / std[std > 0]) ** 2))),
                )
            )
    return tuple(sorted(rows, key=lambda r: -r.share * np.sqrt(r.end - r.start)))


def intervals(hit: npt.NDArray[np.bool_], phase: Sequence[str], gap: int) -> list[tuple[int, int]]:
    """Return the runs of hits, joined over gaps of some bins, cut where the phase changes."""
    runs: list[tuple[int, int]] = []
    for k in np.flatnonzero(hit).tolist():
        if runs and k - runs[-1][1] <= gap and phase[k] == phase[runs[-1][0]]:
            runs[-1] = (runs[-1][0], k + 1)
        else:
            runs.append((k, k + 1))
    return runs


def _frequency(value: np.ndarray[tuple[int, ...], np.dtype[np.float64]], width: float) -> float:
    """Return the frequency of the largest part of an interval [Hz]; 0 where it keeps its sign."""
    power = np.abs(np.fft.rfft(value)) ** 2
    return float(np.fft.rfftfreq(value.size, width)[int(np.argmax(power))])
