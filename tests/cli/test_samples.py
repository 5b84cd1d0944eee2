"""The sample trials against the truth that their generator kept aside."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from granite_lab import fitting
from granite_lab.chain import analyse
from granite_lab.comparison.compare import Comparison
from granite_lab.effects import get
from granite_lab.effects.model_file import FittedEffect, ModelFile, save_model
from granite_lab.estimate import Estimate
from granite_lab.fitting import K92Fit, fit_a_theta
from granite_lab.hidden.sealed import open_answer
from granite_lab.logs import read_trial
from granite_lab.options import Options
from granite_lab.parameters import load_robot, load_soil
from granite_lab.parameters.quantity import parse_toml
from granite_lab.running import Cache, Execution, each_trial
from tests.corpus.cli import SAMPLES
from tests.soak import SOAK, sampled

LOGS = sorted(SAMPLES.glob("*.csv"))
ANALYSED = sampled(LOGS, 3)
"""One at each speed, all in `make soak`."""


def truth_of(log: Path) -> tuple[pd.DataFrame, dict[str, float]]:
    path = SAMPLES / "truth" / log.name
    lines = path.read_text(encoding="utf-8").splitlines()
    header = "\n".join(line[2:] for line in lines if line.startswith("# "))
    return pd.read_csv(path, comment="#"), parse_toml(header, path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[Comparison]:
    """Samples by the model with the effects that they hide, of the size that the sealed answer tells.

    What another process of pytest has done is remembered.
    """
    effects = tuple(
        FittedEffect(get(e["id"]), {k: Estimate(p["value"]) for k, p in e["parameters"].items()}, ())
        for e in open_answer(SAMPLES)["effects"]
    )
    path = tmp_path_factory.mktemp("model") / "model.toml"
    save_model(ModelFile("granite", "dry_sand", "exponential", Estimate(4.919), effects, {}), path)
    found = each_trial(analyse, ANALYSED, Options(model=path), execution=Execution(1, cache=Cache()))
    return [result for result in found if isinstance(result, Comparison)]


def by_the_paper(result: Comparison, *, trajectory: bool) -> K92Fit:
    """Fit a trial, whose motion no model changes, by the model that lacks the effects, as commands do."""
    motion, robot, soil = result.motion, load_robot(), load_soil()
    return fitting.fit_k92(motion, result.trial, robot, soil, trajectory=trajectory)


def test_the_samples_are_table_2_three_times_and_say_that_they_are_virtual(
    whole: list[Comparison],
) -> None:
    samples = [read_trial(log).info for log in LOGS]
    assert [s.v_desired for s in samples] == [v for v in (0.2, 0.3, 0.5, 0.7) for _ in "123"]
    assert all(s.virtual for s in samples)
    assert sampled([s.v_desired for s in samples], 3) == [r.fit.variant.velocity for r in whole]
    assert all(r.motion.virtual for r in whole)


def test_velocity_distance_and_slip_are_true_within_their_uncertainty(whole: list[Comparison]) -> None:
    squares = []
    for log, result in zip(ANALYSED, whole, strict=True):
        truth, true = truth_of(log)
        motion = result.motion
        error = motion.v - np.interp(motion.t, truth["t_s"], truth["v_mps"])
        assert np.sqrt(np.mean(error**2)) < 0.006  # [m/s]
        assert abs(motion.x[-1] - truth["x_m"].iloc[-1]) < 3 * motion.distance.std
        assert motion.slip_ratio.value == pytest.approx(true["slip_ratio"], abs=0.01)
        moving = np.array(motion.phase) != "rest"
        squares.append(np.mean((error / motion.v_std)[moving] ** 2))
    # each trial is little more than one independent number
    assert 0.4 < np.mean(squares) < 1.9


def test_k92_lies_in_its_interval_as_often_as_that_says(whole: list[Comparison]) -> None:
    z = []
    for log, result in zip(ANALYSED, whole, strict=True):
        _, true = truth_of(log)
        fit = result.fit
        assert fit.status == "ok"
        k92 = np.exp(-true["k92_value"] * fit.variant.velocity)
        z += [(estimate.value - k92) / estimate.std for estimate in (fit.k92, fit.k92_trajectory)]
    # each is outside with a probability of 5 %; of 24 numbers more than four are with one of 0.6 %, and so
    # are more than two of 8
    assert np.sum(np.abs(z) > 1.96) <= (4 if SOAK else 2), z
    assert np.sqrt(np.mean(np.square(z))) < 1.45  # a chance of 0.3 % to exceed it
    assert np.abs(np.mean(z)) < 0.8


def test_a_model_that_lacks_the_effects_misses_k92_by_more(whole: list[Comparison]) -> None:
    place = next(k for k, log in enumerate(ANALYSED) if log.stem == "virtual_v0.3_r1")
    with_them, without = whole[place].fit, by_the_paper(whole[place], trajectory=True)
    _, true = truth_of(ANALYSED[place])
    k92 = np.exp(-true["k92_value"] * without.variant.velocity)
    assert abs(with_them.k92_trajectory.value - k92) < 0.5 * abs(without.k92_trajectory.value - k92)


def test_a_theta_lies_in_its_interval(whole: list[Comparison]) -> None:
    drawn = [truth_of(log)[1]["k92_value"] for log in ANALYSED]
    fit = fit_a_theta([by_the_paper(result, trajectory=False) for result in whole])  # it goes by the slip
    assert fit.ci95[0] <= np.mean(drawn) <= fit.ci95[1]
    assert fit.agrees  # the scatter was drawn about the published value
