"""Figures do not depend on who draws them."""

from __future__ import annotations

import os
import signal
import sys

import pytest
from matplotlib.figure import Figure as Canvas

from granite_lab.errors import LabError
from granite_lab.reporting.canvas import FEW, Figure, rendered


def drawing(k: int) -> Figure:
    def drawn() -> Canvas:
        figure = Canvas(figsize=(1, 1))
        figure.add_subplot().plot([0, k])
        return figure

    return Figure(f"d{k}", "a line", "It rises.", drawn)


def test_two_processes_draw_the_same_bytes_in_the_same_order() -> None:
    drawings = [drawing(k) for k in range(2 * FEW)]
    alone = list(rendered(drawings, 1))
    assert len({files["svg"] for files in alone}) == len(drawings)
    assert list(rendered(drawings, 2)) == alone


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere this process draws")
def test_a_process_that_dies_is_an_error_with_a_hint() -> None:
    def deadly() -> Canvas:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError

    drawings = [drawing(k) for k in range(2 * FEW - 1)] + [Figure("x", "t", "s", deadly)]
    with pytest.raises(LabError, match="a process that drew figures has died") as caught:
        list(rendered(drawings, 2))
    assert "--jobs 1" in caught.value.hint
