"""Report, figures and recordings: leaves of the chain that nothing else imports."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
