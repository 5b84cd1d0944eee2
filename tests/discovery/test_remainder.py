"""What the library leaves, on the real simulator: terms of the dictionary, and the ceiling of any force."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from granite_lab.discovery.ceiling import ceiling
from granite_lab.discovery.describing import forces
from granite_lab.discovery.description import described, terms_beside
from granite_lab.discovery.heldout import predict
from granite_lab.discovery.impulses import ImpulseResponses, impulse_responses
from granite_lab.discovery.models import Model, Search
from granite_lab.discovery.search import search_beside
from granite_lab.effects import get, library
from granite_lab.effects.library import neutral_gap
from granite_lab.effects.model_file import FittedEffect, ModelFile, load_model, save_model
from granite_lab.estimate import Estimate
from granite_lab.inference.fit import Fit, fit
from granite_lab.inference.pool import Scenario, Task
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model import Accuracy, simulate
from granite_lab.model.command import smoothstep
from granite_lab.model.contact import WheelState, stiffer
from granite_lab.model.dictionary import PLACES, QUANTITIES, Term, dictionary, is_term, place_of, term
from granite_lab.model.effect import Effect, EffectParameter, Symbols, activate
from granite_lab.model.latent import LatentForce
from granite_lab.parameters import GRAVITY, Soil, load_robot, load_soil, variant_of
from tests.inference.stub import COMMANDS, drawn, measure, problem_of
from tests.soak import sampled

pytestmark = pytest.mark.usefixtures("one_blas_thread")
FINE = Accuracy(1e-8, 1e-10)
TOLERANCE = 0.02


class SoftPatch(Effect):
    """Loose ground about one place, with soft edges: another shape than that of any term."""

    id = "soft_patch"
    title = "a soft patch of ground"
    equation = "k · exp(−a) for |x_w − 0.35 m| < 0.08 m"
    source = "made for this test"
    signature = "at one place"
    parameters = (EffectParameter("a", "", "loss of stiffness", 0.0, 2.0, 0.0, 0.0, 0.5),)

    def soil(self, soil: Soil, state: WheelState, sym: Symbols) -> Soil:
        away = ca.fabs(place_of(state.travel, state.front, sym.model) - 0.35)
        return stiffer(soil, ca.exp(-sym.p["a"] * smoothstep((0.12 - away) / 0.08)))


SIMULATED = library() | dictionary() | {e.id: e for e in (LatentForce(), SoftPatch())}


def simulator(scenario: Scenario, tasks: Sequence[Task]) -> list[Array | None]:
    return [scenario.respond(task) for task in tasks]


@cache
def measured(commands: tuple[int, ...] = (0, 0, 1, 2), **hidden: float) -> tuple[Problem, Fit]:
    """Return virtual trials of three speeds with effects, one strength each, and the fit without them."""
    rng, problem = (
        np.random.default_rng(1), problem_of(commands, respond=simulator, effects=SIMULATED)
    )  # fmt: skip
    point = drawn(problem, rng, common=0.2, own=0.3)
    for id_, size in hidden.items():
        values = [p.neutral for p in problem.parameters_of(id_)]
        point = problem.with_effect(point, id_, [size, *values[1:]])
    measure(problem, point, rng, 0.002)
    return problem, fit(problem, problem.neutral())


@cache
def pushes_of(**hidden: Any) -> ImpulseResponses:
    """What pushes at all places show about the fit of `measured`."""
    found = impulse_responses(*measured(**hidden))
    assert found is not None
    return found


PATCH: dict[str, Any] = {
    "commands": (0, 0, 1, 1, 2, 2), "soft_patch": 0.5, "drivetrain_friction": 0.3
}  # fmt: skip
"""The larger cause has another formula than the terms; the effect beside it is one of the library."""


def test_a_term_reproduces_an_effect_whose_law_is_of_its_form() -> None:
    """The reaction of the drives is a moment in proportion to the torques; a term fades out at standstill."""
    robot, soil, variant = load_robot(), load_soil(), variant_of(0.7)
    pairs = ((get("drive_reaction"), {"share": 0.8}), (term("term_moment_by_torque"), {"a": -0.8}))
    one, other = (
        simulate(variant, robot, soil, accuracy=FINE, effects=(activate(e, values),)) for e, values in pairs
    )
    plain = simulate(variant, robot, soil, accuracy=FINE)
    moving = (plain["t_s"] > 1.5) & (plain["v_mps"] > 0.2)
    for name in ("pitch_rad", "v_mps", "cur_f_A", "imu_az_mps2"):
        apart = np.abs(one[name] - other[name])[moving].max()
        assert apart < 0.001 * np.abs(one[name] - plain[name])[moving].max(), name


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_terms_vanish_at_their_neutral_value(quantity: str) -> None:
    (one,) = (t for t in dictionary().values() if isinstance(t, Term) and t.quantity == quantity
              and t.groups == ("speed", "distance"))  # fmt: skip
    assert neutral_gap(one) < 1e-12


def test_terms_come_back_from_a_model_file_and_simulate_the_same(tmp_path: Path) -> None:
    values = {"term_strength_by_slip": 0.7, "term_torque_r_by_sin_angle": 0.02}
    fitted = tuple(FittedEffect(term(id_), {"a": Estimate(a, 0.1)}) for id_, a in values.items())
    save_model(ModelFile("granite", "dry_sand", "constant", Estimate(0.2), fitted), tmp_path / "model.toml")
    model = load_model(tmp_path / "model.toml")
    assert [(e.id, e.values) for e in model.effects] == [(id_, (a,)) for id_, a in values.items()]
    runs = [
        simulate(variant_of(0.5), load_robot(), load_soil(), k92=0.2, effects=effects)
        for effects in (model.effects, [f.active for f in fitted])
    ]
    assert runs[0]["v_mps"] == pytest.approx(runs[1]["v_mps"], abs=1e-6)


@pytest.mark.parametrize(
    "id_",
    sampled([
        "term_modulus_by_speed", "term_strength_by_speed", "term_ratio_by_speed", "term_force_by_distance",
        "term_lift_by_speed", "term_moment_by_torque", "term_torque_f_by_speed", "term_drive_by_speed",
        "term_force_at_3",
    ]),
)  # fmt: skip
def test_responses_to_pushes_foretell_what_a_term_shows(id_: str) -> None:
    """A simulation with a little of the term shows the same."""
    (problem, base), impulses = measured(), pushes_of()
    terms = [t for t in dictionary().values() if isinstance(t, Term)]
    k = [t.id for t in terms].index(id_)
    foretold = impulses.changes[1] @ forces(problem, impulses, 1, terms)[k]
    centre, size = problem.centre(base.point, 1), 0.02 * terms[k].parameters[0].prior_high
    setting = (*centre.setting, (id_, (size,)))
    plain, run = problem.pool.run([centre, replace(centre, setting=setting)])
    assert plain is not None
    assert run is not None
    true = (run - plain) / size
    rows = [3, 4, 5, 6, 7]  # wheels, currents, velocity: nothing in them is faster than the pushes
    size_of = np.sqrt(np.mean((plain[rows] - plain[rows, :1]) ** 2, axis=1))[:, None]
    one, other = true[rows] / size_of, foretold[rows] / size_of
    assert np.sum(one * other) > 0.9 * np.linalg.norm(one) * np.linalg.norm(other)
    assert np.linalg.norm(other) == pytest.approx(np.linalg.norm(one), rel=0.25)


def test_nothing_is_described_and_no_force_closes_anything_where_nothing_is_missing() -> None:
    (problem, _), impulses = measured(), pushes_of()
    assert described(problem, impulses, TOLERANCE) is None
    # of no gap any share is possible, so that the gap of a missing effect is what it is compared with
    lacking = measured(term_force_by_distance=-0.03)[1]
    most = ceiling(problem, replace(lacking), impulses, TOLERANCE)
    assert most.value < 0.02
    assert most.where == ()


def test_a_hidden_force_is_described_by_its_formula_and_the_ceiling_shows_its_size() -> None:
    (problem, base), impulses = (f(term_force_by_distance=-0.03) for f in (measured, pushes_of))
    most = ceiling(problem, base, impulses, TOLERANCE)
    assert most.left == pytest.approx(1.0, abs=0.1)
    assert most.value > 0.6
    assert max(most.parts, key=lambda q: most.parts[q]) == "force"
    chassis = load_robot().chassis
    assert chassis is not None
    there = -0.03 * chassis.total_mass * GRAVITY * COMMANDS[-1].distance / chassis.wheel_base
    assert most.where
    for push in most.where:  # sand and gains have taken up a part
        assert push.quantity == "force"
        assert there < push.size < 0.2 * there
    found = described(problem, impulses, TOLERANCE)
    assert found is not None
    assert list(filter(is_term, found.point.effects)) == ["term_force_by_distance"]
    std = np.sqrt(np.diag(found.posterior.covariance))[-1]
    assert abs(found.point.common[0] + 0.03) < 3 * std + 0.003
    before, after = (predict(problem, f, TOLERANCE) for f in (base, found))
    assert after.speed_left_out.sum() < before.speed_left_out.sum()


def test_a_soft_patch_is_described_by_its_place_and_an_effect_is_found_beside_the_description() -> None:
    """The description closes the gap at speeds left out."""
    problem, base = measured(**PATCH)
    described_by = described(problem, pushes_of(**PATCH), TOLERANCE)
    assert described_by is not None
    largest = term(described_by.point.effects[int(np.argmax(np.abs(described_by.point.common)))])
    assert isinstance(largest, Term)
    chassis = load_robot().chassis
    assert chassis is not None
    place = list(PLACES).index(largest.groups[0]) * chassis.wheel_base / 4
    assert place == pytest.approx(0.35, abs=0.12)
    before, after = (predict(problem, f, TOLERANCE) for f in (base, described_by))
    excess = [float((p.speed_left_out - p.expected).sum()) for p in (before, after)]
    assert excess[1] < excess[0] / 4
    terms = set(filter(is_term, described_by.point.effects))
    assert terms
    start = Model.of(tuple(sorted(described_by.point.effects)), described_by)
    alone = Search((Model.of((), base),), {})
    again = search_beside(alone, start, problem, ("drivetrain_friction", "accel_scale_error"), TOLERANCE)
    assert terms & set(again.best.effects)
    assert [e for e in again.best.effects if not is_term(e)] == ["drivetrain_friction"]
    found = again.best.fit
    places = [k for k, (e, p) in enumerate(problem.parameters(found.point.effects, per_trial=False))
              if (e, p.name) == ("drivetrain_friction", "coulomb")]  # fmt: skip
    assert found.point.common[places[0]] == pytest.approx(0.3, abs=0.05)


def test_a_model_is_not_offered_a_term_that_it_holds() -> None:
    every, others = (
        {t.id for t in terms_beside(effects)} for effects in ((), ("drive_reaction", "term_modulus_at_9"))
    )
    assert every - others == {"term_modulus_at_9"}
