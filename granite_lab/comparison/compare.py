"""One trial beside its simulation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from granite_lab.comparison.channels import UNITS, measured_channels, simulated_channels, without_offsets
from granite_lab.comparison.record import Comparison, Misfit
from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import K92Fit
from granite_lab.fitting.k92 import simulate_k92
from granite_lab.logs.trial import Array, Trial
from granite_lab.model import Run
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil

PHASES = ("all", "rest", "accelerate", "steady", "brake")

SLIP_STD_USED = 0.1
"""Slip ratios with a larger std say nothing (the last moments before standstill, section 5)."""


def compare(
    motion: Motion,
    trial: Trial,
    fit: K92Fit,
    robot: Robot,
    soil: Soil,
    *,
    effects: Sequence[Active] = (),
    run: Run | None = None,
) -> Comparison:
    """Hold a trial against its simulation, channel by channel and phase by phase.

    Args:
        motion: the estimate.
        trial: as estimation corrected it; currents and IMU are compared as well.
        fit: its k_92 (by steady slip) is simulated by (5), its t_start aligns the two in time.
        robot: with chassis and drive.
        soil: the ground.
        effects: effects added to the paper's model.
        run: a simulation to compare with instead.

    Raises:
        EstimateError: the start of the command is unknown, or the simulation fails.
        InputError: the robot's file lacks chassis or drive.
    """
    if run is None:
        run = simulate_k92(fit.variant, robot, soil, fit.k92.value, effects=effects)
    start = fit.t_start.value if np.isfinite(fit.t_start.value) else motion.t_start.value
    if not np.isfinite(start):
        raise EstimateError(
            f"{motion.trial}: the start of the command is unknown, so no simulation can be aligned with it",
            "the log must contain the beginning of the motion",
        )
    t = motion.t - start
    simulated = simulated_channels(run, t)
    measured = without_offsets(measured_channels(motion, trial, robot, t), simulated, t)
    misfits: list[Misfit] = []
    for name, (value, own) in measured.items():
        std = np.hypot(own, alignment_std(simulated[name], t, fit.t_start))
        misfits += misfits_of(name, value, std, simulated[name], np.array(motion.phase))
    return Comparison(
        motion=motion,
        run=run,
        fit=fit,
        t=t,
        measured={name: value for name, (value, _) in measured.items()},
        measured_std={name: std for name, (_, std) in measured.items()},
        simulated=simulated,
        units=dict(UNITS),
        misfits=tuple(misfits),
    )


def alignment_std(simulated: Array, t: Array, start: Estimate) -> Array:
    """Return the std (N,) that the uncertain start of the command gives a difference, |df/dt| σ."""
    if not np.isfinite(start.std):
        return np.zeros(t.size)
    return np.abs(np.gradient(simulated, t)) * start.std


def misfits_of(
    channel: str, measured: Array, std: Array, simulated: Array, phase: npt.NDArray[np.str_]
) -> list[Misfit]:
    """Return the misfit over the whole trial and over each phase that has samples.

    Args:
        channel: its name.
        measured, simulated: (N,) in the channel's unit.
        std: (N,) of their difference.
        phase: (N,) phase of each sample.
    """
    difference = simulated - measured
    usable = np.isfinite(difference)
    if channel.startswith("slip"):
        usable &= ~(std > SLIP_STD_USED) & (phase != "rest")
    found = []
    for name in PHASES:
        mask = usable if name == "all" else usable & (phase == name)
        if not mask.any():
            continue
        d, s = difference[mask], std[mask]
        known = np.isfinite(s) & (s > 0)
        found.append(
            Misfit(
                channel=channel,
                unit=UNITS[channel],
                phase=name,
                rms=float(np.sqrt(np.mean(d**2))),
                bias=float(d.mean()),
                peak=float(np.abs(d).max()),
                normalised=float(np.sqrt(np.mean((d[known] / s[known]) ** 2))) if known.any() else np.nan,
                samples=int(mask.sum()),
            )
        )
    return found
