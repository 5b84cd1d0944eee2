"""What a search for the missing effect found, as a part of a report or as a report of its own."""

import lazy_loader

# recordings need the names only, not matplotlib
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
