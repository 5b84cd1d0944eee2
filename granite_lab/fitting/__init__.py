"""From measured and simulated slip to k_92 of each trial and a_θ over trials."""

from __future__ import annotations

from typing import TYPE_CHECKING

from granite_lab.lazily import lazily

if TYPE_CHECKING:
    from granite_lab.fitting.atheta import fit_a_theta, published_fit
    from granite_lab.fitting.fit import AThetaFit, FitStatus, K92Fit, Law
    from granite_lab.fitting.k92 import fit_k92, slip_interval
    from granite_lab.fitting.slip import fit_k92_to_slip, simulate_k92, simulated_slip
    from granite_lab.fitting.trajectory import Trajectories, fit_trajectories

__all__ = [
    "AThetaFit",
    "FitStatus",
    "K92Fit",
    "Law",
    "Trajectories",
    "fit_a_theta",
    "fit_k92",
    "fit_k92_to_slip",
    "fit_trajectories",
    "published_fit",
    "simulate_k92",
    "simulated_slip",
    "slip_interval",
]

__getattr__ = lazily(
    __name__,
    {
        "granite_lab.fitting.atheta": ("fit_a_theta", "published_fit"),
        "granite_lab.fitting.fit": ("AThetaFit", "FitStatus", "K92Fit", "Law"),
        "granite_lab.fitting.k92": ("fit_k92", "slip_interval"),
        "granite_lab.fitting.slip": ("fit_k92_to_slip", "simulate_k92", "simulated_slip"),
        "granite_lab.fitting.trajectory": ("Trajectories", "fit_trajectories"),
    },
)
