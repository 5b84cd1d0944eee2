"""A discovery as a report of its own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from granite_lab.discovery.finding import Finding
from granite_lab.model.effect import Effect
from granite_lab.reporting.content import Source
from granite_lab.reporting.discovery import answers
from granite_lab.reporting.discovery.evidence import how, steps
from granite_lab.reporting.discovery.names import listed
from granite_lab.reporting.document import Report, Words
from granite_lab.reporting.provenance import provenance_section


def assemble(
    finding: Finding,
    name: str,
    source: Source,
    *,
    model: Path | str | None = None,
    effects: Mapping[str, Effect] | None = None,
) -> Report:
    """Lay out the report of a search for the missing effect.

    Args:
        finding: the record.
        name: of the report.
        source: where it comes from.
        model: path of the model file, as the report shall name it.
        effects: the candidates by id; those of the package by default.
    """
    virtual = (
        "A simulator wrote the sensor logs of these trials, no robot was driven. What is missing here was "
        "left out of the model or put into the simulator; it says nothing about real sand."
    )
    return Report(
        name=name,
        lead=_lead(finding),
        virtual=virtual if finding.virtual else "",
        answers=(
            answers.missing_answer(finding), answers.sure_answer(finding), answers.gap_answer(finding),
            answers.where_answer(finding),
        ),
        first_page=(Words(how(finding)),),
        sections=(*steps(finding, model, effects=effects), provenance_section(source)),
        version=source.version,
        command=source.command,
        numbers="finding.json",
    )  # fmt: skip


def _lead(finding: Finding) -> str:
    trials = {r.trial: r.variant for r in finding.residuals}
    speeds = sorted(set(trials.values()))
    n = len(trials)
    robot = finding.robot.title.split(",")[0]
    soil = finding.soil.title
    soil = soil[0].lower() + soil[1:] if soil[1:2].islower() else soil
    return (
        f"{n} trial{'s' if n > 1 else ''} of {robot} on {soil} at {listed([f'{v:g}' for v in speeds])} m/s, "
        "searched for an effect that the model of the paper leaves out."
    )
