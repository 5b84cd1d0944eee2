"""Each variant of another program's trials changes the logger and leaves the motion as it was."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.outside_variants import IMU, VARIANTS, WHEELS, of_imu, write
from granite_lab.logs import read_trial

SOURCE = Path(__file__).parents[1] / "data" / "outside"


@pytest.fixture(scope="module")
def source() -> Path:
    return min(SOURCE.glob("*/trial_0.5_*.csv"))


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_is_a_log_of_the_same_motion(name: str, source: Path, tmp_path: Path) -> None:
    change, _ = VARIANTS[name]
    write(source, tmp_path / source.name, change, np.random.default_rng(1))
    before, after = read_trial(source), read_trial(tmp_path / source.name)
    t = after.wheels.t
    for k, wheel in enumerate(WHEELS):
        sign = -1.0 if (name, wheel) == ("reversed_wheel", "rr") else 1.0
        then = np.interp(t, before.wheels.t, before.wheels.angle[:, k])
        np.testing.assert_allclose(sign * after.wheels.angle[:, k], then, atol=4e-3)


def changed_rows(change: Callable[..., pd.DataFrame], log: pd.DataFrame) -> np.ndarray:
    out = change(log, np.random.default_rng(1))
    return np.asarray((out[log.columns] != log).to_numpy() & log.notna().to_numpy())


def test_only_what_a_variant_names_is_changed(source: Path) -> None:
    log = pd.read_csv(source, comment="#")
    imu = of_imu(log)
    assert changed_rows(VARIANTS["noisy"][0], log)[imu][:, 1:7].all()
    assert not changed_rows(VARIANTS["noisy"][0], log)[~imu].any()
    assert changed_rows(VARIANTS["spikes"][0], log).sum() == 5
    assert len(VARIANTS["slow"][0](log, np.random.default_rng(1))[IMU].dropna()) == imu.sum() // 2


def test_readings_thrown_off_change_no_unit_and_no_other_reading(source: Path, tmp_path: Path) -> None:
    for seed in range(5):
        write(source, tmp_path / source.name, VARIANTS["spikes"][0], np.random.default_rng(seed))
        before, after = read_trial(source), read_trial(tmp_path / source.name)
        for name in ("specific_force", "angular_rate"):
            apart = np.abs(getattr(after.imu, name) - getattr(before.imu, name)).max(axis=1)
            assert np.count_nonzero(apart > 1e-6) <= 3
        assert not any("converted" in warning for warning in after.warnings)
