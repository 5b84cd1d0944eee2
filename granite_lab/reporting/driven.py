"""What was driven: trials, robots, soils, and which of the data a simulator wrote."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from granite_lab.reporting.names import inside, listed
from granite_lab.reporting.speeds import Speed
from granite_lab.results import StudyResult
from granite_lab.rounding import plural


def _drove(trials: int, robots: Sequence[str], soils: Sequence[str], speeds: Sequence[float]) -> str:
    """Say what was driven; titles of robots and soils may repeat, and the most frequent ones come first."""
    robot, soil = (
        listed([name for name, _ in Counter(titles).most_common()])
        for titles in ([r.split(",")[0] for r in robots], map(inside, soils))
    )
    velocities = listed([f"{v:g}" for v in speeds])
    return f"{plural(trials, 'trial')} of {robot} driving straight on {soil} at {velocities} m/s"


def lead(result: StudyResult, speeds: Sequence[Speed]) -> str:
    """Say what was driven, which trials were left out, and which robot and soil were assumed."""
    if not result.trials and result.finding is not None:
        robot, soil = result.finding.robot.title, result.finding.soil.title
        driven = {r.trial: r.variant for r in result.finding.residuals}
        return f"{_drove(len(driven), [robot], [soil], sorted(set(driven.values())))}."
    runs = [r.run for r in result.trials]
    robots, soils = [r.robot.title for r in runs], [r.soil.title for r in runs]
    counts = {len(s.results) for s in speeds}
    each = f" ({counts.pop()} at each speed)" if len(counts) == 1 and len(speeds) > 1 else ""
    excluded = sum(f.excluded for f in result.failures)
    failed = len(result.failures) - excluded
    left_out = f" {plural(failed, 'more trial')} could not be used." if failed else ""
    left_out += f" {plural(excluded, 'more trial')} excluded by the user." if excluded else ""
    assumed = f" {text}" if (text := assumptions(result)) else ""
    return f"{_drove(len(runs), robots, soils, [s.velocity for s in speeds])}{each}.{left_out}{assumed}"


def of_simulator(result: StudyResult) -> str:
    """Say which trials a simulator wrote; empty for a real experiment."""
    if not result.trials and result.finding is not None and result.finding.virtual:
        return (
            "A simulator wrote the sensor logs of these trials; no robot was driven. Nothing here is about "
            "real sand."
        )
    count, n = sum(r.motion.virtual for r in result.trials), len(result.trials)
    if not count:
        return ""
    which = "All trials are" if count == n else f"{count} of {n} trials are"
    return (
        f"{which} virtual: a simulator wrote the sensor logs and no robot was driven. “Measured” means "
        "estimated from the virtual sensors. Nothing here is about real sand."
    )


def assumptions(result: StudyResult) -> str:
    """Say which robot and soil were assumed because they were not named; empty where all are named."""
    given = dict(result.source.options)
    parts = []
    for kind in ("robot", "soil"):
        unnamed = [r for r in result.trials if getattr(r.trial.info, kind) is None]
        if kind in given or not unnamed:
            continue
        titles = list(dict.fromkeys(getattr(r.run, kind).title for r in unnamed))
        every = "" if len(unnamed) == len(result.trials) else f" of {len(unnamed)} trials"
        parts.append(f"the {kind}{every} is {listed([inside(title) for title in titles])}")
    if not parts:
        return ""
    keys = " and ".join(f"--{part.split()[1]}" for part in parts)
    return f"Assumed, because no log and no option says it: {listed(parts)} ({keys} says which)."
