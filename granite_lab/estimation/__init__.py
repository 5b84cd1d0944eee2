"""From a trial to its motion: velocity, pitch, wheel speeds and slip, each with its std."""

from __future__ import annotations

from typing import TYPE_CHECKING

from granite_lab.lazily import lazily

if TYPE_CHECKING:
    from granite_lab.estimation.chain import correct, estimate
    from granite_lab.estimation.judgement import Judgement, judge
    from granite_lab.estimation.motion import Health, Motion
    from granite_lab.estimation.slip import wheel_slip

__all__ = ["Health", "Judgement", "Motion", "correct", "estimate", "judge", "wheel_slip"]

__getattr__ = lazily(
    __name__,
    {
        "granite_lab.estimation.chain": ("correct", "estimate"),
        "granite_lab.estimation.judgement": ("Judgement", "judge"),
        "granite_lab.estimation.motion": ("Health", "Motion"),
        "granite_lab.estimation.slip": ("wheel_slip",),
    },
)
