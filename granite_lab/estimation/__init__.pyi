from .as_built import as_built
from .chain import correct
from .motion import Health, Judgement, Motion, judge
from .outcome import wheel_slip

__all__ = ["Health", "Judgement", "Motion", "as_built", "correct", "judge", "wheel_slip"]
