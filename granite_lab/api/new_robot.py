"""`robot`: the file of a new robot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from granite_lab.api.arguments import Changes, File
from granite_lab.errors import UsageError
from granite_lab.files import write_text
from granite_lab.parameters.analyses import Allowed, allowed_by
from granite_lab.parameters.catalogue import forget, in_force, load_robot
from granite_lab.parameters.changes import OPTION, checked
from granite_lab.parameters.new_robot import text_of
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class RobotFile(Shown):
    """The file of a robot that was written, and what it allows."""

    path: Path
    analyses: tuple[Allowed, ...]

    def __repr__(self) -> str:
        allowed = ", ".join(one.analysis for one in self.analyses if one.allowed)
        return f"RobotFile('{self.path}': {allowed})"

    def to_frame(self) -> pd.DataFrame:
        """Return one row for each analysis."""
        import pandas as pd  # noqa: PLC0415, heavy

        return pd.concat([one.to_frame() for one in self.analyses], ignore_index=True)


def robot(new: str | Path, *, changes: Changes = None, like: File = None) -> RobotFile:
    """Write the file of a robot: every number with its meaning, what is not known as a comment.

    Args:
        new: the file (.toml); its stem becomes the robot's name.
        changes: numbers by their keys, as ``{"robot.wheels.radius_m": 0.1}``.
        like: a robot of the catalogue or a .toml file, whose numbers stand in for those that are not given.

    Returns:
        the path, and which analyses the file allows.

    Raises:
        UsageError: there is such a file, its name does not end in .toml, or the wheel radius is not known.
        InputError: a key is not known, or a number is out of its bounds.
        LabError: the file cannot be written.
    """
    path = Path(new)
    if path.suffix != ".toml":
        raise UsageError(f"{path}: the file of a robot ends in .toml", f"write {path.with_suffix('.toml')}")
    if path.exists():
        raise UsageError(f"{path}: exists already", "choose another name; edit the file that is there")
    given = dict(checked(changes or {}))
    if foreign := [key for key in given if not key.startswith("robot.")]:
        raise UsageError(f"{OPTION} {foreign[0]}: is no number of a robot", "a soil has a file of its own")
    text = text_of(path.stem, given, load_robot(like) if like else None)
    write_text(path, text)
    forget()
    return RobotFile(path, allowed_by(in_force(str(path), "dry_sand")))
