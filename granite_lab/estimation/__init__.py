"""From a trial to its motion: velocity, pitch, wheel speeds and slip, each with its std."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granite_lab.estimation.chain import estimate
    from granite_lab.estimation.judgement import Judgement, judge
    from granite_lab.estimation.motion import Health, Motion
    from granite_lab.estimation.slip import wheel_slip

__all__ = ["Health", "Judgement", "Motion", "estimate", "judge", "wheel_slip"]

_HOMES = {
    "Health": "motion", "Judgement": "judgement", "Motion": "motion",
    "estimate": "chain", "judge": "judgement", "wheel_slip": "slip",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is: who only needs the record does not wait for the filter."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
