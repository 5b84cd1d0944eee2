"""From a trial to its motion: velocity, pitch, wheel speeds and slip, each with its std."""

from granite_lab.estimation.chain import estimate
from granite_lab.estimation.judgement import Judgement, judge
from granite_lab.estimation.motion import Health, Motion
from granite_lab.estimation.slip import wheel_slip

__all__ = ["Health", "Judgement", "Motion", "estimate", "judge", "wheel_slip"]
