"""A discovery in words: signs said as directions, laws as formulas, moments that are looked at, what next."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from granite_lab.discovery import Finding
from granite_lab.discovery.finding import FoundEffect, FoundParameter, Gap, Unrepeated
from granite_lab.effects import library
from granite_lab.estimate import Estimate
from granite_lab.model.effect import activate
from granite_lab.reporting.answers import law_answer
from granite_lab.reporting.discovery.answers import missing_answer, sure_answer, where_answer
from granite_lab.reporting.discovery.evidence import steps
from granite_lab.reporting.discovery.names import describe, in_plain_words
from granite_lab.reporting.discovery.next_steps import next_steps
from granite_lab.reporting.discovery.plot_closer import closer_drawings
from granite_lab.reporting.discovery.plot_law import law_formulas
from granite_lab.reporting.discovery.plot_sizes import detectable_drawing
from granite_lab.reporting.discovery.plot_which import candidate_drawings
from granite_lab.reporting.discovery.tables import detectable_table, effects_table, intervals_table
from granite_lab.reporting.document import Gallery, Listing, Words
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import BUMP, STRENGTH, made_up_finding
from tests.reporting.test_figures import texts


def found(effect_id: str, **values: tuple[float, float]) -> FoundEffect:
    effect = library()[effect_id]
    units = {p.name: p.unit for p in effect.parameters}
    numbers = tuple(FoundParameter(n, units[n], Estimate(*v)) for n, v in values.items())
    return FoundEffect(effect.id, effect.title, numbers, (), 5000.0)


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
        said
        == "encoders that run out of true (amplitude front 5.00 ± 0.10 mrad, amplitude rear 13.0 ± 1.0 mrad)"
    )
    assert "cos front 3.00 ± 0.10 mrad" in describe(effect).replace("\u00a0", " ")  # the same in all trials


def test_the_table_keeps_sign_and_si_unit_and_says_which_way_it_goes() -> None:
    table = effects_table(naming(found("clock_offset", offset=(-0.0035, 0.0001))))
    assert table is not None
    row = table.rows[0]
    assert row[3].text.replace("\u00a0", " ") == "−3.50 ± 0.10 ms"
    assert row[3].raw == (-0.0035, 0.0001, "s")
    assert "below zero: stamps of encoders and currents early" in row[2].text


def test_the_closer_look_is_where_the_effect_is() -> None:
    # The bump of the pitch rate is 12 times the noise of one trial, which is 3 mrad/s.
    finding = made_up_finding()
    first = closer_drawings(finding)[0]
    low, high = first.figure.axes[0].get_xlim()
    assert low < np.mean(BUMP) < high
    assert high - low == pytest.approx(1.2, abs=0.05)
    named = [text for text, _ in texts(first.figure)]
    assert "pitch rate" in named
    assert "pitch rate: simulated − measured" in named
    assert not any("acceleration" in name for name in named)  # nothing is missing there
    before, after = (float(v) for v in re.findall(r"([\d.]+)\u00a0mrad/s", first.sentence))
    # rms of a Gaussian of 0.2 s over 1.2 s; afterwards the noise of three trials is left
    assert before == pytest.approx(3 * STRENGTH * math.sqrt(0.2 * math.sqrt(math.pi / 2) / 1.2), rel=0.05)
    assert after == pytest.approx(3 / math.sqrt(3), rel=0.2)


def test_two_closer_looks_are_at_two_events() -> None:
    finding = made_up_finding()
    again = []
    for r in finding.residuals:
        if r.channel == "accel_x":  # something smaller while the wheels begin to turn
            early = 6 * np.exp(-(((r.t - 0.1) / 0.05) ** 2))
            changed = dataclasses.replace(
                r, measured=r.measured + 0.05 * early, after=r.after + 0.05 * early,
                white_before=r.white_before + early,
            )  # fmt: skip
            again.append(changed)
        else:
            again.append(r)
    first, second = closer_drawings(dataclasses.replace(finding, residuals=tuple(again)))
    assert first.title != second.title
    assert {t.title.split(", ")[1].split(" (")[0] for t in (first, second)} == {
        "at the start", "in steady motion",
    }  # fmt: skip


def test_nothing_is_looked_at_closer_where_nothing_was_found() -> None:
    assert closer_drawings(made_up_finding("none")) == []


def test_the_law_stands_as_formulas_is_no_physics_and_says_how_much_it_closes() -> None:
    finding = made_up_finding("unknown")
    assert [f.replace("\u00a0", " ") for f in law_formulas(finding)] == [
        "force along the robot = −2.90 N · exp(−x / 0.2 m)",
        "moment on the body, nose down = 1.20 N m · v / (0.5 m/s)",
        "torque against each rear wheel = 0.0500 N m · s / 0.2",
    ]
    assert (
        "a force along the robot, a moment on the body and a torque against each rear wheel: a description"
        in missing_answer(finding).text
    )
    step = next(s for s in steps(finding, "model.toml") if s.id == "found-law")
    text = " ".join(block.text for block in step.blocks if isinstance(block, Words))
    assert "It is not physics." in text
    # (3.10 - 1.85) / (3.10 - 1)
    assert "closes 60 % of the gap on trials that were left out" in text
    assert "model.toml holds the paper's model alone" in text
    assert any(isinstance(b, Listing) and b.items == law_formulas(finding) for b in step.blocks)


def test_a_law_is_not_called_what_was_found() -> None:
    for step in steps(made_up_finding("unknown")):
        drawings = [d for block in step.blocks if isinstance(block, Gallery) for d in block.drawings]
        for drawing in drawings:
            assert "what was found" not in drawing.sentence, drawing.id
            assert "with what was found" not in [text for text, _ in texts(drawing.figure)], drawing.id


def test_a_candidate_that_could_not_be_simulated_is_not_said_to_be_invisible() -> None:
    finding = made_up_finding()
    rounds = tuple(tuple(c for c in r if c.id != "imu_tilt") for r in finding.rounds)
    failed = dataclasses.replace(finding, rounds=rounds)  # it has no smallest size, and was never tried
    drawing, table = detectable_drawing(failed, library()), detectable_table(failed, library())
    assert drawing is not None
    assert table is not None
    assert "Of IMU tilt nothing is known" in drawing.sentence
    assert "cannot show" not in drawing.sentence
    assert "could not be tried" in {row[2].text for row in table.rows}
    limits = next(s for s in steps(failed) if s.id == "found-limits")
    listing = next(b for b in limits.blocks if isinstance(b, Listing))
    assert "IMU tilt was not tried: the model with it could not be simulated here." in listing.items
    whole = detectable_drawing(finding, library())
    assert whole is not None
    assert "These trials cannot show IMU tilt." in whole.sentence


def test_others_beyond_the_line_are_explained() -> None:
    # com offset (800), slip sinkage (300) and clock offset (20) are beyond 18; the second round has 9 at most
    drawing = candidate_drawings(made_up_finding())[0]
    assert "3 more beyond the line explain part of the same" in drawing.sentence
    assert "once it is in the model, none adds more than chance" in drawing.sentence


@pytest.mark.parametrize(
    ("status", "why"),
    [
        ("uneven", "it would need another size in each trial, not only another phase"),
        ("related", "it is like what is in the model already"),
        ("at a bound", "its fit ended at a bound"),
        ("evaluated", "it explains too little"),
    ],
)
def test_the_reader_is_told_why_the_strongest_candidate_is_not_named(status: str, why: str) -> None:
    finding = made_up_finding("unknown")
    best, *others = finding.rounds[0]
    finding = dataclasses.replace(finding, rounds=((dataclasses.replace(best, status=status), *others),))
    sentence = candidate_drawings(finding)[0].sentence
    assert f"but it does not count: {why}" in sentence


def test_names_to_type_do_not_stand_in_sentences() -> None:
    finding = made_up_finding()
    note = "multi_pass was not evaluated: with it the simulation or the fit fails here."
    assert in_plain_words(note, finding).startswith("Multi pass was not evaluated: with it")
    assert in_plain_words("pitch_rate and current_f go together", finding) == (
        "Pitch rate and front motor current go together"
    )
    assert in_plain_words("The best candidates (com_offset) close 34 %.", finding) == (
        "The best candidates (centre-of-mass offset) close 34 %."
    )


def test_what_differs_from_trial_to_trial_is_said_with_the_sensors_that_show_it() -> None:
    seen = Unrepeated(9.3, "pitch_rate", "current_f", 0.0, 2.0)
    quiet = dataclasses.replace(
        made_up_finding("unknown"),
        effects=(),
        map_after=3.0,
        gap=Gap("all", "all", (1, 1, 1), (1, 1, 1)),
        unrepeated=seen,
    )
    text = missing_answer(quiet).text
    assert "not the same in each trial" in text
    assert "pitch rate and front motor current go together between 0 Hz and 2 Hz (9.3 standard" in text
    assert "What repeats is explained" in text
    assert where_answer(dataclasses.replace(quiet, where=())).verdict == "elsewhere each time"
    assert "What is left is more than noise" in sure_answer(quiet, library()).text
    assert "candidates" not in text
    besides = missing_answer(dataclasses.replace(made_up_finding("unknown"), unrepeated=seen)).text
    assert "candidates" in besides
    assert "It is not the same in each trial" in besides


def test_advice_fits_the_verdict() -> None:
    named = " ".join(next_steps(made_up_finding(), "model.toml"))
    assert "granite-lab simulate --model model.toml" in named
    assert "To sharpen the numbers" in named
    assert "To tell multi pass from slip sinkage" in " ".join(
        next_steps(made_up_finding(twins=("slip_sinkage",)), "model.toml")
    )
    fault = " ".join(next_steps(naming(found("clock_offset", offset=(0.01, 0.001))), "model.toml"))
    assert "Clock offset is a fault of the measurement, not of the model" in fault
    assert "simulate" not in fault
    assert "effect of your own" in " ".join(next_steps(made_up_finding("unknown")))
    assert "Nothing needs to be added" in " ".join(next_steps(made_up_finding("none")))


def test_seconds_before_the_start_have_a_true_minus_and_no_zero_has_one() -> None:
    finding = made_up_finding()
    where = tuple(dataclasses.replace(d, start=-0.14, end=-0.001) for d in finding.where)
    table = intervals_table(dataclasses.replace(finding, where=where))
    assert table is not None
    assert [cell.text for cell in table.rows[0]][3:5] == ["−0.14", "0.00"]


def test_long_numbers_are_grouped() -> None:
    effect = dataclasses.replace(made_up_finding().effects[0], evidence=27712.0)
    rounds = tuple(
        tuple(dataclasses.replace(c, evidence=27712.0) if c.id == effect.id else c for c in r)
        for r in made_up_finding().rounds
    )
    text = missing_answer(dataclasses.replace(made_up_finding(), effects=(effect,), rounds=rounds)).text
    assert "The evidence for it is 27\u00a0700;" in text


def test_a_law_of_k92_that_differs_is_put_beside_what_is_missing() -> None:
    fit = made_up_study(speeds=(0.3, 0.5)).a_theta
    assert fit is not None
    off = dataclasses.replace(fit, a_theta=Estimate(3.6, 0.05), ci95=(3.5, 3.7), agrees=False)
    assert "stand in for what was found missing" in law_answer(off, lacking=True).text
    assert "stand in" not in law_answer(off).text
