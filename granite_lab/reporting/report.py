"""A report as data: the answers, figures and tables of a study or a search, in their order."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from granite_lab.columns import FilledTable
from granite_lab.discovery.finding import Finding
from granite_lab.fitting.fit import views_of
from granite_lab.origin import Source
from granite_lab.reporting import plot_motion, plot_results, plot_search, search_tables, tables
from granite_lab.reporting.answers import Answers, all_good, of_study
from granite_lab.reporting.canvas import Figure
from granite_lab.reporting.channels import CHANNEL_TABLE, MISFITS
from granite_lab.reporting.names import (
    LINES,
    Step,
    in_plain_words,
    latency_in_words,
    law_formulas,
    lines_link,
    pasted,
    saved_model,
    shared,
)
from granite_lab.results import StudyResult, pooled_misfits, recordings_of, warnings_of
from granite_lab.rounding import percent

OPEN_SPEEDS = 4
"""Largest number of time histories that are shown open; of more speeds only the slowest and fastest are."""

LONGEST = 1000
"""Largest number of characters of a command that are shown: one that names each log may be very long."""

MODEL = (
    "Blue: measured; orange: simulated, with k_92 fitted to the slip of the trial and all else from the "
    "parameter files. Below each: their difference. Grey: the steady part of the motion, over which λ_R is "
    "taken. Bands: ±2σ of the measurement. Triangles: a spike leaves the panel."
)
LAW = (
    "These terms describe the disagreement; they are no cause and hold for trials like these only. W: load "
    "of a wheel at rest; λ: slip ratio of the wheel; z: its sinkage; θ: its angle; r: its radius; T: torque "
    "that drives it; v: speed of the robot; x: distance; x_w: place of the wheel; L: wheel base; M: torque "
    "of the ground."
)
MODEL_MISFIT = (
    "Where the model does not fit the sensors over the trajectory, an effect that it lacks moves k_92 by the "
    "trajectory, and no std is stated. k_92 by the steady slip does not depend on the other sensors."
)
"""How to read the time histories, the formulas of a description, and k_92 where the model does not fit."""

LIBRARIES = ("numpy", "scipy", "casadi", "matplotlib")


@dataclass(frozen=True)
class Code:
    """A command that can be copied."""

    text: str


@dataclass(frozen=True)
class Link:
    """A file beside the page."""

    text: str
    address: str


@dataclass(frozen=True)
class Looks:
    """Each trial with its name, its page of lines, and the command that shows its recording, if any."""

    rows: tuple[tuple[str, str, str], ...]


@dataclass(frozen=True)
class Gallery:
    """Figures that belong together; two beside each other where there is room."""

    figures: tuple[Figure, ...]


@dataclass(frozen=True)
class Fold:
    """Content that a reader opens when wanted; closed at first; in print left out unless `printed`."""

    title: str
    blocks: tuple[Block, ...]
    printed: bool = False


Block = str | list[str] | Code | Looks | Gallery | FilledTable | Fold
"""A part of a page; a text is a paragraph, a list of texts a list of sentences."""


@dataclass(frozen=True)
class Section:
    """A part of the report below the first screen."""

    id: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Report:
    """A whole report.

    Attributes:
        name: of the study.
        kind: what the page is, with its date.
        answers: the first screen, with the table beside it.
        sections: the evidence.
        numbers: name of the file with all numbers.
        files: beside the page.
    """

    name: str
    kind: str
    answers: Answers
    sections: tuple[Section, ...]
    numbers: str
    files: tuple[Link, ...]

    @property
    def has_lines(self) -> bool:
        """Whether there is a page of all lines beside it."""
        return any(file.address == LINES for file in self.files)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All figures in the order of the report."""
        every = [b for s in self.sections for b in _flat(s.blocks)]
        return tuple(f for block in every if isinstance(block, Gallery) for f in block.figures)

    @property
    def tables(self) -> tuple[FilledTable, ...]:
        """All tables in the order of the report."""
        every = [self.answers.table, *(b for s in self.sections for b in _flat(s.blocks))]
        return tuple(block for block in every if isinstance(block, FilledTable))


def _flat(blocks: Iterable[Block]) -> Iterator[Block]:
    for block in blocks:
        yield block
        if isinstance(block, Fold):
            yield from _flat(block.blocks)


Maybe = Block | None


def _filled(blocks: Iterable[Maybe]) -> tuple[Block, ...]:
    """Return the blocks that hold something."""
    return tuple(block for block in blocks if block)


def _fold(title: str, *blocks: Maybe, printed: bool = False) -> Fold | None:
    return Fold(title, _filled(blocks), printed) if any(blocks) else None


def _gallery(*figures: Figure | None) -> Gallery | None:
    there = tuple(f for f in figures if f is not None)
    return Gallery(there) if there else None


def study_report(
    result: StudyResult, *, model: Path | str | None = None, folder: str = "", recordings: str = ""
) -> Report:
    """Lay out the report of a study, or of a search alone, which is a study without trials.

    `model` and `folder` are named in commands; `recordings` is the folder of the recordings beside the page,
    empty where there is none.
    """
    answers = of_study(result, model, folder)
    sections = []
    if result.trials:
        title = "Slip" if answers.slip_unknown else "Slip and k_92"
        sections = [Section("slip", title, _filled(_slip(result, answers)))]
        if not answers.slip_unknown:
            sections.append(Section("model", "Model and measurement", _filled(_model(result, answers))))
    if result.finding is not None:
        sections.append(Section("missing", "What is missing", _filled(_missing(result.finding))))
    numbers, kind, pages = "finding.json", "search for a missing effect", {}
    if result.trials:
        numbers, kind, pages = "report.json", "study", {"explore": LINES, "PDF": "report.pdf"}
        looks, finding = _looks(result, folder, recordings), result.finding
        options = ""
        if model and finding is not None and finding.simulates:
            effects = dict(result.source.options).get("effects", "")
            options = saved_model(model, folder or result.name, effects)
        quality = _quality(result, answers, looks, options)
        sections.append(Section("trials", "Quality of the trials", _filled(quality)))
    sections.append(_provenance(result.source, answers.steps[1:]))
    addresses = pages | {
        "Markdown": "report.md", "JSON": numbers, "recordings": f"{recordings}/" if recordings else "",
        "tables": "tables/", "figures": "figures/",
    }  # fmt: skip
    files = tuple(Link(text, address) for text, address in addresses.items() if address)
    return Report(result.name, f"Report of a {kind}, {today()}", answers, tuple(sections), numbers, files)


def _slip(result: StudyResult, answers: Answers) -> Iterator[Maybe]:
    """Show slip and k_92 by speed; the slip alone where it is not known well enough for k_92."""
    fit = result.a_theta
    if answers.slip_unknown:
        yield (
            "No slip ratio is known to 5 points. So k_92, the comparison with the model and the search for a "
            "missing effect are left out."
        )
        yield _gallery(plot_results.slip_figure(answers))
        return
    yield _gallery(plot_results.slip_figure(answers), plot_results.k92_figure(answers, fit))
    if result.finding is None and fit is not None:
        yield tables.A_THETA.fill(views_of(fit), virtual=bool(answers.virtual))
    yield _fold(
        "k_92 over slip, and laws compared",
        _gallery(plot_results.k92_over_slip(answers, fit)),
        tables.law_table(fit, bool(answers.virtual)) if fit else None,
        list(fit.notes) if fit else None,
    )
    yield _fold("Uncertainty budgets", *tables.budget_tables(result, answers.speeds))


def _model(result: StudyResult, answers: Answers) -> Iterator[Maybe]:
    virtual, misfits = bool(answers.virtual), pooled_misfits(result.trials)
    drawn = [plot_motion.motion_figure(s) for s in answers.speeds]
    half = OPEN_SPEEDS // 2
    rest = drawn[half:-half] if len(drawn) > OPEN_SPEEDS else []
    shown: list[Figure | None] = [f for f in drawn if f not in rest]
    yield MODEL
    yield _gallery(*shown)
    yield CHANNEL_TABLE.fill(answers.channels, virtual=virtual)
    yield _fold(
        "Differences by phase",
        _gallery(*rest), MISFITS.fill(misfits.values(), virtual=virtual),
    )  # fmt: skip


def _missing(finding: Finding) -> Iterator[Maybe]:
    yield (
        "The model is fitted to all sensors. The sand of each trial, the time offset of the IMU, and offsets "
        "and gains of the sensors are fitted too, so that an error of these is not taken for an effect. The "
        "difference that remains in all repetitions of a command is compared with the signature of each "
        f"candidate effect. Differences up to {percent(finding.tolerance)} of a sensor's rms are tolerated."
    )
    yield _gallery(plot_search.gap_figure(finding), plot_search.intervals_figure(finding))
    yield search_tables.effects_table(finding, finding.effects)
    yield tables.A_THETA.fill(finding.a_theta, virtual=finding.virtual) if finding.a_theta else None
    if finding.likely:
        yield "These effects act rather than not, but are not sure enough to be named."
        yield search_tables.effects_table(finding, finding.likely, "likely")
    if finding.causeless:
        yield (
            "These terms describe the rest. They predict trials that were left out of the fit, but their "
            "cause is not known."
        )
        yield search_tables.effects_table(finding, finding.causeless, "described")
    formulas = law_formulas(finding)
    yield LAW if formulas else None
    yield list(formulas)
    yield search_tables.ceiling_in_words(finding) or None
    yield search_tables.ceiling_table(finding)
    latency = latency_in_words(finding.latency)
    yield [
        *(in_plain_words(note, finding) for note in (*finding.provisional, *finding.notes)),
        *(f"{trial} is in no fit: {reason}" for trial, reason in finding.dropped),
        *([f"{latency}."] if latency else ()),
        *finding.failures,
    ]
    yield _fold(
        "When the model disagrees, sensor by sensor",
        _gallery(*plot_search.history_figures(finding)),
        search_tables.gaps_table(finding),
    )
    yield _fold("Prediction of trials and speeds left out of the fit", search_tables.left_out_table(finding))
    yield _fold(
        "Candidates, and what these trials could have shown of them",
        _gallery(plot_search.candidates_figure(finding)),
        search_tables.CANDIDATES.fill(finding.candidates, virtual=finding.virtual),
        search_tables.effects_table(finding, finding.small, "small"),
        search_tables.detectable_table(finding),
        search_tables.confusion_table(finding),
    )
    yield _fold("Sand and sensors, as fitted", search_tables.fitted_table(finding))


def _looks(result: StudyResult, folder: str, recordings: str) -> Looks:
    """Return name, page of lines and command of the recording of each trial."""
    names = recordings_of(result)
    place = f"{folder or result.name}/{recordings}"
    commands = [f"granite-lab view {pasted(f'{place}/{name}')}" if recordings else "" for name in names]
    trials = [r.trial.name for r in result.trials]
    return Looks(tuple(zip(trials, map(lines_link, trials), commands, strict=True)))


def _quality(result: StudyResult, answers: Answers, looks: Looks, model: str) -> Iterator[Maybe]:
    """Show how far each trial can be trusted; `model`: options of a command, as `saved_model`."""
    n = len(result.trials)
    doubtful = [r for r in result.trials if not r.motion.health.good]
    text = all_good(n)
    if doubtful:
        text = f"{n - len(doubtful)} of {n} motion estimates are good. Exceptions:"
    yield (
        f"{text} An estimate is good if a standstill, or wheels that come to rest, fixes the velocity at "
        "both ends, and if the residuals agree with the noise."
    )
    yield [f"{r.trial.name}: {r.motion.health.verdict}" for r in doubtful]
    yield "Trials that were left out:" if result.failures else None
    yield [f"{f.trial}: {f.message}" + (f" ({f.hint})" if f.hint else "") for f in result.failures]
    warnings = shared([(r.trial.name, warnings_of(r)) for r in result.trials])
    yield "Warnings:" if warnings else None
    yield list(warnings)
    if any(r.fit.status_trajectory == "model_misfit" for r in result.trials):
        yield MODEL_MISFIT
        yield "With what was found, the fits are made again by:" if model else None
        yield Code(f"granite-lab fit-k92 TRIALS {model}") if model else None
    yield _fold("Results of each trial", tables.trial_table(result), printed=True)
    yield _fold("Look at each trial", looks)
    typical = [s.typical for s in answers.speeds]
    checked = [r for r in result.trials if r in typical or r in doubtful]
    checks = [plot_motion.health_figure(r.motion, k) for k, r in enumerate(checked, 1)]
    yield _fold(
        "Checks of the estimates: the typical trial of each speed, and doubtful ones", _gallery(*checks)
    )


def _provenance(source: Source, steps: Sequence[Step]) -> Section:
    command = source.command
    if len(command) > LONGEST:
        command = f"{command[: LONGEST // 2]} … {command[-LONGEST // 2 :]} (shortened)"
    blocks = (
        *(part for s in steps for part in (s.text, Code(s.command) if s.command else None)),
        f"Made by {made_by(source)}. This command repeats it:",
        Code(command),
        _fold("Parameters in force", tables.PARAMETERS.fill(source.parameters)),
        _fold("Files that were read", tables.INPUTS.fill(source.inputs)),
    )
    title = "Further steps, and how to repeat this" if steps else "How to repeat this"
    return Section("provenance", title, _filled(blocks))


def today() -> str:
    """Return the date of today, ISO 8601, which SOURCE_DATE_EPOCH overrides."""
    return time.strftime("%Y-%m-%d", time.gmtime(int(os.environ.get("SOURCE_DATE_EPOCH", time.time()))))


def made_by(source: Source) -> str:
    """Return version, code, libraries and the date of today."""
    code = f" (code {source.code[:8]})" if source.code else ""
    libraries = ", ".join(f"{name} {metadata.version(name)}" for name in LIBRARIES)
    return f"granite-lab {source.version}{code} on {today()}, Python {platform.python_version()}, {libraries}"
