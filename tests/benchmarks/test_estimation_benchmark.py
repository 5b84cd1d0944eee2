"""The benchmark of the estimation says what it measured, with intervals."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

from benchmarks.estimation import cell_row, drawn, remembered, report, summaries
from benchmarks.estimation_cell import Cell, Score, successive_correlation, summarise
from benchmarks.intervals import alike, around, excludes, wilson
from granite_lab.estimation.motion import Health
from tests.fitting.made_up import HEALTHY


def made_up(error: float, std: float) -> Score:
    return Score(
        v_square=error**2, v_nees=(error / std) ** 2, v_within=float(abs(error) < 2 * std), distance=error,
        distance_std=std, slip=error, slip_std=std, offset=error, offset_std=std, white=(0.1, 0.0, -0.1),
    )  # fmt: skip


def health_of(innovation: np.ndarray) -> Health:
    n = innovation.size
    return replace(
        HEALTHY, t=np.arange(n, dtype=float), kind=("wheel",) * n, innovation=innovation,
        innovation_std=np.ones(n),
    )  # fmt: skip


def test_errors_as_large_as_stated_give_unit_nees_and_normal_coverage() -> None:
    rng = np.random.default_rng(0)
    s = summarise([made_up(0.002 * z, 0.002) for z in rng.standard_normal(4000)])
    assert s.nees == pytest.approx(1.0, abs=0.06)
    assert s.slip_cover == pytest.approx(0.954, abs=0.01)
    assert s.v_rmse == pytest.approx(0.002, rel=0.03)
    assert s.slip_mean == pytest.approx(0.0, abs=1e-4)
    assert s.white == pytest.approx((0.1, 0.0, -0.1))


def test_refused_trials_are_counted_and_do_not_enter_nor_does_an_unobservable_offset() -> None:
    seen, unseen = made_up(0.002, 0.001), Score(v_square=0, distance=0, slip=0, offset=0.7)
    both = summarise([seen, unseen])
    assert (both.observable, both.offset_rmse) == (0.5, pytest.approx(0.002))
    s = summarise([made_up(0.001, 0.001), Score(refused="no standstill")])
    assert (s.trials, s.refused) == (2, 1)
    assert s.v_rmse == pytest.approx(0.001)
    nothing = summarise([Score(refused="no standstill")])
    assert math.isnan(nothing.nees)
    assert cell_row(Cell("industrial", 8.0, 0.3), nothing)["refused"] == 1


def test_figures_outside_the_aim_are_named() -> None:
    cell, shifted = Cell("industrial", 8.0, 0.3), Cell("industrial", 8.0, 0.5, 0.02)
    good = summarise([made_up(z, 0.001) for z in (0.001, -0.001)])
    bad = summarise([made_up(0.009, 0.001)])
    assert cell_row(cell, bad)["rmse_v_mmps"] == pytest.approx(9.0)
    missed = str(cell_row(cell, bad)["missed"]).split("; ")
    assert {"v", "distance", "NEES"} <= set(missed)
    assert "v" not in str(cell_row(cell, good)["missed"]).split("; ")
    assert cell_row(shifted, bad)["missed"] == "offset"
    text = report({cell: bad}, {shifted: good}, "a command")
    assert "NEES" in text.split("**Aims missed**: ")[1].split("(industrial, 8 s, 0.3 m/s)")[0]
    assert "| industrial, 8 s | 9.0 | 0.9 |" in text


def test_correlation_of_innovations() -> None:
    rng = np.random.default_rng(2)
    white = rng.standard_normal(2000)
    assert abs(successive_correlation(health_of(white), "wheel")) < 0.06
    coloured = np.convolve(white, [1.0, 1.0], mode="valid")
    assert successive_correlation(health_of(coloured), "wheel") == pytest.approx(0.5, abs=0.05)
    assert math.isnan(successive_correlation(health_of(white[:5]), "wheel"))


def test_a_run_that_ends_early_has_its_share_of_each_cell() -> None:
    many, few = Cell("industrial", 8.0, 0.3), Cell("industrial", 8.0, 0.5, 0.02)
    jobs = drawn({many: 100, few: 25})
    assert len(jobs) == 125
    assert set(jobs) == {(many, i) for i in range(100)} | {(few, i) for i in range(25)}
    for end in (20, 60, 110):
        assert sum(cell == many for cell, _ in jobs[:end]) == pytest.approx(0.8 * end, abs=1)


def test_scores_that_are_kept_are_not_measured_again(tmp_path: Path) -> None:
    cell, kept = Cell("industrial", 2.5, 0.5), tmp_path / "scores.jsonl"
    first = summaries({cell: 1}, 1, kept=kept)
    ((job, found),) = remembered(kept).items()
    assert job == (cell, 0)
    assert found.v_square == pytest.approx(first[cell].v_rmse ** 2)
    written = kept.read_text()
    # no time for another trial: what is known is all there is
    again = summaries({cell: 1}, 1, minutes=0.0, kept=kept)
    assert again == first
    assert kept.read_text() == written


@pytest.mark.parametrize(("hits", "trials"), [(0, 10), (10, 10), (19, 20), (95, 100), (50, 100)])
def test_wilson_interval_is_scipys(hits: int, trials: int) -> None:
    expected = binomtest(hits, trials).proportion_ci(method="wilson")
    assert wilson(hits / trials, trials) == pytest.approx((expected.low, expected.high), abs=1e-4)


def test_only_an_interval_beside_the_aim_excludes_it_and_one_stays_within_what_is_possible() -> None:
    assert around(0.99, 0.02, 0.0, 1.0) == pytest.approx((0.9508, 1.0))
    assert excludes((0.80, 0.91), (0.92, 0.98))
    assert excludes((0.985, 1.0), (0.92, 0.98))
    assert not excludes((0.88, 0.93), (0.92, 0.98))
    assert not excludes((0.90, 1.0), (0.92, 0.98))


def test_shares_of_one_source_are_called_different_as_often_as_chance_says() -> None:
    rng = np.random.default_rng(1)
    trials = [100] * 16
    p = [alike((rng.binomial(100, 0.93, 16) / 100).tolist(), trials) for _ in range(400)]
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.09
    assert alike([0.93] * 15 + [0.7], trials) < 1e-6
