from .chain import correct, estimate
from .judgement import Judgement, judge
from .motion import Health, Motion
from .slip import wheel_slip

__all__ = ["Health", "Judgement", "Motion", "correct", "estimate", "judge", "wheel_slip"]
