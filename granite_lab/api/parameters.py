"""`params`, `list_effects`, `show_effect`: the numbers in force, and what can be added to the model."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from granite_lab.api.calls import checked
from granite_lab.api.records import Records
from granite_lab.effects import get, library, load_effects
from granite_lab.model.effect import Effect
from granite_lab.parameters.catalogue import Provenance, forget, in_force

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Parameter:
    """One number in force: value, unit, allowed range, meaning and origin."""

    of: Provenance

    def to_frame(self) -> pd.DataFrame:
        """Return one row."""
        import pandas as pd  # noqa: PLC0415

        return pd.DataFrame([dataclasses.asdict(self.of)])


@dataclass(frozen=True)
class EffectRecord:
    """A physical effect that can be added to the paper's model."""

    effect: Effect

    @property
    def id(self) -> str:
        """The effect's name."""
        return self.effect.id

    def to_frame(self) -> pd.DataFrame:
        """Return its parameters, one row each; `neutral` is the value at which the effect vanishes."""
        import pandas as pd  # noqa: PLC0415

        rows = [
            {"effect": self.id, "title": self.effect.title, "parameter": p.name, "unit": p.unit,
             "meaning": p.meaning, "low": p.low, "high": p.high, "neutral": p.neutral}
            for p in self.effect.parameters
        ]  # fmt: skip
        return pd.DataFrame(rows)


@checked
def params(
    robot: str | Path | None = None, soil: str | Path | None = None, grade: str | None = None
) -> Records[Parameter]:
    """Return every number in force with its unit, allowed range and origin.

    Args:
        robot, soil: names or files; by default granite and dry_sand.
        grade: IMU grade instead of the robot's.

    Raises:
        UsageError: unknown robot, soil or IMU grade.
        InputError: a file is wrong.
    """
    forget()
    return Records(
        [Parameter(row) for row in in_force(str(robot or "granite"), str(soil or "dry_sand"), grade)]
    )


@checked
def list_effects(effects: str | Path | None = None) -> Records[EffectRecord]:
    """Return every effect that can be added to the paper's model.

    Args:
        effects: your own effect file (.py). It is run: use only code you trust.

    Raises:
        InputError: the file cannot be used.
    """
    known = library() | (load_effects(Path(effects)) if effects else {})
    return Records([EffectRecord(effect) for effect in known.values()])


@checked
def show_effect(effect_id: str, effects: str | Path | None = None) -> EffectRecord:
    """Return one effect: equation, source, parameters and what an observer sees.

    Args:
        effect_id: its id.
        effects: your own effect file (.py). It is run: use only code you trust.

    Raises:
        UsageError: no such effect.
    """
    own = load_effects(Path(effects)) if effects else {}
    return EffectRecord(get(effect_id, library() | own))
