"""Where the real logs of other robots lie, and the marks of tests that read them."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("GRANITE_LAB_REAL_LOGS") or Path(__file__).parents[2] / "shared" / "data")
MARKS = [pytest.mark.real_logs, pytest.mark.skipif(not DATA.is_dir(), reason="the real logs are not here")]
