"""What the effects say of themselves, and that each is nothing at its neutral values."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from granite_lab.effects import get, library
from granite_lab.effects.library import neutral_gap
from granite_lab.errors import UsageError
from granite_lab.model import Accuracy, simulate
from granite_lab.model.effect import activate
from granite_lab.model.graph import build_graph
from granite_lab.model.simulator import rest_state
from granite_lab.model.symbols import model_parameters, vector_of
from granite_lab.parameters import load_robot, load_soil, variant_of


@pytest.mark.parametrize("effect_id", library())
def test_neutral_values_leave_every_rate_and_signal_of_the_paper_as_it_is(effect_id: str) -> None:
    assert neutral_gap(get(effect_id)) == 0.0


def test_an_unknown_effect_is_answered_with_the_nearest_name() -> None:
    with pytest.raises(UsageError, match="unknown effect 'tire_windup'") as caught:
        get("tire_windup")
    assert "did you mean 'tyre_windup'?" in caught.value.hint


@pytest.mark.parametrize("effect_id", library())
def test_a_neutral_run_is_the_paper_s(effect_id: str) -> None:
    """Extra states change the steps of the integrator, so the runs agree to its tolerance only."""
    fine = Accuracy(1e-8, 1e-10)
    variant = variant_of(0.7)
    plain = simulate(variant, load_robot(), load_soil(), accuracy=fine)
    run = simulate(variant, load_robot(), load_soil(), accuracy=fine, effects=(activate(get(effect_id), {}),))
    for name in ("v_mps", "x_m", "pitch_rad", "enc_f_rad", "enc_r_rad"):
        np.testing.assert_allclose(run[name], plain[name], rtol=0, atol=2e-7, err_msg=name)


@pytest.mark.parametrize("effect_id", library())
def test_the_model_is_differentiable_at_neutral(effect_id: str) -> None:
    """At rest and in motion, and the derivative by some parameter is not zero: the effect can be seen."""
    effect = get(effect_id)
    graph, active = build_graph((effect,)), activate(effect, {})
    p = model_parameters(load_robot(), load_soil(), variant_of(0.5), a_theta=4.919)
    what = ca.vertcat(graph.rates, *graph.outputs.values(), *graph.delays.values())
    derivative = ca.Function(
        "d", [graph.t, graph.x, graph.p], [ca.jacobian(what, graph.x), ca.jacobian(what, graph.p)]
    )
    rest = rest_state(p, (active,))
    moving = rest.copy()
    moving[:12] += [0.8, 0, 0, 0.4, 0, 0.01, 9, 5.0, 4.0, 9, 5.0, 4.0]  # a little behind the command
    seen = 0.0
    for t, x in ((-0.5, rest), (2.0, moving)):
        by_state, by_parameter = (
            part.full() for part in derivative(t, x, vector_of(p) + list(active.values))
        )
        assert np.isfinite(by_state).all()
        assert np.isfinite(by_parameter).all()
        seen = max(seen, float(np.abs(by_parameter[:, -len(effect.parameters) :]).max()))
    # a lag, a twist and a play act through their states, which are at their equilibrium here
    assert seen > 0 or effect.states
