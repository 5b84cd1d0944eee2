"""From CSV logs to a Trial: columns and units, clocks, wraps and gaps."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
