"""The record of one simulated run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from granite_lab.parameters import Robot, Soil, Variant
from granite_lab.shown import Shown

if TYPE_CHECKING:  # a run is often made without ever becoming a table
    import pandas as pd

    from granite_lab.logs.trial import Array


@dataclass(frozen=True, eq=False)
class Run(Shown):
    """A simulated run; everything the model computes, over a uniform time grid.

    Attributes:
        variant: the commanded trapezoid.
        robot, soil: the parameters that were in force.
        k92_law: "constant" or "exponential" (27).
        k92_value: the constant k_92 [-], or a_θ [s/m].
        effects: ids of the effects switched on, with their parameters.
        signals: name to (N,) array; names are those of the run CSV (`x_m`, `v_mps`, …), with
            `t_s` = 0 at the start of the command and negative while the robot settles.
        slip_ratio: λ_R by (2) over the steady part, as a fraction.
        steady: start and end of the steady part [s].
        wall: time the integration took [s].
    """

    variant: Variant
    robot: Robot
    soil: Soil
    k92_law: str
    k92_value: float
    effects: dict[str, dict[str, float]]
    signals: dict[str, Array]
    slip_ratio: float
    steady: tuple[float, float]
    wall: float = field(compare=False)

    def __repr__(self) -> str:
        law = "k_92" if self.k92_law == "constant" else "a_θ"
        more = f", with {', '.join(self.effects)}" if self.effects else ""
        return (
            f"Run({self.variant.velocity:g} m/s, {law} {self.k92_value:.4g}{more}: slip ratio "
            f"{self.slip_ratio:.4f}, {len(self.t)} instants)"
        )

    def __getitem__(self, name: str) -> Array:
        """Return one signal, as in ``run["v_mps"]``."""
        return self.signals[name]

    @property
    def t(self) -> Array:
        """(N,) time since the start of the command [s]."""
        return self.signals["t_s"]

    def to_frame(self) -> pd.DataFrame:
        """Return all signals as a table, one row an instant, units in the column names."""
        import pandas as pd  # noqa: PLC0415

        return pd.DataFrame(self.signals)
