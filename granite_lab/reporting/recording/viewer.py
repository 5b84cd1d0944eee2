"""Recordings in the Rerun viewer, in a window of its own."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from granite_lab.errors import InputError, LabError
from granite_lab.files import readable, refuse_special

PATIENCE = 4.0
"""Time within which a viewer that cannot start ends [s]."""


def open_viewer(paths: Sequence[Path]) -> None:
    """Open recordings in a viewer window of their own and return while it stays open.

    Raises:
        InputError: there is no such file, or it is no recording.
        LabError: this machine has no display, no viewer, or no graphics driver.
    """
    for path in paths:
        _refuse_others(path)
    files = [str(path.resolve()) for path in paths]
    elsewhere = (
        f"see it in a browser with 'rerun --bind 127.0.0.1 --serve-web {shlex.join(files[:1])}', "
        "or copy that file to a computer with a screen and open it with 'rerun FILE'"
    )
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not display:
        raise LabError("there is no display to open the Rerun viewer on", elsewhere)
    viewer = _start(files)
    try:
        code = viewer.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        return
    if code:
        raise LabError(f"the Rerun viewer ended at once with code {code}", elsewhere)


def _refuse_others(path: Path) -> None:
    """Raise InputError where there is no such file, or where it is no recording."""
    refuse_special(path)
    try:
        with path.open("rb") as file:
            is_recording = file.read(3) == b"RRF"
    except OSError as error:
        raise readable(error, path) from None
    if not is_recording:
        hint = "make one with 'granite-lab study TRIALS --out DIR'"
        raise InputError(f"{path}: not a Rerun recording", hint)


def _start(files: Sequence[str]) -> subprocess.Popen[bytes]:
    """Start the viewer that comes with the rerun-sdk package on files, bound to this machine only."""
    import rerun_cli  # type: ignore[import-untyped]  # noqa: PLC0415, heavy

    # The program itself: the Python process that 'python -m rerun' puts around it would end without it.
    folder = Path(rerun_cli.__file__).parent
    places = [folder / name for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun")]
    binary = next((place for place in places if place.exists()), places[-1])
    quiet: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    try:
        return subprocess.Popen(
            [binary, "--bind", "127.0.0.1", "--new", *files], start_new_session=True, **quiet
        )
    except OSError as error:
        reason = error.strerror or type(error).__name__
        hint = "install it again with 'pip install --force-reinstall rerun-sdk'"
        raise LabError(f"the Rerun viewer cannot be started: {reason}", hint) from None
