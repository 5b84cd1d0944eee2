"""Report, figures and recordings: the last stage of the chain; no other stage imports it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
