"""The truth's simulator under the name that the tests know it by."""

from granite_lab.hidden.simulator import Result, build, simulate

__all__ = ["Result", "build", "simulate"]
