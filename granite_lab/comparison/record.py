"""The record of one trial's measurement beside its simulation."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import K92Fit
from granite_lab.logs.trial import Array
from granite_lab.model.run import Run
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Misfit:
    """How far simulation and measurement are apart in one channel and phase.

    Attributes:
        channel: as in `Comparison.measured`.
        unit: unit of `rms`, `bias` and `peak`.
        phase: "all", "rest", "accelerate", "steady" or "brake".
        rms, bias, peak: root mean square, mean and largest absolute difference (simulated minus measured).
        normalised: root mean square of the difference over its std (1 is the noise floor); NaN if unknown.
        samples: how many samples.
    """

    channel: str
    unit: str
    phase: str
    rms: float
    bias: float
    peak: float
    normalised: float
    samples: int


@dataclass(frozen=True, eq=False)
class Comparison(Shown):
    """One trial, measured and simulated on the same time axis.

    Attributes:
        motion: the estimate.
        run: the simulation with the fitted k_92.
        fit: the fit.
        t: (N,) time since the start of the command [s].
        measured, measured_std, simulated: channel to (N,) arrays; NaN where not measured. Channels:
            "velocity" [m/s], "wheel_fl" … "wheel_rr" [m/s], "slip_f", "slip_r" [-],
            "torque_f", "torque_r" [N m], "pitch" [rad], "accel" [m/s^2], "pitch_rate" [rad/s].
        units: channel to unit.
        misfits: per channel and phase.
    """

    motion: Motion
    run: Run
    fit: K92Fit
    t: Array
    measured: dict[str, Array]
    measured_std: dict[str, Array]
    simulated: dict[str, Array]
    units: dict[str, str]
    misfits: tuple[Misfit, ...]

    def __repr__(self) -> str:
        return f"Comparison({self.motion!r}, {self.fit!r}, {len(self.misfits)} misfits)"

    def to_frame(self) -> pd.DataFrame:
        """Return the misfits, one row a channel and phase; `unit` is that of rms, bias and peak."""
        import pandas as pd  # noqa: PLC0415

        return pd.DataFrame([dataclasses.asdict(misfit) for misfit in self.misfits])
