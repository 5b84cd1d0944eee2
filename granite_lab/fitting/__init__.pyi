from .atheta import fit_a_theta, published_fit
from .fit import AThetaFit, FitStatus, K92Fit, Law
from .k92 import fit_k92, slip_interval
from .slip import fit_k92_to_slip, simulate_k92, simulated_slip
from .trajectory import Trajectories, fit_trajectories

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
