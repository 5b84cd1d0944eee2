"""An implementation of the paper, of sensors and of their faults that shares no code with the package."""

from tests.truth.trials import TruthTrial, generate, log_run

__all__ = ["TruthTrial", "generate", "log_run"]
