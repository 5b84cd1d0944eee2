"""The case for a discovery: what it says, what its pictures and tables show, and what it never leaves out."""

import dataclasses
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from granite_lab.columns import FilledTable
from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.finding import (
    SIMULATES_WORSE,
    Ceiling,
    EffectFinding,
    Finding,
    FittedParameter,
    GroundWave,
    Push,
    Verdict,
)
from granite_lab.effects import library
from granite_lab.estimate import Estimate
from granite_lab.model.effect import activate
from granite_lab.reporting import names, search_tables
from granite_lab.reporting.answers import closes_answer, missing_answer
from granite_lab.reporting.plot_search import candidates_figure, history_figures, intervals_figure, mean_of
from granite_lab.reporting.report import Report, study_report
from granite_lab.results import Source, StudyResult
from tests.reporting.made_up_finding import BUMP, LEFT, SIZE, STRENGTH, made_up_finding
from tests.reporting.test_figures import texts
from tests.reporting.test_report import Strict

SOURCE = Source("0.1.0", "granite-lab discover trials", (), ())
VERDICTS: tuple[Verdict, ...] = ("named", "unknown", "none")


def spaced(text: str) -> str:
    """Return a text on one line, with plain spaces."""
    return " ".join(text.replace("\u00a0", " ").split())


@pytest.fixture(scope="module")
def findings() -> dict[str, Finding]:
    return {v: made_up_finding(v, twins=("slip_sinkage",)) for v in VERDICTS}


def report_of(finding: Finding) -> Report:
    alone = StudyResult("mine", (), (), None, SOURCE, finding)
    return study_report(alone, model="model.toml", folder="reports/mine")


def rows_of(table: FilledTable | None) -> list[dict[str, str]]:
    """Return the rows of a table, each by the titles of its columns."""
    titles = [c.title for c in table.columns]
    return [dict(zip(titles, (spaced(cell.text) for cell in row), strict=True)) for row in table.rows]


def test_the_first_screen_says_what_is_missing_and_how_far_to_trust_it(findings: dict[str, Finding]) -> None:
    answers = report_of(findings["named"]).answers
    found = {a.id: spaced(f"{a.verdict}. {a.text} {a.command}") for a in answers.questions}
    for id_, needed in (
        ("missing", "Multi-pass compaction. Rear wheels in the compacted rut (pressure 0.300 ± 0.004"),
        ("missing", "from slip sinkage."),
        ("closes", "93 %. Gap on trials that were left out of the fit"),
        ("closes", ": 3.10 with the paper's model, 1.15 with what was found. 1 means that noise and"),
        ("trust", "With care."), ("trust", "finding: 97 %"), ("trust", "compaction may be slip sinkage"),
        ("trust", "12 of 12 trials and 4 of 4 speeds left out of the fit are predicted"),
        ("trust", "1 trial left out because no model fits"),
        ("next", "granite-lab plan-next reports/mine"),
    ):  # fmt: skip
        assert needed in found[id_]
    provisional = report_of(made_up_finding(repetitions=1)).answers.questions
    trust = next(f"{q.verdict}. {q.text}" for q in provisional if q.id == "trust")
    assert trust.startswith("With care.")
    assert "no command was driven twice" in trust


def test_a_part_without_content_is_left_out() -> None:
    alone = made_up_finding("none", speeds=(0.3,), repetitions=1)
    alone = dataclasses.replace(
        alone, dropped=(), latency=Estimate(math.nan), scales={}, sand={}, confusion=None
    )
    report = report_of(alone)
    assert not {"found_fitted", "found_confusion", "found_left_out"} & {t.name for t in report.tables}
    assert not [c.title for c in search_tables.gaps_table(alone).columns if "left out" in c.title]
    few = made_up_finding(speeds=(0.2,), repetitions=2, channels=("wheel", "wheel_split"))
    drawn = {d.name for d in report_of(few).figures}
    assert drawn >= {"found_gap", "found_history_0p20"}
    assert "found_intervals" not in drawn  # none of these channels is off


def test_an_effect_without_numbers_and_a_share_that_is_not_known_make_a_report_too() -> None:
    finding = made_up_finding()
    bare = dataclasses.replace(finding.effects[0], parameters=(), closes=Estimate(math.nan))
    finding = dataclasses.replace(finding, effects=(bare,), remainder=math.nan, candidates=(), detectable=())
    text = " ".join(a.text for a in report_of(finding).answers.questions)
    assert "()" not in text
    assert "nan" not in text.lower().split()


def test_a_finding_is_a_part_of_a_studys_report(folder: Path, twelve_folder: Path) -> None:
    assert "Not searched" in (folder / "index.html").read_text(encoding="utf-8")
    text = (twelve_folder / "index.html").read_text(encoding="utf-8")
    assert "Not searched" not in text
    assert "Multi-pass compaction" in text
    assert {"missing", "answer-missing", "found_gap", "found_candidates"} <= set(Strict(twelve_folder).ids)
    document = json.loads((twelve_folder / "report.json").read_text(encoding="utf-8"))
    assert document["discovery"]["effects"][0]["id"] == "multi_pass"
    assert document["discovery"]["model"] == "model.toml"


def test_histories_are_means_over_the_repetitions_with_gaps_left_out(findings: dict[str, Finding]) -> None:
    residuals = [r for r in findings["named"].residuals if (r.channel, r.variant) == ("accel_x", 0.3)]
    own = mean_of(residuals)
    assert len(residuals) == 3
    assert np.isnan(own.measured[42])
    np.testing.assert_allclose(own.measured[60], np.mean([r.measured[60] for r in residuals]))


def test_a_history_is_of_all_repetitions_though_their_phases_begin_a_bin_apart() -> None:
    finding = made_up_finding()
    late = [  # by rounding, the phase of one bin of one trial differs
        dataclasses.replace(r, phase=(r.phase[0], *r.phase[:-1])) if r.trial.endswith("_1") else r
        for r in finding.residuals
    ]
    assert late != list(finding.residuals)
    figures = history_figures(dataclasses.replace(finding, residuals=tuple(late)))
    assert {figure.caption.partition(".")[0] for figure in figures} == {"Mean of 3 trials"}


def test_of_two_commands_at_one_speed_the_last_is_drawn() -> None:
    finding = made_up_finding()
    other = [
        dataclasses.replace(r, command=r.command + 10) if r.trial.endswith("_1") else r
        for r in finding.residuals
    ]
    figures = history_figures(dataclasses.replace(finding, residuals=tuple(other)))
    assert {figure.caption.partition(".")[0] for figure in figures} == {"Mean of 2 trials"}


def test_numbers_far_from_their_files_are_a_doubt_and_ask_for_a_measurement_of_the_soil() -> None:
    far = ("multi_pass.pressure", "a_theta", "cohesion", "accel_x gain")
    means, moved = {"accel_x gain": -0.0123}, {"a_theta": Estimate(0.5, 0.1), "cohesion": Estimate(-0.4, 0.1)}
    finding = dataclasses.replace(made_up_finding(), strained=far, own_means=means, sand=moved)
    found = {a.id: a for a in report_of(finding).answers.questions}
    assert found["trust"].verdict == "With care"
    said = (
        "multi-pass compaction pressure, a_θ (off by 65 %), cohesion c (off by 33 %) and the gain of the "
        "accelerometer (off by 1.2 %)"
    )
    far_off = "are at a bound of the fit, or over 2 std from the file or the usual range."
    assert f"{said} {far_off}" in spaced(found["trust"].text)
    assert found["next"].text.startswith("Measure cohesion c of this soil and write it into its file")
    sand = {"cohesion": Estimate(0.4, 0.1), "exponent": Estimate(0.01, 0.02)}
    table = search_tables.fitted_table(dataclasses.replace(finding, sand=sand))
    assert [row["difference"] for row in rows_of(table)][:2] == [
        "from the file, more than 2 std", "from the file",
    ]  # fmt: skip
    assert "at a bound" not in str(report_of(made_up_finding()).answers.questions)


def test_what_is_left_is_said_with_its_size_and_that_nothing_describes_it() -> None:
    found = {a.id: a.text for a in report_of(made_up_finding()).answers.questions}
    assert "Still beyond the tolerance: " in found["closes"]
    assert "pitch rate (1.10 times)" in found["closes"]
    assert found["missing"].endswith("It is an effect, not a description.")


def test_histories_show_measured_and_both_models(findings: dict[str, Finding]) -> None:
    drawn = next(f for f in history_figures(findings["unknown"]) if f.name == "found_history_0p30").draw()
    axis = next(a for a in drawn.axes if a.texts[0].get_text() == "pitch rate")
    assert axis.get_ylabel() == "[°/s]"
    _, before, after = (x for x in axis.get_lines() if len(np.asarray(x.get_xdata())) > 2)
    t, with_law = (np.asarray(v, dtype=float) for v in after.get_data())
    _, without = (np.asarray(v, dtype=float) for v in before.get_data())
    bump = np.interp(np.mean(BUMP), t, with_law - without)
    assert bump == pytest.approx(np.degrees(3e-3 * STRENGTH * (1 - LEFT)), rel=0.01)


def test_intervals_stand_at_their_seconds(findings: dict[str, Finding]) -> None:
    drawing = intervals_figure(findings["named"])
    panels = [axis for axis in drawing.draw().axes if axis.patches]
    assert len(panels) == 4
    assert [(p.get_x(), p.get_x() + p.get_width()) for p in panels[0].patches] == [BUMP]


def test_a_discrepancy_is_a_share_of_the_rms_in_motion(findings: dict[str, Finding]) -> None:
    # a Gaussian bump of height h and width 0.2 s in a drive of T seconds has an rms of h √(0.2 √(π/2) / T)
    finding = findings["unknown"]
    lengths = [float((r.std > 0).sum() * 0.02) for r in finding.residuals if r.channel == "pitch_rate"]
    expected = STRENGTH / SIZE * math.sqrt(0.2 * math.sqrt(math.pi / 2) / float(np.mean(lengths)))
    shares = search_tables.discrepancies(finding)
    assert shares["pitch_rate"] == pytest.approx((expected, LEFT * expected), rel=0.01)
    assert shares["wheel"] == (0.0, 0.0)
    row = next(r for r in search_tables.gaps_table(finding).rows if r[0].text == "pitch rate")
    assert row[-2].raw == (shares["pitch_rate"][0],)


def test_tables_hold_size_twins_probability_share_and_fate(findings: dict[str, Finding]) -> None:
    finding = findings["named"]
    for table, *expected in (
        (search_tables.effects_table(finding, finding.effects),
         {"effect": "multi-pass compaction", "value ± std": "0.300 ± 0.004",
          "cannot be told from": "slip sinkage",
          "probability": "97 %", "share of the gap": "93.0 ± 2.0 %"}),
        (search_tables.effects_table(finding, finding.small, "small"),
         {"effect": "clock offset", "share of the gap": "2.0 ± 1.0 %"}),
        (search_tables.detectable_table(finding),
         {"candidate": "payload mass", "limited by": "tolerance"},
         {"candidate": "bulldozing", "limited by": "noise"},
         {"candidate": "IMU tilt", "smallest size": "not visible"}),
        (search_tables.confusion_table(finding),
         {"candidate": "multi-pass compaction", "named first": "85 %", "nothing named": "5 %",
          "taken for": "centre-of-mass offset (10 %)"}),
        (search_tables.CANDIDATES.fill(finding.candidates),
         {"candidate": "multi-pass compaction", "probability": "97 %", "closes alone": "93 %",
          "ln Bayes factor, alone [–]": "300", "result": "named"},
         {"candidate": "gear backlash", "result": "ended at a limit (backlash)"},
         {"candidate": "payload mass", "closes alone": "–"}),
    ):  # fmt: skip
        for row in expected:
            assert any(row.items() <= found.items() for found in rows_of(table)), row
    # these trials cannot show it
    assert "clock offset" not in {row["candidate"] for row in rows_of(search_tables.confusion_table(finding))}
    figure = candidates_figure(finding)
    assert re.fullmatch(r"Of \d+ candidates, multi-pass compaction is in the model", figure.title)


def test_sand_and_scales_stand_in_units_of_a_reader(findings: dict[str, Finding]) -> None:
    # a logarithm of 0.010 ± 0.005 is 1.005 ± 0.505 %; a_θ has one value in a report, and it is not this one
    sand = {"a_theta": Estimate(0.02, 0.01), "cohesion": Estimate(0.01, 0.005)}
    table = search_tables.fitted_table(dataclasses.replace(findings["named"], sand=sand))
    assert {row["number"]: row["size"] for row in rows_of(table)} == {
        "c": "1.0 ± 0.5 %",
        "a_θ, from raking to raking": "5.0 %",
        "wheel radius, mean of all": "0.20 %",
        "tilt of the IMU": "0.57 °",
    }


def found(effect_id: str, **values: tuple[float, float]) -> EffectFinding:
    effect = library()[effect_id]
    units = {p.name: p.unit for p in effect.parameters}
    numbers = tuple(FittedParameter(n, units[n], Estimate(*v)) for n, v in values.items())
    closes = Estimate(0.9, 0.02)
    return EffectFinding(effect.id, effect.title, effect.equation, numbers, (), 0.97, closes, closes)


def naming(effect: EffectFinding) -> Finding:
    """Return a finding that names an effect in place of the made-up one."""
    active = activate(library()[effect.id], {p.name: p.estimate.value for p in effect.parameters})
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
def test_a_sign_is_a_direction_and_a_size_has_a_unit_that_fits(effect: EffectFinding, expected: str) -> None:
    assert spaced(names.describe(effect)) == expected


def test_cosine_and_sine_of_each_trial_are_said_as_the_amplitude_they_share() -> None:
    """3 and 4 make 5, and of an error along the larger part most counts."""
    effect = found(
        "encoder_eccentricity", cos_front=(3e-3, 1e-4), sin_front=(4e-3, 1e-4), cos_rear=(0.012, 0.0),
        sin_rear=(0.005, 0.0026),
    )  # fmt: skip
    trials = tuple(dataclasses.replace(p, per_trial=(0.1, 0.2)) for p in effect.parameters)
    assert spaced(names.describe(dataclasses.replace(effect, parameters=trials))) == (
        "eccentric encoder discs (amplitude front 5.00 ± 0.10 mrad, amplitude rear 13.0 ± 1.0 mrad)"
    )
    assert "cos front 3.00 ± 0.10 mrad" in spaced(names.describe(effect))  # the same in all trials


def test_the_table_keeps_sign_and_si_unit_and_says_which_way_it_goes() -> None:
    finding = naming(found("clock_offset", offset=(-0.0035, 0.0001)))
    table = search_tables.effects_table(finding, finding.effects)
    assert spaced(table.rows[0][3].text) == "−3.50 ± 0.10 ms"
    assert table.rows[0][3].raw == (-0.0035, 0.0001, "s")
    assert "below zero: stamps of encoders and currents early" in table.rows[0][2].text


def test_a_number_that_is_zero_has_its_interval_in_the_unit_of_its_std() -> None:
    finding = naming(found("clock_offset", offset=(0.0, 35e-6)))
    table = search_tables.effects_table(finding, finding.effects)
    assert [spaced(cell.text) for cell in table.rows[0][3:5]] == ["0 ± 35 µs", "−69 to 69 µs"]


@pytest.mark.parametrize(
    ("value", "std", "said"),
    [
        (0.004, 0.001, "IMU stamps 4.0 ± 1.0 ms behind those of wheels and currents"),
        (-0.0123, 0.0004, "IMU stamps 12.3 ± 0.4 ms ahead of those of wheels and currents"),
        (math.nan, math.nan, ""),
    ],
)
def test_latency_is_said_with_its_direction(value: float, std: float, said: str) -> None:
    assert spaced(names.latency_in_words(Estimate(value, std))) == said


def test_a_description_stands_as_formulas_and_is_no_cause(findings: dict[str, Finding]) -> None:
    finding = findings["unknown"]
    assert [spaced(f) for f in names.law_formulas(finding)] == [
        "F_x + 4 W · −0.0058 · x/L",
        "k · exp(0.120 · v/√(g r))",
    ]
    answer, report = missing_answer(finding), report_of(finding)
    assert answer.verdict == "Something unknown"
    assert "force along the robot, by distance (−0.0058" in answer.text
    blocks = report.sections[0].blocks
    assert "no cause" in " ".join(block for block in blocks if isinstance(block, str))
    assert list(names.law_formulas(finding)) in blocks
    for figure in report.figures:
        said = [figure.title, figure.caption, *(text for text, _ in texts(figure.draw()))]
        assert "effects found" not in " ".join(said), figure.name


def test_a_model_that_simulates_worse_than_the_paper_s_is_not_said_to_close_anything(
    findings: dict[str, Finding],
) -> None:
    bad = dataclasses.replace(findings["named"], notes=(f"{SIMULATES_WORSE} by the files.",), remainder=1.3)
    answer, found = closes_answer(bad), {a.id: a for a in report_of(bad).answers.questions}
    assert spaced(answer.verdict) == "0 %"
    assert answer.text.startswith(
        f"{SIMULATES_WORSE}. With numbers that each trial has of its own, and no simulation has, the gap"
    )
    assert "predict speeds left out worse" in found["trust"].text
    assert "are predicted better" not in found["trust"].text
    assert "are predicted better" in str(report_of(findings["named"]).answers.questions)


def test_what_is_likely_is_said_with_its_probability_apart_from_what_only_describes(
    findings: dict[str, Finding],
) -> None:
    finding = findings["unknown"]
    (rut,) = findings["named"].effects
    likely = dataclasses.replace(rut, probability=0.84)
    finding = dataclasses.replace(finding, description=(likely, *finding.description))
    answer, report = missing_answer(finding), report_of(finding)
    assert answer.verdict == "Likely multi-pass compaction, but not for certain"
    first, second = answer.text.split(" A description of the rest, not its cause: ")
    assert first.startswith("No effect is sure enough to be named. Likely, but not sure: rear wheels in")
    assert spaced(first).endswith("84 %.")
    assert "force along the robot" in second
    assert "compacted rut" not in second
    titles = [block.title for block in report.sections[0].blocks if isinstance(block, FilledTable)]
    assert {"What is likely, but not certain", "What describes the rest"} <= set(titles)
    unsure = dataclasses.replace(rut, probability=0.3)
    doubtful = missing_answer(dataclasses.replace(finding, description=(unsure,)))
    assert doubtful.verdict == "Something unknown"


def test_waves_of_the_ground_are_named_in_the_answer_and_in_the_next_steps(
    findings: dict[str, Finding],
) -> None:
    wave = GroundWave(Estimate(0.2472, 0.0012), "pitch_rate", "rad/s", 0.036, 1.06, math.nan)
    finding = dataclasses.replace(findings["named"], verdict="partly named", ground_wave=wave)
    answer = missing_answer(finding)
    assert answer.verdict.endswith("and waves of the ground")
    assert "waves of 247.2 ± 1.2 mm: pitch rate repeats with the position" in spaced(answer.text)
    steps = [
        step.text
        for step in names.next_steps(dataclasses.replace(finding, verdict="unknown"), None, "reports/x")
    ]
    assert any("Level the ground" in step for step in steps)
    assert finding_as_json(finding)["ground_wave"]["order"] is None
    assert "count as noise" in closes_answer(finding).text


@pytest.mark.parametrize(
    ("note", "said"),
    [
        ("multi_pass was not evaluated.", "Multi-pass compaction was not evaluated."),
        ("pitch_rate and current_f go together", "Pitch rate and front motor current go together"),
        ("The likeliest (com_offset) is weak.", "The likeliest (centre-of-mass offset) is weak."),
        ("term_force_by_distance is large.", "Force along the robot, by distance is large."),
    ],
)
def test_names_to_type_do_not_stand_in_sentences(note: str, said: str, findings: dict[str, Finding]) -> None:
    assert names.in_plain_words(note, findings["unknown"]) == said


@pytest.mark.parametrize(
    ("finding", "said"),
    [
        (made_up_finding(), "granite-lab simulate --model 'reports/my sand/model.toml' --variant 0.5"),
        (made_up_finding(), "lowers the largest std"),
        (made_up_finding(twins=("slip_sinkage",)), "separates multi-pass compaction from slip sinkage"),
        (naming(found("clock_offset", offset=(0.01, 0.001))),
         "Clock offset is an error of the measurement, not of the model"),
        (dataclasses.replace(made_up_finding(), remainder=0.4), "Part of the gap remains"),
        (made_up_finding("unknown"), "effect of your own"),
        (made_up_finding("none"), "Nothing needs to be added"),
        (made_up_finding(repetitions=1), "Drive two trials or more at each of three speeds"),
    ],
)  # fmt: skip
def test_advice_fits_the_verdict_and_its_commands_can_be_pasted(finding: Finding, said: str) -> None:
    steps = " ".join(map(" ".join, names.next_steps(finding, "model.toml", "reports/my sand")))
    assert said in steps
    assert ("simulate" in steps) is (finding.verdict == "named" and finding.effects[0].id == "multi_pass")


def test_commands_name_the_effect_file_and_a_speed_that_can_be_simulated() -> None:
    finding = dataclasses.replace(made_up_finding(), simulates=(0.2, 0.3))
    steps = " ".join(map(" ".join, names.next_steps(finding, "model.toml", "found", "my effects.py")))
    assert "plan-next found --effects 'my effects.py'" in steps
    assert "simulate --model found/model.toml --effects 'my effects.py' --variant 0.3" in steps
    without = names.next_steps(dataclasses.replace(finding, simulates=()), "model.toml", "found")
    assert "simulate" not in " ".join(map(" ".join, without))


def test_the_ceiling_is_said_with_its_place_and_stands_in_the_table_and_the_document() -> None:
    push = Push("force", "N", "brake", 0.7, 3.3, 4.2, -3.7)
    most = Ceiling(0.41, 0.62, {"force": 0.4, "lift": 0.0}, {"accel_x": 0.05}, (push,))
    finding = dataclasses.replace(made_up_finding("unknown"), ceiling=most)
    said = spaced(search_tables.ceiling_in_words(finding))
    assert "leaves 62 % of the gap" in said
    assert "close 41 % of the gap" in said
    assert "force along the robot, from 3.30 to 4.20 s at 0.7 m/s (while braking)." in said
    table = search_tables.ceiling_table(finding)
    assert table is not None
    assert len(table.rows) == 6
    document = finding_as_json(finding)["ceiling"]
    assert (document["value"], document["left"], document["parts"]["force"]) == (0.41, 0.62, 0.4)
    assert document["where"][0]["variant_mps"] == 0.7
    nothing = made_up_finding()
    assert search_tables.ceiling_table(nothing) is None
    assert search_tables.ceiling_in_words(nothing).startswith("Nothing remains")
    assert finding_as_json(nothing)["ceiling"] is None
