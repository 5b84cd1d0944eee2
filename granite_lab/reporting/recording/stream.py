"""An open recording: times since command start, an all-or-nothing file."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import rerun as rr

from granite_lab.files import write_bytes
from granite_lab.logs.trial import Array

TIMELINE = "time"
"""The one timeline: a duration since the start of the command, negative while the robot waits for it."""

NO_GLYPH = re.compile(r"[^\n -~\u00a0-\u017f\u0391-\u03a9\u03b1-\u03c9\u0400-\u045f‐-‧∂∆∑−√∞≈≠≤≥±²³°→₀-₉]")
"""What the viewer's only font, Inter, may lack; the viewer ends with an error where it meets one."""


def drawable(text: str) -> str:
    """Return a text of which the viewer can draw every character; others become question marks."""
    return NO_GLYPH.sub("?", text)


@dataclass(frozen=True, eq=False)
class Writer:
    """An open recording."""

    stream: Any

    def static(self, entity: str, *archetypes: Any) -> None:
        """Log what holds for all times."""
        self.stream.log(f"/{entity}", *archetypes, static=True)

    def rows(self, entity: str, t: Array, columns: Any) -> None:
        """Send the N rows of ``Archetype.columns`` at (N,) times since command start [s]."""
        stamps = np.round(np.asarray(t, float) * 1e9).astype("timedelta64[ns]")
        index = rr.TimeColumn(TIMELINE, duration=stamps)
        self.stream.send_columns(f"/{entity}", indexes=[index], columns=columns)


@contextmanager
def recording(path: Path, name: str, blueprint: Any) -> Iterator[Writer]:
    """Open a recording with a name and a layout; it appears at `path` only if all went well.

    Raises:
        LabError: the file cannot be written.
    """
    # The viewer keeps one layout per application id, so each name is an application of its own; the
    # random recording id keeps it from merging two versions of the same trial. Rerun allows letters,
    # digits and underscores.
    plain = re.sub(r"[^A-Za-z0-9]+", "_", name)[:60]
    application = f"granite_lab_{plain}_{zlib.crc32(name.encode(errors='replace')):08x}"
    stream = rr.RecordingStream(application, send_properties=False)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    strict = rr.strict_mode()
    rr.set_strict_mode(True)  # otherwise bad data only warn and are dropped
    try:
        with TemporaryDirectory() as folder:
            file = Path(folder) / "recording.rrd"
            stream.save(file, default_blueprint=blueprint)
            stream.send_recording_name(drawable(name))
            yield Writer(stream)
            stream.disconnect()  # writes the footer
            write_bytes(path, file.read_bytes())
    finally:
        stream.disconnect()
        rr.set_strict_mode(strict)
