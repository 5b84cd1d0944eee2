"""What runs whole only in `make soak`."""

from __future__ import annotations

import os

import pytest

SOAK = bool(os.environ.get("GRANITE_SOAK"))
"""Whether the long parts run whole, as in `make soak`."""

soak_only = pytest.mark.skipif(not SOAK, reason="a whole search of a minute: make soak")
