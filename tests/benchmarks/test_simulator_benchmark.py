"""The benchmark of the simulator compares machine code with another integrator."""

import numpy as np

from benchmarks.simulator import by_cvodes
from granite_lab.model.instants import USUAL
from granite_lab.model.simulator import integrate
from granite_lab.model.symbols import model_parameters
from granite_lab.parameters import load_robot, load_soil, variant_of


def test_without_machine_code_another_integrator_runs_and_differs_little() -> None:
    p = model_parameters(load_robot(), load_soil(), variant_of(0.7), a_theta=4.3)
    compiled = integrate(p, (), USUAL)["v_mps"]
    p = model_parameters(load_robot(), load_soil(), variant_of(0.7), a_theta=4.3 + 1e-9)  # runs are kept
    other = by_cvodes(lambda: integrate(p, (), USUAL))["v_mps"]
    assert 1e-7 < np.abs(compiled - other).max() < 1e-4
