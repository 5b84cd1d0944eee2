"""From a trial to its motion: velocity, pitch, wheel speeds and slip, each with its std."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
