"""Opening a recording in the Rerun viewer."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

from granite_lab.errors import InputError, LabError
from granite_lab.files import readable, refuse_special

PATIENCE = 4.0
"""How long a viewer that cannot start may take to say so [s]."""
MAGIC = b"RRF"


def open_viewer(path: Path) -> None:
    """Open a recording in a viewer window of its own and return while it stays open.

    Raises:
        InputError: there is no such file, or it is no recording.
        LabError: this machine has no display, no viewer, or no graphics driver.
    """
    refuse_special(path)
    try:
        with path.open("rb") as file:
            magic = file.read(len(MAGIC))
    except OSError as error:
        raise readable(error, path) from None
    if magic != MAGIC:
        raise InputError(
            f"{path}: not a Rerun recording", "make one with 'granite-lab study TRIALS --out DIR'"
        )
    elsewhere = f"copy {path.name} to a computer with a screen and run 'rerun {path.name}' there"
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise LabError("there is no display to open the Rerun viewer on", elsewhere)
    viewer = _start(path, elsewhere)
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if viewer.poll() not in (None, 0):
            raise LabError(f"the Rerun viewer ended at once with code {viewer.returncode}", elsewhere)
        time.sleep(0.05)


def _start(path: Path, elsewhere: str) -> subprocess.Popen[bytes]:
    """Start the viewer that comes with the rerun-sdk package, apart from this process."""
    command = [sys.executable, "-m", "rerun", "--new", str(path.resolve())]
    try:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise LabError(f"the Rerun viewer cannot be started: {reason}", elsewhere) from None
