"""A discovery in words: signs said as directions, laws as formulas, what next."""

from __future__ import annotations

import dataclasses
import math
import re

import pytest

from granite_lab.discovery.finding import Finding, FoundEffect, FoundParameter
from granite_lab.effects import library
from granite_lab.estimate import Estimate
from granite_lab.model.effect import activate
from granite_lab.reporting.answers import missing_answer
from granite_lab.reporting.content import Source
from granite_lab.reporting.names import (
    describe,
    in_plain_words,
    latency_in_words,
    law_formulas,
    next_steps,
)
from granite_lab.reporting.plot_search import candidates_figure
from granite_lab.reporting.report import search_report
from granite_lab.reporting.rounding import percent
from granite_lab.reporting.search_tables import (
    candidates_table,
    confusion_table,
    detectable_table,
    effects_table,
)
from tests.reporting.made_up_finding import made_up_finding
from tests.reporting.test_figures import texts

SOURCE = Source("0.1.0", "granite-lab discover trials", (), ())


def found(effect_id: str, **values: tuple[float, float]) -> FoundEffect:
    effect = library()[effect_id]
    units = {p.name: p.unit for p in effect.parameters}
    numbers = tuple(FoundParameter(n, units[n], Estimate(*v)) for n, v in values.items())
    return FoundEffect(effect.id, effect.title, numbers, (), 0.97, Estimate(0.9, 0.02))


def naming(effect: FoundEffect) -> Finding:
    """Return a finding that names an effect in place of the made-up one."""
    values = {p.name: p.estimate.value for p in effect.parameters}
    active = activate(library()[effect.id], values)
    return dataclasses.replace(made_up_finding(), effects=(effect,), active=(active,))


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        (found("clock_offset", offset=(-0.0035, 0.0001)),
         "stamps of encoders and currents early against the IMU's (by 3.50 ± 0.10 ms)"),
        (found("clock_offset", offset=(0.0268, 0.0003)),
         "stamps of encoders and currents late against the IMU's (by 26.80 ± 0.30 ms)"),
        (found("com_offset", forward=(-0.02, 0.001)),
         "centre of mass shifted to the rear (by 20.0 ± 1.0 mm)"),
        (found("ground_slope", slope=(-1.2, 0.1)), "ground that falls (by 1.20 ± 0.10 °)"),
        (found("imu_tilt", tilt=(-0.5, 0.1)), "IMU mounted nose up (by 0.50 ± 0.10 °)"),
        (found("wheel_radius_error", error=(-0.01, 0.002)), "wheel angles read too small (by 1.00 ± 0.20 %)"),
        (found("tyre_windup", compliance=(0.00146, 1e-5), retardation=(0.0219, 0.0002)),
         ("torsion of the tyre between rim and tread "
          "(compliance 1.460 ± 0.010 mrad/(N m), retardation 21.90 ± 0.20 ms)")),
        (found("radial_tyre_compliance", compliance=(2e-5, 1e-6)),
         "tyre that deflects under its load (compliance 20.0 ± 1.0 µm/N)"),
    ],
)  # fmt: skip
def test_a_sign_is_said_as_a_direction_and_a_size_in_a_unit_that_fits(
    effect: FoundEffect, expected: str
) -> None:
    assert describe(effect).replace("\u00a0", " ") == expected


def test_cosine_and_sine_of_each_trial_are_said_as_the_amplitude_they_share() -> None:
    """3 and 4 make 5, and of an error along the larger part most counts."""
    of = {
        "cos_front": (3e-3, 1e-4),
        "sin_front": (4e-3, 1e-4),
        "cos_rear": (0.012, 0.0),
        "sin_rear": (0.005, 0.0026),
    }
    effect = found("encoder_eccentricity", **of)
    trials = tuple(dataclasses.replace(p, per_trial=(0.1, 0.2)) for p in effect.parameters)
    said = describe(dataclasses.replace(effect, parameters=trials)).replace("\u00a0", " ")
    assert (
        said == "eccentric encoder discs (amplitude front 5.00 ± 0.10 mrad, amplitude rear 13.0 ± 1.0 mrad)"
    )
    assert "cos front 3.00 ± 0.10 mrad" in describe(effect).replace("\u00a0", " ")  # the same in all trials


def test_the_table_keeps_sign_and_si_unit_and_says_which_way_it_goes() -> None:
    finding = naming(found("clock_offset", offset=(-0.0035, 0.0001)))
    table = effects_table(finding, library(), finding.effects)
    assert table is not None
    row = table.rows[0]
    assert row[3].text.replace("\u00a0", " ") == "−3.50 ± 0.10 ms"
    assert row[3].raw == (-0.0035, 0.0001, "s")
    assert "below zero: stamps of encoders and currents early" in row[2].text


@pytest.mark.parametrize(
    ("value", "std", "said"),
    [
        (0.004, 0.001, "IMU stamps 4.0 ± 1.0 ms behind those of wheels and currents"),
        (-0.0123, 0.0004, "IMU stamps 12.3 ± 0.4 ms ahead of those of wheels and currents"),
        (math.nan, math.nan, ""),
    ],
)
def test_latency_is_said_with_its_direction(value: float, std: float, said: str) -> None:
    assert latency_in_words(Estimate(value, std)).replace("\u00a0", " ") == said


def test_the_law_stands_as_formulas_and_is_no_physics() -> None:
    finding = made_up_finding("unknown")
    assert [f.replace("\u00a0", " ") for f in law_formulas(finding)] == [
        "force along the robot = −2.90 N · exp(−x / 0.2 m)",
        "moment on the body, nose down = 1.20 N m · v / (0.5 m/s)",
        "torque against each rear wheel = 0.05 N m · s / 0.2",
    ]
    answer = missing_answer(finding)
    assert answer.verdict == "Something unknown"
    assert "force along the robot, over the first 0.2 m (−2.90" in answer.text
    first = search_report(finding, "mine", SOURCE, model="model.toml").sections[0]
    said = " ".join(block for block in first.blocks if isinstance(block, str))
    assert "no physics" in said
    assert list(law_formulas(finding)) in first.blocks


def test_a_law_is_not_called_an_effect() -> None:
    for figure in search_report(made_up_finding("unknown"), "mine", SOURCE).figures:
        assert "effects found" not in figure.title + figure.caption, figure.name
        assert "with the effects found" not in [text for text, _ in texts(figure.draw())], figure.name


def test_what_limits_a_size_is_said_and_what_cannot_be_seen() -> None:
    finding = made_up_finding()
    table = detectable_table(finding, library())
    assert table is not None
    limits = {row[0].text: (row[2].text, row[5].text) for row in table.rows}
    assert limits["payload mass"][1] == "tolerance"
    assert limits["bulldozing"][1] == "noise"
    assert limits["IMU tilt"][0] == "not visible"


def test_what_a_candidate_would_be_taken_for_stands_in_percent() -> None:
    table = confusion_table(made_up_finding())
    assert table is not None
    assert [cell.text.replace("\u00a0", " ") for cell in table.rows[0]] == [
        "multi pass", "85 %", "5 %", "centre-of-mass offset (10 %)",
    ]  # fmt: skip
    assert "clock offset" not in {row[0].text for row in table.rows}  # these trials cannot show it


def test_candidates_stand_with_probability_share_and_fate() -> None:
    finding = made_up_finding()
    table = candidates_table(finding, library())
    assert table is not None
    rows = {row[0].text: [c.text.replace("\u00a0", " ") for c in row[2:6]] for row in table.rows}
    assert rows["multi pass"] == ["97 %", "93 %", "300", "named"]
    assert rows["gear backlash"][3] == "ended at a limit (backlash)"
    assert rows["payload mass"][1] == "–"
    figure = candidates_figure(finding)
    assert figure is not None
    assert re.fullmatch(r"Of \d+ candidates, multi pass is in the model", figure.title)


def test_a_probability_is_never_rounded_to_certainty() -> None:
    assert percent(0.9999).replace("\u00a0", " ") == "over 99 %"
    assert percent(1.0).replace("\u00a0", " ") == "100 %"


def test_names_to_type_do_not_stand_in_sentences() -> None:
    finding = made_up_finding("unknown")
    note = "multi_pass was not evaluated: with it the simulation or the fit fails here."
    assert in_plain_words(note, finding).startswith("Multi pass was not evaluated: with it")
    assert in_plain_words("pitch_rate and current_f go together", finding) == (
        "Pitch rate and front motor current go together"
    )
    assert in_plain_words("The likeliest candidates (com_offset) do not explain enough.", finding) == (
        "The likeliest candidates (centre-of-mass offset) do not explain enough."
    )
    assert in_plain_words("empirical.force_start is large.", finding) == (
        "Force along the robot, over the first 0.2 m is large."
    )


def steps(finding: Finding) -> str:
    return " ".join(next_steps(finding, "model.toml", "reports/my sand"))


def test_advice_fits_the_verdict_and_its_commands_can_be_pasted() -> None:
    named = steps(made_up_finding())
    assert "granite-lab simulate --model 'reports/my sand/model.toml' --variant 0.5" in named
    assert "sharpen the sizes" in named
    assert "tells multi pass from slip sinkage" in steps(made_up_finding(twins=("slip_sinkage",)))
    error = steps(naming(found("clock_offset", offset=(0.01, 0.001))))
    assert "Clock offset is an error of the measurement, not of the model" in error
    assert "simulate" not in error
    assert "More is missing" in steps(dataclasses.replace(made_up_finding(), remainder=0.4))
    assert "effect of your own" in steps(made_up_finding("unknown"))
    assert "Nothing needs to be added" in steps(made_up_finding("none"))
    assert steps(made_up_finding(repetitions=1)).startswith(
        "Drive two trials or more at each of three speeds"
    )
