"""Runs by machine code beside runs by CVODES at 1e-9, and derivatives by runs of the same steps."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from granite_lab.effects import get
from granite_lab.errors import EstimateError
from granite_lab.model import Accuracy, interpreted, simulator
from granite_lab.model.effect import activate
from granite_lab.model.native import graphs
from granite_lab.model.simulator import integrate, integrate_many, parameter_vector, rest_state
from granite_lab.model.symbols import model_parameters, names_of
from granite_lab.parameters import Variant, load_paper, load_robot, load_soil, load_variants, variant_of

LEAN = Accuracy(relative=5e-5, absolute=1e-7, travel=0.0018, lean=True, order=3)
WITHIN = {
    "v_mps": 2e-5, "imu_ax_mps2": 4e-3, "imu_az_mps2": 4e-3, "imu_gy_radps": 5e-5, "enc_f_rad": 3e-5,
    "cur_f_A": 4e-3,
}  # fmt: skip
SETS = (
    (), ("tyre_windup",), ("gear_backlash",), ("radial_tyre_compliance", "rate_dependent_soil"),
    ("slip_sinkage", "drivetrain_friction", "supply_sag"),
)  # fmt: skip


@pytest.mark.parametrize("ids", SETS, ids="+".join)
@pytest.mark.parametrize("variant", load_variants()[::3], ids=lambda v: f"{v.velocity:g}")
def test_signals_are_those_of_cvodes_at_a_much_smaller_tolerance(
    variant: Variant, ids: tuple[str, ...]
) -> None:
    p = model_parameters(load_robot(), load_soil(), variant, a_theta=load_paper().a_theta)
    active = [
        activate(get(i), {q.name: (q.prior_low + 3 * q.prior_high) / 4 for q in get(i).parameters})
        for i in ids
    ]
    effects, vector = tuple(e.effect for e in active), parameter_vector(p, active)
    fine = dataclasses.replace(LEAN, relative=1e-9, absolute=1e-11, order=5)
    start = rest_state(p, active)
    got = integrate(p, active, LEAN, tuple(WITHIN))
    states = interpreted.run(effects, variant, fine, start, vector)
    truth = interpreted.outputs(effects, tuple(WITHIN), got["t_s"], states, vector)
    for (name, limit), row in zip(WITHIN.items(), truth, strict=True):
        assert np.abs(got[name] - row).max() < limit, name


def test_a_run_without_solution_ends_with_a_reason_in_either_engine() -> None:
    p = model_parameters(load_robot(), load_soil(), variant_of(0.5), a_theta=4.919)
    start, vector = rest_state(p), parameter_vector(p, ())
    start[4] = np.nan
    for engine in (graphs, interpreted):
        with pytest.raises(EstimateError, match=r"does not converge: .*not a number"):
            engine.run((), p.variant, LEAN, start, vector)


def test_differences_of_runs_by_the_same_steps_are_derivatives() -> None:
    """Beside central differences of CVODES at 1e-10; the step is 1e-4 of each number."""
    p = model_parameters(load_robot(), load_soil(), variant_of(0.7), a_theta=4.919)
    active = [activate(get("slip_sinkage"), {}), activate(get("imu_tilt"), {"tilt": 0.3})]
    first, names = parameter_vector(p, active), names_of(p)
    places = [names.index("a_theta"), names.index("soil.exponent"), len(names), first.size - 1]
    steps = [1e-4 * max(abs(first[k]), 0.1) for k in places]
    other = np.repeat(first[None], len(places), 0)
    other[range(len(places)), places] += steps
    signals = ("imu_ax_mps2", "cur_f_A", "enc_r_rad")
    got = integrate_many(p, active, other, LEAN, signals)
    fine = dataclasses.replace(LEAN, relative=1e-10, absolute=1e-12, order=5)
    effects = tuple(e.effect for e in active)
    motion = effects[:1]

    def exact(k: int, step: float) -> np.ndarray:
        rows = []
        for sign in (1, -1):
            moved = first.copy()
            moved[k] += sign * step
            own = moved[: len(names) + len(motion[0].parameters)]
            states = interpreted.run(motion, p.variant, fine, simulator._rest(p, motion, own), own)
            rows.append(interpreted.outputs(effects, signals, got["t_s"], states, moved))
        return (rows[0] - rows[1]) / (2 * step)

    for row, (k, step) in enumerate(zip(places, steps, strict=True), start=1):
        truth = exact(k, step)
        for name, right in zip(signals, truth, strict=True):
            difference = (got[name][row] - got[name][0]) / step
            assert np.sqrt(np.mean((difference - right) ** 2)) <= 2e-3 * np.sqrt(np.mean(right**2)), (k, name)


def test_many_runs_are_the_runs_alone_and_those_without_solution_are_not_numbers() -> None:
    p = model_parameters(load_robot(), load_soil(), variant_of(0.3), a_theta=4.919)
    first = parameter_vector(p, ())
    other = np.repeat(first[None], 2, 0)
    names = names_of(p)
    other[0, names.index("soil.frictional_modulus")] *= 1.05
    other[1, names.index("soil.frictional_modulus")] = 1.0
    found = integrate_many(p, (), other, LEAN, ("v_mps", "cur_f_A"))
    alone = integrate(p, (), LEAN, ("v_mps", "cur_f_A"))
    np.testing.assert_array_equal(found["v_mps"][0], alone["v_mps"])
    soil = dataclasses.replace(p.soil, frictional_modulus=1.05 * p.soil.frictional_modulus)
    firmer = integrate(dataclasses.replace(p, soil=soil), (), LEAN, ("cur_f_A",))
    np.testing.assert_allclose(found["cur_f_A"][1], firmer["cur_f_A"], atol=2e-3)
    assert np.isnan(found["v_mps"][2]).all()
