"""The least-squares problem of trials that need not have been driven yet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import cholesky, toeplitz

from granite_lab.discovery.baseline import FLOOR
from granite_lab.discovery.bench import Bench
from granite_lab.discovery.binning import Stream
from granite_lab.discovery.noise import Whitener
from granite_lab.discovery.nuisance import TrialModel
from granite_lab.discovery.observation import AFTER, BEFORE, CHANNELS, Observation
from granite_lab.discovery.plan_design import Design, Driven, Noise, commanded_share
from granite_lab.discovery.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.command import duration, peak_velocity
from granite_lab.parameters import Variant

_GRID = 4096


def _covariance(lags: Sequence[float], n: int) -> Array:
    """Return the (n, n) covariance of stationary noise; what is no spectrum is cut off at zero."""
    r = np.zeros(_GRID)
    r[: len(lags)] = lags
    r[-len(lags) + 1 or _GRID :] = lags[:0:-1]
    spectrum = np.fmax(np.fft.rfft(r).real, 0.0)
    return np.asarray(toeplitz(np.fft.irfft(spectrum)[:n]))


def whitener_of(noise: Noise, channel: str, t: Array, variant: Variant, learnt_at: float) -> Whitener:
    """Return the whitening filter of a trial to come; vibration grows with the speed.

    Args:
        noise: of the channel.
        channel: its name.
        t: (n,) middle of each bin since the start of the command [s].
        variant: the command.
        learnt_at: speed at which the noise was learnt [m/s].
    """
    speed = commanded_share(t, variant) * peak_velocity(variant) / learnt_at
    Σ = _covariance(noise.rest, t.size) + FLOOR[channel] ** 2 * np.eye(t.size)
    if noise.driven:
        Σ += np.outer(speed, speed) * _covariance(noise.driven, t.size)
    return Whitener(cholesky(Σ, lower=True), np.ones(t.size, dtype=bool))


def staged(design: Design, bench: Bench, plan: Sequence[tuple[int, Driven]]) -> Problem:
    """Return the problem of trials without data: what the model says is what they show.

    Args:
        design: gives width, robot and channels.
        bench: its commands are those that the trials are numbered by.
        plan: number of the command, and the trial whose channels and noise it has.
    """
    models: list[TrialModel] = []
    whiteners = []
    for number, like in plan:
        variant = bench.world.variants[number]
        blank = _blank(design, variant, like.channels, f"plan{len(models)}")
        models.append(TrialModel(blank, number, design.robot))
        reference = peak_velocity(like.variant)
        whiteners.append([
            whitener_of(like.noise[c], c, blank.t, variant, reference) for c in like.channels
        ])  # fmt: skip
    problem = Problem(models, bench)
    problem.whiteners = whiteners
    return problem


def _blank(design: Design, variant: Variant, channels: Sequence[str], name: str) -> Observation:
    """Return a trial that reads nothing at the stamps of ideal sensors."""
    robot = design.robot
    before = round(BEFORE / design.width)
    after = int(np.ceil((duration(variant) + AFTER) / design.width))
    edges: Array = design.width * np.arange(-before, after + 1, dtype=np.float64)
    rates = {
        "imu": robot.imu_grade.rate if robot.imu_grade else 200.0,
        "wheel": robot.encoders.rate,
        "current": robot.currents.rate,
    }
    weights = dict(zip(CHANNELS[:3], np.eye(7)[:3], strict=True)) | {
        "wheel": np.array([0, 0, 0, 0.5, 0.5, 0, 0]) if "wheel_split" in channels else np.eye(7)[3],
        "wheel_split": np.eye(7)[3] - np.eye(7)[4],
        "current_f": np.eye(7)[5],
        "current_r": np.eye(7)[6],
    }
    streams = {}
    for c in channels:
        rate = max(rates.get(c.split("_")[0], rates["imu"]), 1 / design.width)
        t = np.arange(edges[0] - 2 / rate, edges[-1] + 3 / rate, 1 / rate)
        streams[c] = Stream(t, np.zeros(t.size), weights[c], c.startswith("wheel"))
    values = {c: np.zeros(edges.size - 1) for c in channels}
    return Observation(name, variant, 0.0, edges, streams, values, 0.0, False)
