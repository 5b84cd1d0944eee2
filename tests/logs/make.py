"""Small virtual logs as text, with nothing but arithmetic behind them."""

from __future__ import annotations

import numpy as np

HEADER = (
    "t_s,imu_ax_mps2,imu_ay_mps2,imu_az_mps2,imu_gx_radps,imu_gy_radps,imu_gz_radps,"
    "enc_fl_rad,enc_fr_rad,enc_rl_rad,enc_rr_rad"
)
RADIUS = 0.0965


def profile(
    t: np.ndarray, v: float = 0.3, a: float = 1.2, start: float = 1.0, stop: float = 5.0
) -> np.ndarray:
    """Velocity of a trapezoid [m/s]."""
    return np.clip(np.minimum(a * (t - start), a * (stop - t)), 0.0, v)


def rows(
    duration: float = 6.0, rate: float = 100.0, seed: int = 1, slip: float = 0.1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps (N,), IMU (N, 6) and wheel angles (N, 4) of a drive over a gently rolling floor."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(duration * rate)) / rate
    v = profile(t)
    pitch = 0.02 * np.sin(2 * np.pi * 0.4 * np.clip(t - 1, 0, 4)) * (v > 0)
    force = np.column_stack(
        [np.gradient(v, t) + 9.81 * np.sin(pitch), np.zeros_like(t), 9.81 * np.cos(pitch)]
    ) + rng.normal(0, 0.02, (len(t), 3))
    turn = np.column_stack([np.zeros_like(t), np.gradient(-pitch, t), np.zeros_like(t)])
    turn = turn + rng.normal(0, 5e-4, (len(t), 3))
    angle = np.cumsum(v) / rate / (1 - slip) / RADIUS
    return t, np.hstack([force, turn]), np.repeat(angle[:, None], 4, axis=1)


def lines(**options: float) -> list[str]:
    """Return the lines of a canonical log, the header first."""
    t, imu, wheels = rows(**options)  # type: ignore[arg-type]
    table = np.column_stack([t, imu, wheels])
    return [HEADER, *(",".join(f"{value:.9g}" for value in row) for row in table)]


def text(**options: float) -> str:
    """Return a canonical log."""
    return "\n".join(lines(**options)) + "\n"
