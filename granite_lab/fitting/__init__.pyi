from .atheta import fit_a_theta, published_fit
from .drive import with_drive_input
from .fit import AThetaFit, FitStatus, K92Fit, Law
from .k92 import fit_k92, simulate_k92, simulated_slip, slip_interval
from .tow import with_towed_load

__all__ = [
    "AThetaFit",
    "FitStatus",
    "K92Fit",
    "Law",
    "fit_a_theta",
    "fit_k92",
    "published_fit",
    "simulate_k92",
    "simulated_slip",
    "slip_interval",
    "with_drive_input",
    "with_towed_load",
]
