"""The page of the comparison with peers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.against_truth import table
from benchmarks.lines import current
from benchmarks.peers_learn import POINTS

Lines = Sequence[Mapping[str, Any]]

GROUPS = {
    "outside": "simulator in C (`outside/`)",
    "mixtures": "MuJoCo (`mixtures/`)",
    "blind": "`hide --effect mixture`",
}

PARTS = ("trials", "speeds")


def page(lines: Lines, of: int) -> str:
    """Return the page in Markdown, of the lines of the code that made the last one.

    Args:
        lines: of the results.
        of: number of sets that are to be compared.
    """
    code, lines = lines[-1], sorted(current(lines), key=lambda x: (list(GROUPS).index(x["of"]), x["key"]))
    kept = [x for x in lines if x["status"] == "compared"]
    no_gap = sum(x["status"] == "no gap" for x in lines)
    lost = [x["key"] for x in lines if x["status"] in ("refused", "crashed")]
    ways = list(dict.fromkeys(way for x in kept for way in x["closed"]))
    seconds = {way: [x["peer_seconds"][way] for x in kept if way in x["peer_seconds"]] for way in ways}
    seconds["this"] = [x["seconds"] for x in kept]
    took = "; ".join(f"{way}: {np.median(s):.0f} s" for way, s in seconds.items() if s)
    return f"""# Beside peers

How much of the gap between virtual trials and the model without effects is closed on trials and on speeds
that were left out:

* **this**: `discover`, by its own account; it was developed with the sets of `outside/` and `mixtures/`;
* **STLSQ**: sparse regression on the residual as PySINDy does it, products of two inputs, the threshold by
  cross-validation over speeds;
* **GP**: a Gaussian process on the residual (scikit-learn), a width for each input, white noise,
  {POINTS} bins.

Trials, gap, residual (of the fit without effects) and left-out splits are the same. The inputs of both peers
are commanded speed and acceleration, wheel speed, slip velocity and acceleration, all smoothed. *Command*:
the inputs are those of the model without effects, so that the peers know of a trial that is left out what
this search knows, its command. *Trial*: the inputs are estimated from the trial that is left out, its
accelerometer included. A prediction does not have these.
In all cases start, offsets, gains and sand of a trial that is left out are refitted. A share may exceed one,
and is below zero where the prediction is worse than none. Peers name no cause.

Code {code["code"]} ({code["commit"]}) has seen {len(lines)} of {of} sets: {len(kept)} are compared, \
{no_gap} have no gap, {len(lost)} were refused or crashed\
{f" ({', '.join(lost)})" if lost else ""}. Processor time of a set (median): {took or "–"}.

## Medians

{_medians(kept, ways)}
## Sets

Share closed on trials / on speeds left out [%], the largest of each in bold.

{_sets(kept, ways)}"""


def share(line: Mapping[str, Any], way: str, part: str) -> float | None:
    """Return the share that is closed one way; None where it is not known."""
    found: float | None = line["closed"].get(way, {}).get(part, (None, None))[0]
    return found


def _medians(lines: Lines, ways: Sequence[str]) -> str:
    head = ["sets", "left out", *(f"{way} [%]" for way in ways), "this is best"]
    rows = []
    for group in (g for g in GROUPS if any(x["of"] == g for x in lines)):
        for part in PARTS:
            own = [x for x in lines if x["of"] == group]
            cells = []
            for way in ways:
                known = [v for x in own if (v := share(x, way, part)) is not None]
                cells.append(percent(float(np.median(known)) if known else None))
            first = [best(x, ways, part) == "this" for x in own]
            rows.append([GROUPS[group], part, *cells, f"{sum(first)} of {len(first)}"])
    return table(head, rows)


def best(line: Mapping[str, Any], ways: Sequence[str], part: str) -> str:
    """Return the way that closes most."""
    known = {way: v for way in ways if (v := share(line, way, part)) is not None}
    return max(known, key=lambda way: known[way], default="")


def percent(value: float | None) -> str:
    """Return a share in percent; how far a prediction is worse than none does not matter beyond the gap."""
    return "–" if value is None else "below -100" if value < -1 else f"{100 * value:.0f}"


def _sets(lines: Lines, ways: Sequence[str]) -> str:
    rows = []
    for line in lines:
        cells = []
        for way in ways:
            parts = []
            for part in PARTS:
                text = percent(share(line, way, part))
                parts.append(f"**{text}**" if best(line, ways, part) == way else text)
            cells.append(" / ".join(parts))
        rows.append([line["key"], line["hidden"], "+".join(line["named"]) or line["verdict"], *cells])
    return table(["set", "hidden", "answer", *ways], rows)
