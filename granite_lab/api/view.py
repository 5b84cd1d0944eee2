"""`view`: a recording in the Rerun viewer, in a browser, or as a picture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from granite_lab.api.calls import checked
from granite_lab.errors import InputError, UsageError
from granite_lab.files import is_folder
from granite_lab.logs.named import is_log, name_of


@checked
def view(
    what: str | Path,
    *,
    trial: str | None = None,
    web: bool = False,
    screenshot: str | Path | None = None,
    at: float | None = None,
    robot: str | Path | None = None,
    soil: str | Path | None = None,
    column_map: str | Path | None = None,
    tell: Callable[[str], None] = print,
) -> None:
    """Open a timeline in the Rerun viewer, and return while it stays open.

    Args:
        what: a recording (.rrd), a report folder, or a log.
        trial: with a report folder, the trial to open.
        web: serve the viewer to a browser on this machine instead, until interrupted.
        screenshot: save a picture of the viewer (.png) instead; no display is needed.
        at: with `screenshot`, the time since the start of the command [s]; else the middle.
        robot, soil, column_map: with a log, names or files.
        tell: called with the address, with `web`.

    Raises:
        InputError: there is no such recording, or the log cannot be used.
        UsageError: `web` and `screenshot` together, `at` alone or outside of the recording.
        LabError: there is no display, viewer or graphics driver.
    """
    from granite_lab.reporting.recording import open_viewer, save_picture, serve  # noqa: PLC0415, heavy

    if web and screenshot is not None:
        raise UsageError("--web and --screenshot: one of them at a time", "run the command twice")
    if at is not None and screenshot is None:
        raise UsageError("--at: only a picture has a time", "add --screenshot FILE.png")
    path = _recording(Path(what), trial, robot, soil, column_map)
    if screenshot is not None:
        save_picture(path, Path(screenshot), at)
    elif web:
        serve(path, tell)
    else:
        open_viewer(path)


def _recording(
    path: Path,
    trial: str | None,
    robot: str | Path | None,
    soil: str | Path | None,
    column_map: str | Path | None,
) -> Path:
    """Return the recording that is meant; of a log, it is made below ``reports/view``."""
    if is_folder(path) and not is_log(path):
        return recording_in(path, trial)
    if path.suffix == ".rrd":
        return path
    from granite_lab.api.options import options_of  # noqa: PLC0415, heavy
    from granite_lab.api.project import choose  # noqa: PLC0415, heavy
    from granite_lab.reporting.recording import record_trial  # noqa: PLC0415, heavy
    from granite_lab.study import analyse  # noqa: PLC0415, heavy

    said = choose(path, robot, soil, column_map, everything=True)
    result = analyse(path, options_of(robot=said.robot, soil=said.soil, column_map=said.column_map))
    made = Path("reports") / "view" / f"{name_of(path)}.rrd"
    return record_trial(result.trial, result.comparison, made)


def recording_in(folder: Path, trial: str | None) -> Path:
    """Return the recording of a trial in a report folder, or that of the whole study.

    Raises:
        InputError: there is none.
    """
    found = sorted(folder.rglob("*.rrd"))
    if not found:
        raise InputError(
            f"{folder}: no recording in it", "make one with 'granite-lab study TRIALS --out DIR'"
        )
    if trial is None:
        return next((path for path in found if path.stem == "study"), found[0])
    for path in found:
        if path.stem == trial:
            return path
    raise InputError(
        f"{folder}: no recording of trial '{trial}'", f"there are: {', '.join(path.stem for path in found)}"
    )
