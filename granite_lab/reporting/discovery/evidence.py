"""The discovery as a section of a report."""

from __future__ import annotations

from pathlib import Path

from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.finding import Finding
from granite_lab.reporting.discovery.answers import missing_answer
from granite_lab.reporting.document import Block, Discovery, Listing, Section, Words


def section(finding: Finding, model: Path | str | None = None) -> Discovery:
    """Return what a finding adds to a report: the answer of the first page, and the evidence.

    Args:
        finding: the record.
        model: path of the model file with what was found, as the report shall name it.
    """
    blocks: list[Block] = [Words(finding.sentence)]
    if finding.notes:
        blocks.append(Listing(finding.notes))
    return Discovery(
        missing_answer(finding),
        Section("discovery", "The missing effect", tuple(blocks)),
        finding_as_json(finding, model),
    )
