from .chain import correct, estimate
from .motion import Health, Judgement, Motion, judge
from .outcome import wheel_slip

__all__ = ["Health", "Judgement", "Motion", "correct", "estimate", "judge", "wheel_slip"]
