"""Runs by machine code beside runs by CVODES at 1e-9."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from granite_lab.effects import get
from granite_lab.errors import EstimateError
from granite_lab.model import Accuracy, interpreted
from granite_lab.model.effect import activate
from granite_lab.model.native import graphs
from granite_lab.model.simulator import integrate, parameter_vector, rest_state
from granite_lab.model.symbols import model_parameters
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
