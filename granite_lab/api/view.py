"""`view`: a recording in the Rerun viewer."""

from __future__ import annotations

from pathlib import Path

from granite_lab.errors import InputError
from granite_lab.files import is_folder
from granite_lab.logs.named import is_bag, name_of


def view(
    what: str | Path,
    *,
    trial: str | None = None,
    robot: str | Path | None = None,
    soil: str | Path | None = None,
    column_map: str | Path | None = None,
) -> None:
    """Open a timeline in the Rerun viewer, and return while it stays open.

    Args:
        what: a recording (.rrd), a report folder, or a log.
        trial: with a report folder, the trial to open.
        robot, soil, column_map: with a log, names or files.

    Raises:
        InputError: there is no such recording, or the log cannot be used.
        LabError: there is no display or viewer.
    """
    from granite_lab.reporting.recording import open_viewer, record_trial  # noqa: PLC0415, heavy

    path = Path(what)
    if is_folder(path) and not is_bag(path):
        open_viewer(recording_in(path, trial))
    elif path.suffix == ".rrd":
        open_viewer(path)
    else:
        from granite_lab.api.options import options_of  # noqa: PLC0415, heavy
        from granite_lab.study import analyse  # noqa: PLC0415, heavy

        result = analyse(path, options_of(robot=robot, soil=soil, column_map=column_map))
        made = Path("reports") / "view" / f"{name_of(path)}.rrd"
        record_trial(result.trial, result.comparison, made)
        open_viewer(made)


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
