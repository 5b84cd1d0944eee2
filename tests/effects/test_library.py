"""The library finds its effects, and answers a wrong name with the nearest."""

from __future__ import annotations

import pytest

from granite_lab.effects import get
from granite_lab.errors import UsageError


def test_an_unknown_effect_is_answered_with_the_nearest_name() -> None:
    with pytest.raises(UsageError, match="unknown effect 'tire_windup'") as caught:
        get("tire_windup")
    assert "did you mean 'tyre_windup'?" in caught.value.hint
