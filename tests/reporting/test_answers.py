"""The page stays short; each number is decided once, and said alike wherever it stands, within 80 columns."""

import io
import math
import re
import unicodedata
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rich.console import Console

from granite_lab.effects.library import get
from granite_lab.estimate import Estimate, Part, mean_over
from granite_lab.estimation.plausibility import BY_RADIUS
from granite_lab.estimation.smoother import STEADY_SLIP
from granite_lab.fitting.fit import View, of_mean
from granite_lab.model.effect import EFFECTS
from granite_lab.parameters import load_variants
from granite_lab.parameters.catalogue import in_force
from granite_lab.reporting import terminal
from granite_lab.reporting.answers import Answers, law_answer, of_study
from granite_lab.reporting.channels import judged_channels
from granite_lab.reporting.report import Fold, Gallery, study_report
from granite_lab.reporting.speeds import first_table, speeds_of
from granite_lab.reporting.table import say, show_table
from granite_lab.reporting.tables import trial_table
from granite_lab.results import PooledMisfit, StudyResult, pooled_misfits
from granite_lab.rounding import interval, percent, plus_minus, rounded, significant
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import SPEEDS, made_up_study, rename
from tests.reporting.made_up_finding import made_up_finding
from tests.reporting.test_report import Strict
from tests.soak import sampled

NAN = math.nan


def test_at_most_3500_words_and_ten_figures_are_in_view(twelve_folder: Path) -> None:
    page = Strict(twelve_folder)
    assert 500 < len(" ".join(page.seen).split()) <= 3500
    assert 2 <= page.figures <= 10


@pytest.mark.parametrize("speeds", [(0.5,), SPEEDS])
def test_one_figure_a_speed_overlays_measured_and_simulated(speeds: tuple[float, ...]) -> None:
    report = study_report(made_up_study(speeds=speeds, repetitions=2))
    blocks = [b for s in report.sections for b in s.blocks]
    shown = [f.name for b in blocks if isinstance(b, Gallery) for f in b.figures]
    motions = [f"motion_{v:.2f}".replace(".", "p") for v in speeds]
    assert [n for n in shown if n.startswith("motion_")] == motions
    assert any(isinstance(b, Fold) for b in blocks)


def of_slips(*percent: float) -> Answers:
    study = made_up_study(speeds=(0.7,), repetitions=len(percent))
    trials = []
    for r, slip in zip(study.trials, percent, strict=True):
        motion = replace(r.motion, slip_ratio=Estimate(slip / 100, 0.001))
        trials.append(replace(r, motion=motion))
    return of_study(replace(study, trials=tuple(trials)))


def test_a_paper_value_is_compared_with_the_interval_as_it_is_printed() -> None:
    """The paper's 22.9 % is never said to differ from an interval that is printed as ending there."""
    for step in sampled(range(60), 4):
        high = 22.80 + 0.004 * step
        answers = of_slips(high - 0.4, high - 0.2)
        (speed,) = answers.speeds
        low, top = (float(x.replace("−", "-")) for x in speed.slip.interval.split(" to "))
        assert speed.agrees is (low <= 22.9 <= top)
        table = first_table(answers.speeds, slip_unknown=False, virtual=False)
        assert table is not None
        assert (table.rows[0][4].text == "yes") is speed.agrees


def test_a_law_is_not_tested_by_fewer_than_three_speeds() -> None:
    for speeds, verdict in (((0.3, 0.7), "Not tested"), ((0.2, 0.3, 0.7), "Yes")):
        answer = next(q for q in of_study(made_up_study(speeds=speeds)).questions if q.id == "a_theta")
        assert answer.verdict.partition(",")[0] == verdict


@pytest.mark.parametrize(
    ("driven", "count"), [((0.3, 0.4983, 0.5021), 3), ((0.2049, 0.2051, 0.3), 2), ((0.3, 0.3001, 0.2998), 1)]
)
def test_the_answer_on_a_theta_counts_the_speeds_that_table_and_trust_count(
    driven: tuple[float, ...], count: int
) -> None:
    made, trials = made_up_study(speeds=(0.2, 0.3, 0.5), repetitions=1), []
    for r, v in zip(made.trials, driven, strict=True):
        variant = replace(r.motion.variant, velocity=v)
        trials.append(replace(r, motion=replace(r.motion, variant=variant)))
    assert made.a_theta is not None
    points = tuple((n, v, *rest) for (n, _, *rest), v in zip(made.a_theta.points, driven, strict=True))
    law = replace(made.a_theta, points=points)
    answers = of_study(replace(made, trials=tuple(trials), a_theta=law))
    a_theta, trust = (next(q.text for q in answers.questions if q.id == id_) for id_ in ("a_theta", "trust"))
    assert len(answers.speeds) == count
    few = count < 3
    assert ("these trials have" in a_theta) is ("only" in trust) is few
    assert not few or f"these trials have {count}." in a_theta


def test_a_theta_is_stated_by_the_files_with_their_uncertainty_and_with_what_was_found(
    twelve: StudyResult,
) -> None:
    part = Part("K, of the soil", "B", "log-normal", "1", 0.2, 1.2)
    views = (
        View("files", Estimate(6.6, 0.1), (6.4, 6.8)),
        View("uncertain", Estimate(6.6, 1.3), (4.5, 9.7), (part,)),
        View("found", Estimate(4.86, 0.2), (4.5, 5.3)),
    )
    off = replace(twelve.a_theta, a_theta=Estimate(6.6, 0.1), ci95=(6.4, 6.8))
    finding = replace(made_up_finding(), a_theta=views)
    answer = law_answer(off, finding)
    assert answer.verdict == "Not by these files alone"
    for said in (
        "6.60 ± 0.10 s/m",
        "mostly from K of the soil, the interval is 4.5 to 9.7",
        "4.86 ± 0.20 s/m, 4.50 to 5.30 s/m",
    ):
        assert said in kept_as_spaces(answer.text)
    alone = law_answer(None, finding)
    assert alone.verdict == "Yes, with what was found"
    assert "With soil and robot as in their files: 6.60 ± 0.10 s/m" in kept_as_spaces(alone.text)


def test_a_law_that_holds_by_the_files_alone_is_no_plain_yes(twelve: StudyResult) -> None:
    views = (
        View("files", Estimate(4.9, 0.1), (4.7, 5.1)),
        View("found", Estimate(3.3, 0.2), (3.0, 3.6)),
    )
    agrees = replace(twelve.a_theta, a_theta=Estimate(4.9, 0.1), ci95=(4.7, 5.1))
    answer = law_answer(agrees, replace(made_up_finding(), a_theta=views))
    assert answer.verdict == "Yes by these files, but not with what was found"
    assert answer.tone == "fair"


def kept_as_spaces(text: str) -> str:
    return text.replace("\u00a0", " ")


def test_a_theta_that_differs_is_put_beside_what_is_missing(twelve: StudyResult) -> None:
    off = replace(twelve.a_theta, a_theta=Estimate(3.6, 0.05), ci95=(3.5, 3.7))
    for finding, said in ((twelve.finding, True), (made_up_finding("none"), False)):
        study = replace(twelve, a_theta=off, finding=finding)
        answer = next(q for q in of_study(study).questions if q.id == "a_theta")
        assert answer.verdict == "No"
        assert ("what is missing from the model can cause the difference" in answer.text) is said


def test_the_mean_takes_the_wider_of_two_intervals() -> None:
    # Scatter 0.01 over three trials: Student's t with two degrees of freedom is 4.3027.
    scattered = mean_over([Estimate(0.1, 1e-4), Estimate(0.11, 1e-4), Estimate(0.12, 1e-4)])
    assert scattered.high - scattered.value == pytest.approx(4.302653 * 0.01 / math.sqrt(3), rel=1e-6)
    # Alike by chance: the stated uncertainty holds.
    alike = mean_over([Estimate(0.1, 0.03)] * 3)
    assert alike.high - alike.value == pytest.approx(1.959964 * 0.03 / math.sqrt(3), rel=1e-6)
    assert mean_over([Estimate(0.1, 0.02)]).low == pytest.approx(0.1 - 1.959964 * 0.02)
    assert mean_over([Estimate(NAN)]).n == 0


def test_a_mean_does_not_reduce_an_error_that_all_trials_have_in_common() -> None:
    """Against draws: two sources in each of four trials, one of them the same in all."""
    noise, radius = (0.01, 0.02, 0.01, 0.02), (0.012, 0.012, 0.006, 0.006)
    rng = np.random.default_rng(5)
    drawn = rng.normal(size=(200_000, 4)) * noise + rng.normal(size=(200_000, 1)) * radius
    parts = [
        (Part("noise", "A", "normal", "", 1, n), Part(BY_RADIUS, "B", "normal", "m", 1, r, common=True))
        for n, r in zip(noise, radius, strict=True)
    ]
    slips = [Estimate(0.1, math.hypot(n, r)) for n, r in zip(noise, radius, strict=True)]
    mean = mean_over(slips, parts=parts)
    assert mean.std == pytest.approx(float(np.std(drawn.mean(axis=1))), rel=0.01)
    assert mean.std > 1.1 * mean_over(slips).std
    budget = of_mean(0.5, Estimate(mean.value, mean.std), parts, [0.25] * 4)
    assert budget is not None
    assert budget.combined == pytest.approx(mean.std)
    assert {part.name for part in budget.parts} == {"noise", BY_RADIUS}


def test_many_trials_without_an_anchor_do_not_make_a_slip_that_is_known() -> None:
    study = made_up_study()
    prior = (Part(STEADY_SLIP, "B", "rectangular", "1", 0.58, 0.58, common=True),)
    motions = [replace(r.motion, slip_ratio=Estimate(0.02, 0.58), slip_parts=prior) for r in study.trials]
    trials = tuple(replace(r, motion=motion) for r, motion in zip(study.trials, motions, strict=True))
    speeds = speeds_of(replace(study, trials=trials))
    assert max(s.trials for s in speeds) > 1
    assert not any(s.slip_is_known for s in speeds)


def test_repetitions_are_grouped_and_the_middle_one_is_drawn(study: StudyResult) -> None:
    speeds = speeds_of(study)
    assert [(s.velocity, len(s.results)) for s in speeds] == [(0.3, 2), (0.7, 2)]
    assert speeds[1].paper_k92 == 0.026
    three = speeds_of(made_up_study(speeds=(0.2,), repetitions=3))[0]
    slips = sorted(r.motion.slip_ratio.value for r in three.results)
    assert three.typical.motion.slip_ratio.value == slips[1]


def gap(normalised: float, rms: float = 0.05, phase: str = "all") -> PooledMisfit:
    return PooledMisfit("velocity", "m/s", phase, rms, 0.0, rms, normalised, size=1.0, trials=1)


@pytest.mark.parametrize(
    ("normalised", "rms", "verdict"),
    [
        (1.4, 0.05, "agrees"),
        (2.0, 0.05, "differs"),
        (50.0, 0.05, "differs clearly"),
        (50.0, 0.009, "differs by under 1\u00a0%"),
        (NAN, 0.05, "not judged, noise not known"),
        # a difference of 74 % of the largest value, hidden in the noise, is no agreement
        (0.61, 0.74, "not judged, too noisy"),
    ],
)
def test_a_quantity_is_judged_by_noise_and_largest_value(normalised: float, rms: float, verdict: str) -> None:
    (judged,) = judged_channels({("velocity", "all"): gap(normalised, rms)})
    assert judged.verdict == verdict


def test_the_worst_phase_is_the_furthest_beyond_its_noise_and_slip_differs_by_points() -> None:
    (judged,) = judged_channels(
        {("slip_f", "all"): PooledMisfit("slip_f", "-", "all", 0.15, 0.0, 0.3, 28.0, 0.5, 3)}
    )
    assert (judged.rms, judged.unit) == (15.0, "points")
    phases = {"all": 99.0, "brake": 2.0, "steady": 9.0, "rest": NAN}
    (judged,) = judged_channels({("velocity", p): gap(x, phase=p) for p, x in phases.items()})
    assert judged.worst == "in steady motion"


def test_the_speeds_of_four_wheels_are_pooled_by_their_squares(study: StudyResult) -> None:
    pooled = pooled_misfits(study.trials)
    own = [m for r in study.trials for m in r.misfits if m.phase == "all"]
    wheels = [m for m in own if m.channel.startswith("wheel_")]
    mean = np.average([m.rms**2 for m in wheels], weights=[m.samples for m in wheels])
    assert pooled["wheels", "all"].rms == pytest.approx(math.sqrt(mean))
    assert not any(channel.startswith("wheel_") for channel, _ in pooled)


def test_stamps_that_come_late_are_said_to_be_late() -> None:
    # `clock_offset` is to be added to the wheels' stamps: 12.3 ms to add means that they are early.
    table = trial_table(made_up_study(speeds=(0.5,), repetitions=1))
    at = next(k for k, c in enumerate(table.columns) if c.title == "wheel stamps late [ms]")
    assert table.rows[0][at].text == "−12.3 ± 1.1"
    assert table.rows[0][at].raw == (-0.0123, 0.0011)


@pytest.mark.parametrize(
    ("value", "std", "expected"),
    [
        # Examples of the rounding rule in the Review of Particle Physics, section 5.3.
        (0.827, 0.119, "0.83 ± 0.12"), (0.827, 0.367, "0.8 ± 0.4"),
        (4.9234, 0.0521, "4.92 ± 0.05"), (0.2561, 0.0123, "0.256 ± 0.012"), (1.0, 0.0096, "1.000 ± 0.010"),
        (-0.0001, 0.12, "0.00 ± 0.12"), (-1.26, 0.4, "−1.3 ± 0.4"), (1234.0, 210.0, "1230 ± 210"),
        (0.1234, NAN, "0.123"), (0.1234, 0.0, "0.123"), (NAN, 0.1, "–"), (math.inf, 0.1, "–"),
        (1.23e-8, 4e-10, "(1.23 ± 0.04)·10⁻⁸"), (2.5e7, 1.2e6, "(2.50 ± 0.12)·10⁷"),
    ],
)  # fmt: skip
def test_value_and_std_are_rounded_to_the_std(value: float, std: float, expected: str) -> None:
    assert plus_minus(Estimate(value, std)) == expected


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0, "0"), (9.996, "10.0"), (0.099996, "0.100"), (1.2345, "1.23"), (-0.0123456, "−0.0123"),
     (123456, "123000"), (1.5e-7, "1.50·10⁻⁷"), (9.9999e7, "1.00·10⁸"), (NAN, "–"), (-math.inf, "−∞")],
)  # fmt: skip
def test_significant_digits(value: float, expected: str) -> None:
    assert significant(value) == expected


def test_units_stay_with_their_number_and_no_probability_is_rounded_to_certainty() -> None:
    assert plus_minus(Estimate(0.1649, 0.0031), "%", scale=100) == "16.49 ± 0.31\u00a0%"
    assert plus_minus(Estimate(NAN), "m/s") == "–"
    assert (percent(0.9999), percent(1.0)) == ("over 99\u00a0%", "100\u00a0%")


def test_value_std_and_interval_share_one_decimal_place() -> None:
    number = rounded(0.22481, 0.00104, 0.22137, 0.22824, unit="%", scale=100)
    assert (number.text, number.with_std, number.interval) == ("22.48", "22.48 ± 0.10", "22.14 to 22.82")
    assert number.holds(22.82) is True
    assert number.holds(22.9) is False
    assert rounded(0.3).holds(0.3) is None
    assert interval(4.8161, 5.0442, "s/m") == "4.82 to 5.04\u00a0s/m"
    assert (interval(NAN, 1.0), interval(2.0, 2.0)) == ("–", "2.00")


SIZES = st.builds(lambda sign, power: sign * 10.0**power, st.sampled_from((-1, 1)), st.floats(-30, 30))
"""Numbers of any size: as many of each decade."""


def read_back(printed: str) -> tuple[Decimal, ...]:
    """Return value and std of what `plus_minus` printed, or the value alone."""
    text = printed.replace("−", "-")
    shared = re.fullmatch(r"\((.*)\)·10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", text)
    parts = (shared[1] if shared else text).split(" ± ")
    power = Decimal(10) ** int(unicodedata.normalize("NFKC", shared[2]).replace("−", "-")) if shared else 1
    return tuple(Decimal(_as_float(part)) * power for part in parts)


def _as_float(text: str) -> str:
    mantissa, _, power = text.partition("·10")
    return f"{mantissa}e{unicodedata.normalize('NFKC', power).replace('−', '-') or 0}"


@given(SIZES | st.just(0.0), SIZES.map(abs))
@example(1.7326123451e9, 0.002)
@example(0.5, 1e-9)
@example(-1e30, 1e-30)
def test_a_value_of_any_size_is_rounded_to_its_std(value: float, std: float) -> None:
    """By at most half a unit of the last place, which is at most a fifth of the std, or as a double is."""
    shown, spread = read_back(plus_minus(Estimate(value, std)))
    assert abs(shown - Decimal(value)) <= Decimal(max(0.18 * std, 1e-14 * abs(value)))
    assert abs(spread - Decimal(std)) <= Decimal(0.18 * std)
    assert len(plus_minus(Estimate(value, std))) < 45


@given(SIZES | st.just(0.0), st.sampled_from((NAN, math.inf, 0.0)))
def test_a_value_of_any_size_without_std_has_three_digits(value: float, std: float) -> None:
    (shown,) = read_back(plus_minus(Estimate(value, std)))
    assert abs(shown - Decimal(value)) <= Decimal(0.00501 * abs(value))


@given(*[SIZES | st.sampled_from((NAN, math.inf, -math.inf, 0.0))] * 3)
def test_numbers_of_any_size_are_printed(value: float, low: float, high: float) -> None:
    number = rounded(value, abs(low), low, high, scale=100)
    assert number.text == "–" or math.isfinite(value)
    shown = (interval(low, high), number.with_std, number.interval, percent(value), significant(value, 2))
    for text in shown:
        assert text
        assert "nan" not in text


TWINS = ("slip_sinkage", "contact_angle_actual_speed")


def calls(result: StudyResult) -> dict[str, tuple[str, tuple[object, ...]]]:
    """Return functions and what they print, by a name for each."""
    comparisons = result.trials
    found = {
        f"finding {v}": ("show_study", (replace(result, trials=(), finding=made_up_finding(v, twins=TWINS)),))
        for v in ("named", "unknown", "none")
    }
    return {
        "study": ("show_study", (result,)),
        "motions": ("show_motions", ([(c.motion, Path("out") / "trial.csv", None) for c in comparisons],)),
        "k92": ("show_k92_fits", ([c.fit for c in comparisons],)),
        "a_theta": ("show_a_theta", (result.a_theta,)),
        "misfits": ("show_misfits", (comparisons,)),
        "parameters": ("show_parameters", (in_force("granite", "dry_sand"), load_variants())),
    } | found  # fmt: skip


def printed(result: StudyResult, name: str, *, colours: bool = False) -> str:
    out = io.StringIO()
    system = "standard" if colours else None
    console = Console(file=out, width=80, force_terminal=colours, color_system=system, highlight=False)
    show, records = calls(result)[name]
    getattr(terminal, show)(*records, console)
    return out.getvalue()


NAMES = list(calls(made_up_study(speeds=(0.2, 0.7), repetitions=1)))


@pytest.mark.parametrize("name", NAMES)
def test_tables_fit_eighty_columns_and_are_marked_where_virtual(name: str, study: StudyResult) -> None:
    text = printed(study, name)
    assert text.strip()
    assert max(map(len, text.splitlines())) <= 80
    assert "\x1b" not in text
    assert "nan" not in text.lower()
    assert "…" not in text.replace(" … ", "")  # nothing was cut
    assert ("virtual" in text) is (name not in ("a_theta", "parameters"))


def test_wide_tables_wrap_their_headings_and_lose_nothing() -> None:
    answers, out = of_study(made_up_study(speeds=SPEEDS, repetitions=3)), io.StringIO()
    slip, k92 = rounded(22.435, 0.123, 22.087, 22.788, unit="%"), rounded(0.0825, 0.0026)
    speeds = tuple(replace(s, slip=slip, k92=k92) for s in answers.speeds)
    console = Console(file=out, width=80, highlight=False)
    show_table(first_table(speeds, slip_unknown=False, virtual=bool(answers.virtual)), console)
    lines = [line.split() for line in out.getvalue().splitlines()]
    assert sum(line[-1:] == ["3"] for line in lines) == len(SPEEDS)
    assert any(line[-1:] == ["trials"] for line in lines)
    show_table(EFFECTS.fill([get("encoder_eccentricity"), get("contact_angle_actual_speed")]), console)
    assert "sin_front [rad]," in " ".join(out.getvalue().split())
    say(console, "a number and its unit, such as one of these, stay on the one line: 95 % or 4.919 s/m")
    assert "95 %" in out.getvalue()


def test_notes_and_trials_left_out_stand_beside_the_answers_in_colours(study: StudyResult) -> None:
    text = " ".join(printed(study, "finding named").replace("\u00a0", " ").split())
    for needed in ("pressure 0.300 ± 0.004 97 %", "left out: crashed: no model fits it", "note: One thing"):
        assert needed in text
    for name, colour in (("misfits", 31), ("finding named", 32)):
        assert f"\x1b[{colour}m" in printed(study, name, colours=True)


def test_names_from_logs_cannot_steer_the_terminal() -> None:
    steering = "[bold]\x1b[35m\x07\x1b]0;evil\x07[/]" + HOSTILE
    result = rename(made_up_study(speeds=(0.2, 0.7), repetitions=1), steering)
    for name in NAMES:
        text = printed(result, name, colours=True)
        assert "\x07" not in text
        assert re.sub(r"\x1b\[[0-9;]*m", "", text).count("\x1b") == 0
        assert "\x1b[35m" not in text
    assert "[bold]" in printed(result, "motions").replace("\n", "")
