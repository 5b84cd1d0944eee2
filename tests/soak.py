"""What runs whole only in `make soak`."""

import os

SOAK = bool(os.environ.get("GRANITE_SOAK"))
"""Whether the long parts run whole, as in `make soak`."""
