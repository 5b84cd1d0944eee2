"""The page of `benchmarks.real_trials`."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from benchmarks.real_trials_set import Outcome, Row
from granite_lab.estimate import Estimate

NARROW = 0.3
"""Width of a 95 % interval of k_92 up to which it says something: k_92 goes from 0 to 1."""

HEAD = """# Real trials of other laboratories

Public sets, each through the whole chain: what was written by hand, the slip ratio λ_R with its std against
the reference that came with the set, k_92 or why there is none, and what the report says. Logs without a
licence are not part of the project; the sources are named. `make real DATA=FOLDER` writes this page;
numbers: [tables/real-trials.csv](tables/real-trials.csv).

The robots have no [drive]: the measured wheels drive the model. k_92 comes from the estimate with the
reference, where there is one. Its 95 % interval contains the uncertainty of soil and wheel radius ("to 0.3":
trials in which it is at most 0.3 wide). The ground of a set without a soil by its authors is assumed: DRIVE's
grass as upland sandy loam.

λ_R by the reference is 1 − (its distance) / (distance of the wheels) over the same steady part; no estimate
enters. z: λ_R of the estimate without the reference minus that by the reference, over both std. Estimates by
IMU and wheels of other sets: [estimation-real](estimation-real.md).
"""


def page(outcomes: Sequence[Outcome], absent: Sequence[str]) -> str:
    """Return the page."""
    parts = [HEAD, _summary(outcomes), *map(_section, outcomes)]
    if absent:
        parts.append(f"Not in the data of this run: {', '.join(absent)}.\n")
    return "\n".join(parts)


def picture(outcome: Outcome) -> str:
    """Return the path of a set's figure beside the page."""
    name = re.sub("[^a-z0-9]+", "-", outcome.prepared.title.lower()).strip("-")
    return f"figures/real-trials/{name}.png"


def z_of(row: Row) -> float:
    """Return by how many std λ_R without the reference misses it; NaN where one is not known."""
    spread = math.hypot(row.slip.std, row.truth.std)
    return abs(row.slip.value - row.truth.value) / spread if spread > 0 else math.nan


def _summary(outcomes: Sequence[Outcome]) -> str:
    lines = [
        "| set | trials | refused | λ_R known to 5 points | with reference | beyond 3 std | k_92 | to 0.3 |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for o in outcomes:
        known, referred = (sum(getattr(r, name).std <= 0.05 for r in o.rows) for name in ("slip", "referred"))
        far = sum(z_of(r) > 3 for r in o.rows)
        compared = sum(math.isfinite(z_of(r)) for r in o.rows)
        refused = sum(r.grade == "refused" for r in o.rows)
        k92 = sum(math.isfinite(r.width) for r in o.rows)
        narrow = sum(r.width <= NARROW for r in o.rows)
        with_it = referred if o.prepared.known else "–"
        beyond = f"{far} of {compared}" if compared else "–"
        cells = (o.prepared.title, len(o.rows), refused, known, with_it, beyond, k92, narrow)
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


def _section(o: Outcome) -> str:
    p = o.prepared
    about = f"Source: {p.source}. Licence: {p.licence}. Reference: {p.reference_is or 'none'}."
    hand = f"Written by hand: {'; '.join(p.written) or 'nothing'}. Time for all: {o.seconds:.0f} s."
    lines = [
        f"## {p.title}",
        "",
        f"{about} {hand}",
        "",
        *([p.remark, ""] if p.remark else []),
        "| trial | estimate | λ_R [%] | with reference [%] | by reference [%] | z | k_92 |",
        "|---|---|---|---|---|---|---|",
    ]
    for r in o.rows:
        z = z_of(r)
        lines.append(
            f"| {r.name} | {r.grade} | {_percent(r.slip)} | {_percent(r.referred)} | {_percent(r.truth)} | "
            f"{f'{z:.1f}' if math.isfinite(z) else '–'} | {r.k92.replace('|', '/')} |"
        )
    lines += ["", f"![slip ratios]({picture(o)})"]
    return "\n".join([*lines, "", "The report:", "", *(f"> {line}\n>" for line in o.said)]) + "\n"


def _percent(e: Estimate) -> str:
    if not math.isfinite(e.value):
        return "–"
    return "not known" if e.std >= 1.0 else f"{100 * e.value:.1f} ± {100 * e.std:.1f}"
