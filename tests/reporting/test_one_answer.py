"""All outputs of one study say the same: page, Markdown, PDF, JSON, CSV, LaTeX, figures, terminal."""

import csv
import dataclasses
import html
import io
import json
import math
import re
from pathlib import Path

import pytest
from pypdf import PdfReader
from rich.console import Console

from granite_lab.discovery.finding import Finding
from granite_lab.estimate import Estimate
from granite_lab.parameters import load_paper
from granite_lab.reporting import answers as decide
from granite_lab.reporting.channels import SENSORS_OF, judged_channels
from granite_lab.reporting.json_report import to_json
from granite_lab.reporting.latex import escaped
from granite_lab.reporting.names import describe, plain
from granite_lab.reporting.plot_motion import comparison_figure
from granite_lab.reporting.report import study_report
from granite_lab.reporting.terminal import show_study
from granite_lab.results import StudyResult, of_search, pooled_misfits, warnings_of
from tests.reporting.made_up_finding import made_up_finding


def squeezed(text: str) -> str:
    """Return a text without spaces, marks of Markdown and low letters, which renderers set alone."""
    return re.sub(r"[\s\\_*]", "", text.replace("₉₂", "92"))


@pytest.fixture(scope="module")
def outputs(twelve: StudyResult, twelve_folder: Path) -> dict[str, str]:
    page = (twelve_folder / "index.html").read_text(encoding="utf-8")
    page = re.sub(r"<(style|script|svg).*?</\1>", "", page, flags=re.S)
    console = Console(file=io.StringIO(), width=80, highlight=False)
    show_study(twelve, console, twelve_folder.name, "model.toml")
    return {
        "page": html.unescape(re.sub(r"<[^>]+>", "", page)),
        "markdown": html.unescape((twelve_folder / "report.md").read_text(encoding="utf-8")),
        "PDF": "".join(p.extract_text() for p in PdfReader(twelve_folder / "report.pdf").pages),
        "terminal": console.file.getvalue(),
    }


def test_each_answer_has_one_wording(
    twelve: StudyResult, twelve_folder: Path, outputs: dict[str, str]
) -> None:
    decided = decide.of_study(twelve, "model.toml", twelve_folder.name)
    assert [q.id for q in decided.questions] == [
        "slip", "a_theta", "model", "missing", "closes", "trust", "next",
    ]  # fmt: skip
    told = json.loads((twelve_folder / "report.json").read_text(encoding="utf-8"))["answers"]
    for answer, written in zip(decided.questions, told["questions"], strict=True):
        assert (written["verdict"] or "", written["text"]) == (answer.verdict, answer.text)
        for name, text in outputs.items():
            for part in (answer.verdict, answer.text):
                assert squeezed(part) in squeezed(text), (name, part)


def test_each_number_is_the_same_in_every_output(
    twelve: StudyResult, twelve_folder: Path, outputs: dict[str, str]
) -> None:
    decided = decide.of_study(twelve)
    told = json.loads((twelve_folder / "report.json").read_text(encoding="utf-8"))["answers"]
    for speed, written in zip(decided.speeds, told["speeds"], strict=True):
        assert written["slip"]["value"] == float(speed.slip.text)
        ends = [f"{x:.{speed.slip.decimals}f}" for x in written["slip"]["ci95"]]
        assert ends == speed.slip.interval.split(" to ")
        for name, text in outputs.items():
            for shown in (speed.slip.text, speed.slip.interval, speed.k92.with_std):
                assert squeezed(shown) in squeezed(text), name
    assert told["a_theta"]["value"] == 4.93
    for name, text in outputs.items():
        assert set(re.findall(r"aθ=([\d.]+)", squeezed(text))) == {"4.93"}, name


@pytest.mark.parametrize("verdict", ["none", "named", "unknown"])
def test_a_study_and_its_search_alone_agree(twelve: StudyResult, verdict: str, tmp_path: Path) -> None:
    finding = made_up_finding(verdict, twins=("slip_sinkage",))
    finding = dataclasses.replace(finding, origin=dataclasses.replace(finding.origin, source=twelve.source))
    both = [dataclasses.replace(twelve, finding=finding), of_search(finding, tmp_path)]
    whole, alone = ({a.id: a for a in decide.of_study(r).questions} for r in both)
    for id_ in ("model", "missing", "closes"):
        assert whole[id_].question == alone[id_].question
        assert whole[id_].verdict.partition(",")[0] == alone[id_].verdict.partition(",")[0], id_


@pytest.mark.parametrize("virtual", [True, False])
def test_a_search_alone_is_virtual_where_its_logs_are_and_says_so_wherever_it_is_shown(
    twelve: StudyResult, virtual: bool, tmp_path: Path
) -> None:
    finding = made_up_finding(virtual=virtual)
    finding = dataclasses.replace(finding, origin=dataclasses.replace(finding.origin, source=twelve.source))
    alone = of_search(finding, tmp_path)
    report = study_report(alone)
    document = json.loads(to_json(alone, report))
    assert (", virtual" in repr(alone)) is virtual
    assert document["virtual"] is document["discovery"]["virtual"] is virtual
    assert (document["answers"]["virtual"] is not None) is virtual


SCALES = (1.0, 1e2, 1e3, 1e6, math.degrees(1.0))
"""From the unit of a record to a printed one: itself, percent, thousandths, millionths, degrees."""


def printed_number(text: str) -> tuple[float, float] | None:
    """Return the number with which a text begins, and half of its last digit that is no placeholder."""
    found = re.match(r"\(?(−?\d+(?:\.(\d+))?)(?: ± [\d.]+\))?(?:·10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?", text)
    if found is None:
        return None
    power = 10.0 ** int((found[3] or "0").translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))
    zeros = 0 if found[2] else len(found[1]) - len(found[1].rstrip("0"))
    return float(found[1].replace("−", "-")) * power, 0.501 * 10.0 ** (zeros - len(found[2] or "")) * power


def test_each_table_says_the_same_in_every_format(twelve: StudyResult, twelve_folder: Path) -> None:
    page = (twelve_folder / "index.html").read_text(encoding="utf-8")
    markdown = (twelve_folder / "report.md").read_text(encoding="utf-8")
    tables = study_report(twelve, model="model.toml", folder="twelve").tables
    assert len(tables) > 10
    numbers = 0
    for table in tables:
        shown = [[squeezed(cell.text) for cell in row] for row in table.rows]
        here = page[page.index(f'id="table-{table.name}"') :].partition("</tbody>")[0].partition("<tbody>")[2]
        cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in here.split("</tr>")[:-1]]
        assert [[squeezed(html.unescape(re.sub("<[^>]+>", "", c))) for c in row] for row in cells] == shown
        assert squeezed(table.note) in squeezed(html.unescape(re.sub("<[^>]+>", "", page)))
        lines = {squeezed(html.unescape(line)) for line in markdown.splitlines() if line.startswith("| ")}
        assert {squeezed(html.unescape(f"|{'|'.join(row)}|")) for row in shown} <= lines
        latex = (twelve_folder / "tables" / f"{table.name}.tex").read_text(encoding="utf-8")
        texts = {squeezed(c) for c in cells_of_latex(latex)}
        assert {squeezed(escaped(cell.text)) for row in table.rows for cell in row} <= texts, table.name
        with (twelve_folder / "tables" / f"{table.name}.csv").open(encoding="utf-8") as file:
            plain_rows = list(csv.DictReader(file))
        for row, values in zip(table.rows, plain_rows, strict=True):
            for column, cell in zip(table.columns, row, strict=True):
                number, text = printed_number(cell.text), values[column.keys[0]]
                if column.number and number is not None and re.fullmatch(r"-?[\d.]+(e[-+]\d+)?", text):
                    value, half = number
                    assert any(abs(float(text) * k - value) <= half for k in SCALES), (table.name, cell)
                    numbers += 1
    assert numbers > 300


def cells_of_latex(text: str) -> list[str]:
    """Return the cells of a table in LaTeX, without what only breaks lines."""
    text = text.replace(r"\raggedright ", "").replace(r"\allowbreak{}", "")
    return [c for row in re.findall(r"(.*)\\tabularnewline", text) for c in re.split(r"(?<!\\)&", row)]


def test_numbers_of_the_document_are_those_of_the_tables(twelve: StudyResult, twelve_folder: Path) -> None:
    document = json.loads((twelve_folder / "report.json").read_text(encoding="utf-8"))

    def column(table: str, name: str) -> list[float]:
        with (twelve_folder / "tables" / f"{table}.csv").open(encoding="utf-8") as file:
            return [float(row[name] or "nan") for row in csv.DictReader(file) if row[name] != ""]

    trials, speeds, finding = document["trials"], document["answers"]["speeds"], document["discovery"]
    pairs = {
        ("trials", "slip_ratio"): [t["slip_ratio"]["value"] for t in trials],
        ("trials", "distance_m"): [t["distance_m"]["value"] for t in trials],
        ("trials", "k92_std"): [t["k92"]["std"] for t in trials],
        ("trials", "k92_trajectory"): [t["k92_trajectory"]["value"] for t in trials],
        ("trials", "warnings"): [len(t["warnings"]) for t in trials],
        ("slip_by_speed", "slip_ratio"): [s["slip"]["value"] / 100 for s in speeds],
        ("slip_by_speed", "k92"): [s["k92"]["value"] for s in speeds],
        ("misfits", "rms_si"): [m["rms"] for m in document["misfits"]],
        ("channels", "rms"): [c["rms"] for c in document["answers"]["channels"]],
        ("found_effects", "value"): [
            p["value"] for e in finding["effects"] for p in e["parameters"].values()
        ],
        ("found_gaps", "train_after"): [
            finding["gap"]["train"]["after"], *(c["train"]["after"] for c in finding["channels"].values())
        ],
    }  # fmt: skip
    for (table, name), values in pairs.items():
        assert column(table, name) == pytest.approx(values, rel=1e-8), (table, name)


def differing(finding: Finding) -> set[str]:
    return {g.channel for g in finding.gaps if g.train[0] > 1.0}


def test_no_quantity_agrees_in_which_the_search_sees_a_difference(twelve: StudyResult) -> None:
    finding = made_up_finding("named")
    judged = {c.channel: c for c in judged_channels(pooled_misfits(twelve.trials), finding)}
    alone = {c.channel: c for c in judged_channels(pooled_misfits(twelve.trials))}
    for channel, sensors in SENSORS_OF.items():
        if differing(finding).intersection(sensors):
            assert judged[channel].verdict != "agrees"
    assert any(alone[c].verdict == "agrees" != judged[c].verdict for c in SENSORS_OF)


def test_candidates_and_terms_are_counted_and_named_alike(twelve: StudyResult, twelve_folder: Path) -> None:
    finding = twelve.finding
    assert finding is not None
    with (twelve_folder / "tables" / "found_candidates.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    figures = {f.name: f for f in study_report(twelve).figures}
    count = len(rows)
    assert f"Of {count} candidates" in figures["found_candidates"].title
    assert f"{count} candidates)" in repr(finding)
    drawn = squeezed(html.unescape((twelve_folder / "figures" / "found_candidates.svg").read_text("utf-8")))
    for row in rows:
        for word in row["candidate"].split():
            assert squeezed(word) in drawn
    with (twelve_folder / "tables" / "found_effects.csv").open(encoding="utf-8") as file:
        assert {r["effect"] for r in csv.DictReader(file) if r["effect"]} == {
            plain(e.id) for e in finding.effects
        }
    card = next(a for a in decide.of_study(twelve).questions if a.id == "missing")
    assert all(describe(e).lower() in card.text.lower() for e in finding.effects)


def test_repetitions_of_a_command_have_one_verdict(twelve: StudyResult) -> None:
    like = [r for r in twelve.trials if r.motion.variant.velocity == 0.5]
    titles = [comparison_figure(c, k, like).title.partition(": ")[2] for k, c in enumerate(like)]
    assert len(like) == 3
    assert len(set(titles)) == 1


def with_fit(result: StudyResult, **changes: object) -> StudyResult:
    first = result.trials[0]
    fit = dataclasses.replace(first.fit, **changes)
    changed = dataclasses.replace(first, fit=fit)
    return dataclasses.replace(result, trials=(changed, *result.trials[1:]))


def test_a_fit_that_did_not_converge_has_no_std_and_a_warning(study: StudyResult) -> None:
    value = study.trials[0].fit.k92_trajectory.value
    result = with_fit(study, status_trajectory="not_converged", k92_trajectory=Estimate(value))
    (line,) = set(warnings_of(result.trials[0])) - set(warnings_of(study.trials[0]))
    assert "did not converge" in line
    report = study_report(result)
    row = next(t for t in report.tables if t.name == "trials").rows[0]
    cell = next(c for c in row if "not converged" in c.text)
    assert "±" not in cell.text
    assert math.isnan(cell.raw[1])
    assert row[-1].text == str(len(warnings_of(result.trials[0])))
    (section,) = (s for s in report.sections if s.id == "trials")
    assert any(line in text for block in section.blocks if isinstance(block, list) for text in block)


def test_two_k92_that_exclude_each_other_are_told(study: StudyResult) -> None:
    fit = study.trials[0].fit
    assert fit.apart < 3
    apart = with_fit(study, k92_trajectory=Estimate(fit.k92.value + 0.1, fit.k92.std))
    assert apart.trials[0].fit.apart == pytest.approx(0.1 / math.hypot(*[fit.k92.std] * 2))
    assert any("does not explain both" in line for line in warnings_of(apart.trials[0]))


def test_a_law_of_trials_that_do_not_show_its_sign_is_not_known(twelve: StudyResult) -> None:
    fit = twelve.a_theta
    assert fit is not None
    vague = dataclasses.replace(fit, a_theta=Estimate(2.4, 4.7), ci95=(-6.9, 11.7))
    answer = decide.law_answer(vague)
    assert answer.verdict == "Not known"
    assert "do not show that k_92 falls" in answer.text
    assert decide.a_theta_of(vague)[1] is None


def test_a_law_that_agrees_says_which_k92_do_not(twelve: StudyResult) -> None:
    fit = twelve.a_theta
    assert fit is not None
    paper = {p.velocity: p.k92 for p in load_paper().table3}
    near = tuple((n, v, Estimate(paper[v], 0.002), s) for n, v, _, s in fit.points)
    assert decide.law_answer(dataclasses.replace(fit, points=near)).verdict == "Yes"
    sharp = tuple((n, v, Estimate(k.value - 0.02 * (v == 0.5), k.std), s) for n, v, k, s in near)
    answer = decide.law_answer(dataclasses.replace(fit, points=sharp))
    assert answer.verdict == "Yes, but not k_92 at 0.5 m/s"
    assert "lies 17 std from the paper's" in answer.text  # 0.02 over 0.002/√3
    assert answer.tone == "fair"
