"""From measured and simulated slip to k_92 of each trial and a_θ over trials."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
