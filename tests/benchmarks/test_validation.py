"""Measured wheels are read as published, known laws are recovered, and the page says what is computed."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.validation import GROWTH, LAWS, TEXT, expected
from benchmarks.validation_data import DATA, Row, Series, all_series
from benchmarks.validation_fit import (
    Setup,
    bekker_wong,
    constant,
    fit,
    law_forms,
    linear,
    model,
    needed,
    numbers,
    residuals,
    total,
)
from tests.soak import sampled

SERIES = {s.id: s for s in all_series()}
PAGE = Path(__file__).parents[2] / "docs" / "validation.md"


def made_up(setup: Setup, slips: tuple[float, ...] = (0.05, 0.2, 0.4, 0.6)) -> Series:
    """Return Ding's smooth wheel with points of the model in place of the measured ones."""
    base = SERIES["ding_smooth"]
    rows = []
    for slip in slips:
        empty = Row(slip, 80.0, 0.0, math.nan, 0.0, 0.0)
        pull, torque, sinkage = numbers(model(base, empty, setup)).tolist()
        rows.append(dataclasses.replace(empty, pull=pull, torque=torque, sinkage=sinkage))
    return dataclasses.replace(base, rows=tuple(rows))


def test_every_published_row_is_read() -> None:
    assert {name: len(s.rows) for name, s in SERIES.items()} == {
        "k10_smooth": 27, "k10_grouser": 27, "ding_smooth": 6, "ding_lugs": 6, "kls1_smooth": 5,
        "kls1_lugs": 5, "rashid_lugs": 5,
    }  # fmt: skip
    for name in ("LICENSE-robomechanics", "LICENSE-roverdevkit"):
        assert "Permission is hereby granted" in (DATA / name).read_text(encoding="utf-8")
    ding = SERIES["ding_smooth"]
    assert ding.soil.frictional_modulus == pytest.approx((15.6 / 0.165 + 2407.4) * 1000)
    assert ding.rows[2] == Row(0.2, 80.0, 14.5, pytest.approx(math.nan, nan_ok=True), 4.2, 7.5)
    assert len(SERIES["k10_smooth"].groups) == 9
    assert all(r.slip > -0.1 for r in SERIES["k10_grouser"].driven)


def error_of_pull(of: Callable[[Series, Row], float]) -> float:
    """Return the median relative error of a model's drawbar pull over Ding's points."""
    points = [(s, row) for s in (SERIES["ding_smooth"], SERIES["ding_lugs"]) for row in s.rows]
    return float(np.median([abs(of(s, row) - row.pull) / abs(row.pull) for s, row in points]))


def test_the_rival_has_the_27_percent_that_it_is_known_for() -> None:
    assert error_of_pull(lambda s, row: bekker_wong(s, row)[0]) == pytest.approx(0.27, abs=0.005)


@pytest.mark.parametrize("k92", sampled([0.15, 0.6]))
def test_the_k_92_of_a_point_is_found_by_each_quantity_and_by_all(k92: float) -> None:
    series = made_up(Setup(constant(k92)))
    found = needed(series, series.rows[1])
    assert found.best == pytest.approx([k92] * 3, abs=0.01)
    assert found.reached == (True, True, True)
    assert found.joint == pytest.approx(k92, abs=0.01)
    assert found.common[0] <= k92 <= found.common[1]


def test_no_k_92_is_found_where_the_wheel_is_deeper_than_the_model_can_be() -> None:
    series = made_up(Setup(constant(0.3)))
    deep = dataclasses.replace(series.rows[1], sinkage=3 * series.rows[1].sinkage)
    found = needed(series, deep)
    assert found.common is None
    assert found.reached == (True, True, False)


def test_a_law_in_slip_with_an_effect_is_recovered() -> None:
    truth = Setup(linear(0.8, -0.9), {"slip_sinkage": {"growth": 0.4}})
    series = made_up(truth, (0.1, 0.3, 0.6))
    found = fit(series, law_forms((GROWTH,))[1], leave_out=False)
    assert list(found.values.values()) == pytest.approx([0.8, -0.9, 0.4], abs=1e-3)
    assert total(found.off) < 1e-3
    assert expected(found, GROWTH)
    plain = fit(series, law_forms()[0])
    assert total(plain.off) > 1
    assert plain.left_out >= total(plain.off)


@pytest.mark.parametrize("law", sampled(LAWS[:3]), ids=lambda law: law[0])
def test_a_contact_law_is_recovered_beside_a_constant_k_92(law: tuple[str, str]) -> None:
    series = made_up(Setup(constant(0.4), {law[0]: {law[1]: 0.3}}))
    found = fit(series, law_forms((law,))[0], leave_out=False)
    assert found.values[".".join(law)] == pytest.approx(0.3, abs=0.01)
    assert total(fit(series, law_forms()[0], leave_out=False).off) > 3 * total(found.off)


def test_a_wheel_that_sinks_to_its_axle_is_no_agreement() -> None:
    s = SERIES["ding_smooth"]
    heavy = dataclasses.replace(s.rows[0], load=1e5)
    assert (np.abs(residuals(s, [heavy], Setup(constant(0.0)))) == 10).all()


def test_the_page_and_its_table_say_what_the_code_computes() -> None:
    text = PAGE.read_text(encoding="utf-8")
    points = pd.read_csv(PAGE.parent / "tables" / "validation-points.csv")
    rows = [row for s in SERIES.values() for row in s.rows]
    assert points["pull_N"].to_numpy() == pytest.approx([row.pull for row in rows], rel=1e-3)
    error = error_of_pull(lambda s, row: numbers(model(s, row, Setup(constant(0.0))))[0])
    assert f"drawbar pull is {100 * error:.0f} % with k_92 = 0" in text
    assert TEXT.read_text(encoding="utf-8").split("{{")[0] in text
