from .chain import correct
from .motion import Health, Judgement, Motion, judge
from .outcome import wheel_slip

__all__ = ["Health", "Judgement", "Motion", "correct", "judge", "wheel_slip"]
