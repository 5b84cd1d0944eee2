"""From a study to a report: which answers, tables and figures stand where."""

from __future__ import annotations

from collections.abc import Sequence

from granite_lab.parameters import Paper, load_paper
from granite_lab.reporting import (
    answers,
    plot_laws,
    plot_motion,
    plot_quality,
    plot_slip,
    quality_tables,
    study_tables,
)
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.document import Block, Discovery, Fold, Gallery, Listing, Report, Section, Words
from granite_lab.reporting.provenance import provenance_section
from granite_lab.reporting.rounding import plus_minus, significant
from granite_lab.reporting.summary import Gap, Speed, by_speed, gaps


def assemble(result: StudyResult, discovery: Discovery | None = None) -> Report:
    """Lay out the report of a study.

    Args:
        result: the study.
        discovery: what a search for a missing effect found; without it the report says that none was run.
    """
    paper = load_paper()
    speeds = by_speed(result, paper)
    found = gaps([r.comparison for r in result.trials])
    brief = gaps([r.comparison for r in result.trials], wheels_as_one=True)
    missing = discovery.answer if discovery else answers.missing_answer(brief, result.unsearched)
    lacking = discovery is not None and discovery.data.get("verdict") != "none"
    sections = [
        _slip(result, speeds, paper),
        _law(result, speeds, paper),
        _motion(speeds),
        _misfit(result, found),
        *([discovery.section] if discovery else []),
        _trials(result),
        _health(result),
        provenance_section(result.source),
        _warnings(result),
    ]
    return Report(
        name=result.name,
        lead=answers.lead(result, speeds),
        virtual=answers.virtual_note(result),
        answers=(
            answers.slip_answer(speeds), answers.law_answer(result.a_theta, lacking=lacking),
            answers.model_answer(brief),
            missing,
        ),
        first_page=_first_page(result, speeds, paper, brief),
        sections=tuple(s for s in sections if s is not None),
        version=result.source.version,
        command=result.source.command,
    )  # fmt: skip


def _first_page(
    result: StudyResult, speeds: Sequence[Speed], paper: Paper, found: dict[tuple[str, str], Gap]
) -> tuple[Block, ...]:
    if not result.trials:
        return ()
    drawings = (
        plot_slip.slip_drawing(speeds, paper, result.virtual),
        plot_laws.k92_over_velocity(result, speeds, paper),
    )
    return (
        study_tables.slip_table(speeds),
        Gallery(drawings),
        quality_tables.channel_table(found, result.virtual),
    )


def _slip(result: StudyResult, speeds: Sequence[Speed], paper: Paper) -> Section | None:
    if not result.trials:
        return None
    note = (
        "The 95 % interval of a mean is the wider of two: from the scatter between the trials (Student's "
        "t) and "
        "from their stated standard deviations. λ_R is taken by (2) over the steady part of the motion."
    )
    return Section(
        "table3", "Slip and k_92 beside the paper", (study_tables.table3(speeds, paper), Words(note))
    )


def _law(result: StudyResult, speeds: Sequence[Speed], paper: Paper) -> Section | None:
    if not result.trials:
        return None
    blocks: list[Block] = []
    fit = result.a_theta
    if fit is not None:
        blocks.append(
            Words(
                f"Weighted, with trial-to-trial scatter: a_θ = {plus_minus(fit.a_theta, 's/m')}. The "
                f"paper's way (least squares "
                f"on log k_92 through k_92 = 1 at rest): {significant(fit.log_linear, 4)} s/m; least "
                f"squares on k_92 itself: "
                f"{significant(fit.ordinary, 4)} s/m. Trials scatter by "
                f"{significant(100 * fit.scatter, 2)} % in k_92 beyond "
                "their stated uncertainties."
            )
        )
    blocks.append(Gallery((plot_laws.k92_over_slip(result, speeds, paper),)))
    if fit is not None and fit.laws:
        blocks.append(study_tables.law_table(fit))
    if fit is not None and fit.notes:
        blocks.append(Listing(fit.notes))
    return Section("laws", "The law of k_92", tuple(blocks))


def _motion(speeds: Sequence[Speed]) -> Section | None:
    if not speeds:
        return None
    blocks: list[Block] = [
        Words(
            "One trial per speed, the middle one by slip; the differences show all trials. Blue is "
            "measured, orange is "
            "simulated; front axle and body are dark, rear axle and wheels light. Bands are ±2σ; the grey "
            "part is the "
            "steady part over which λ_R is taken. Measured slip is drawn where its standard deviation is "
            "below 10 points."
        )
    ]
    for speed in speeds:
        blocks.append(Gallery(tuple(plot_motion.motion_drawings(speed)), f"{speed.velocity:g} m/s"))
    return Section("motion", "Motion, measured and simulated", tuple(blocks))


def _misfit(result: StudyResult, found: dict[tuple[str, str], Gap]) -> Section | None:
    drawing = plot_quality.misfit_drawing(found, result.virtual)
    if drawing is None:
        return None
    note = (
        "k_92 was fitted to each trial, everything else is as the parameter files say: sand that differs "
        "from trial "
        "to trial, or from its file, counts as misfit. Noise is the standard deviation of the measurement."
    )
    return Section(
        "misfits", "Where the model and the trials differ",
        (Gallery((drawing,)), Words(note),
        Fold("All channels and phases", (quality_tables.misfit_table(found, result.virtual),))),
    )  # fmt: skip


def _trials(result: StudyResult) -> Section | None:
    return Section("trials", "Trials", (study_tables.trial_table(result),)) if result.trials else None


def _health(result: StudyResult) -> Section | None:
    if not result.trials:
        return None
    note = (
        "Innovations are what a measurement update found beyond its prediction, in units of the predicted "
        "standard "
        "deviation. Grey stretches are rests, in which the zero-velocity updates act."
    )
    folds = []
    for i, r in enumerate(result.trials, 1):
        motion = r.comparison.motion
        folds.append(
            Fold(
                f"{r.trial.name}: {'good' if motion.health.good else 'doubtful'}",
                (Gallery((plot_quality.health_drawing(motion, i),)),),
                open=not motion.health.good,
            )
        )
    return Section(
        "health", "Health of the estimates", (quality_tables.health_table(result), Words(note), *folds)
    )


def _warnings(result: StudyResult) -> Section:
    failures = [
        f"{f.trial} could not be used: {f.message}" + (f" ({f.hint})" if f.hint else "")
        for f in result.failures
    ]
    doubts = _shared(
        [(r.trial.name, (*r.trial.warnings, *r.comparison.motion.warnings)) for r in result.trials]
    )
    notes = _shared([(r.trial.name, r.comparison.fit.notes) for r in result.trials])
    blocks: list[Block] = []
    if failures:
        blocks += [Words("Trials that failed:"), Listing(tuple(failures))]
    if doubts:
        blocks += [Words("Doubts of the reader and the estimator:"), Listing(doubts)]
    if notes:
        blocks.append(Fold("Notes of the fits", (Listing(notes),)))
    return Section("warnings", "Warnings and failures", tuple(blocks) or (Words("None."),))


def _shared(lines: Sequence[tuple[str, Sequence[str]]]) -> tuple[str, ...]:
    """Say once what several trials say alike."""
    speakers: dict[str, list[str]] = {}
    for trial, said in lines:
        for line in dict.fromkeys(said):
            speakers.setdefault(line, []).append(trial)
    everybody = len(lines)
    return tuple(
        f"all {everybody} trials: {line}"
        if everybody > 1 and len(trials) == everybody
        else f"{', '.join(trials)}: {line}"
        for line, trials in speakers.items()
    )
