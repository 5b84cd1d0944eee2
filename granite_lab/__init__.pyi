from .api.hidden import hide, reveal
from .api.logs import check, ingest, inspect, view
from .api.model import list_effects, params, robot, show_effect, simulate, wheel
from .api.plots import plot
from .api.run_checks import Checked
from .api.trials import compare, discover, fit_a_theta, fit_k92, plan_next, record, report, study
from .api.verification import verify
from .errors import EstimateError, InputError, LabError, UsageError
from .estimate import Estimate
from .two_studies import compare_studies

__version__: str

__all__ = [
    "Checked",
    "Estimate",
    "EstimateError",
    "InputError",
    "LabError",
    "UsageError",
    "check",
    "compare",
    "compare_studies",
    "discover",
    "fit_a_theta",
    "fit_k92",
    "hide",
    "ingest",
    "inspect",
    "list_effects",
    "params",
    "plan_next",
    "plot",
    "record",
    "report",
    "reveal",
    "robot",
    "show_effect",
    "simulate",
    "study",
    "verify",
    "view",
    "wheel",
]
