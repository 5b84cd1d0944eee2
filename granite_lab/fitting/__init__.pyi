from .atheta import fit_a_theta, published_fit
from .drive import driven
from .fit import AThetaFit, FitStatus, K92Fit, Law
from .k92 import fit_k92, simulate_k92, simulated_slip, slip_interval
from .tow import towed

__all__ = [
    "AThetaFit",
    "FitStatus",
    "K92Fit",
    "Law",
    "driven",
    "fit_a_theta",
    "fit_k92",
    "published_fit",
    "simulate_k92",
    "simulated_slip",
    "slip_interval",
    "towed",
]
