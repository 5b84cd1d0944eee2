"""Two logs that hold the sensors of one trial between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.layouts import Maps, given_maps
from granite_lab.logs.quantities import ACCELERATION, CURRENTS, ENCODERS, RATE
from granite_lab.logs.sensors.clock import row_stamps
from granite_lab.logs.source import read_source, recognise

_IN_COMMON = 0.5  # share of the shorter log in which both run, of two halves of a trial


def halves(
    files: Sequence[Path], maps: Maps = None, topics: Mapping[str, str] | None = None
) -> tuple[dict[str, Path], str]:
    """Find out whether two logs are one trial: one holds an IMU alone, the other only encoders or currents.

    Returns:
        what each file is to be read as, `imu` and `encoders` or `currents`, empty if they are two trials;
        and a line that says what was done, empty if nothing is to be said.
    """
    if len(files) != 2:
        return {}, ""
    try:
        layouts = given_maps(maps)
        sources = [read_source(recognise(file, layouts, topics)) for file in files]
        stamps = [row_stamps(source) for source in sources]
    except InputError:  # which is told when the log is read
        return {}, ""
    imu = [bool(source.bindings(*ACCELERATION, *RATE)) for source in sources]
    wheels = [bool(source.bindings(*ENCODERS)) for source in sources]
    driven = [wheels[k] or bool(source.bindings(*CURRENTS)) for k, source in enumerate(sources)]
    first = 0 if imu[0] else 1
    other = 1 - first
    if not imu[first] or imu[other] or driven[first] or not driven[other]:
        return {}, ""
    role = "encoders" if wheels[other] else "currents"
    message = f"{files[first].name} holds an IMU alone and {files[other].name} {role} alone"
    (begin, end), (start, stop) = ((float(np.nanmin(t)), float(np.nanmax(t))) for t in stamps)
    if min(end, stop) - max(begin, start) < _IN_COMMON * min(end - begin, stop - start):
        typed = f"granite-lab ingest {files[first]} --{role} {files[other]}"
        return {}, f"{message}, at other times: read as two trials; as one: {typed}"
    return {"imu": files[first], role: files[other]}, f"{message}: read as one trial"
