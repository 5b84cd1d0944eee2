"""What to do with a finding: the sentences of the last step."""

from __future__ import annotations

from pathlib import Path

from granite_lab.discovery.finding import Finding
from granite_lab.reporting.discovery.answers import MUCH
from granite_lab.reporting.discovery.names import capital, listed, plain

SENSORS = ("accel_scale_error", "clock_offset", "encoder_eccentricity", "imu_tilt", "wheel_radius_error")
"""Effects that are faults of the measurement, not of the model."""

PLAN = "granite-lab plan-next with the folder of this report"
OWN = "granite-lab discover --effects my_effect.py"


def next_steps(finding: Finding, model: Path | str | None = None) -> tuple[str, ...]:
    """Say what to do next, most useful first.

    Args:
        finding: the record.
        model: path of the model file, as the report names it.
    """
    if finding.verdict == "none":
        return (
            "Nothing needs to be added to the model for trials like these. Elsewhere it is yet to be tested.",
            f"To learn which trial would show the effects that stay hidden here: {PLAN}.",
        )
    if finding.verdict == "unknown":
        look = "The pictures of the disagreement show where and when to look for a cause."
        if finding.effects:
            look = (
                "The law shows which quantity is missing and what it goes with: look for a cause of that "
                "kind on the robot, in the sand and in the sensors."
            )
        own = f"Let the cause that you suspect compete with the others, as an effect of your own: {OWN}."
        return look, own, f"To learn which trial would tell more: {PLAN}."
    parts = []
    faults = [plain(e.id) for e in finding.effects if e.id in SENSORS]
    if faults:
        parts.append(
            f"{capital(listed(faults))} is a fault of the measurement, not of the model: mend it on the "
            "robot or correct the logs by the number found, and search again."
        )
    twins = [e for e in finding.effects if e.twins]
    parts += [
        f"To tell {plain(e.id)} from {listed([plain(t) for t in e.twins], 'or')}: {PLAN} proposes the trial "
        "that separates them best."
        for e in twins
    ]
    if not twins:
        parts.append(f"To sharpen the numbers: {PLAN} proposes the trial that does so best.")
    if finding.remainder > MUCH:
        parts.append(
            "What is left is more than noise and tolerance: the formula may differ from nature's, or "
            f"something is missing besides. An effect of your own is tried with {OWN}."
        )
    if model and len(faults) < len(finding.effects):
        parts.append(
            f"To use the model with what was found: granite-lab simulate --model {model} --variant 0.5. At "
            "speeds and on sand that were not driven here it is a guess until a trial confirms it."
        )
    return tuple(parts)
