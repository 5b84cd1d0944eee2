"""The page of the benchmark of joystick runs: shares with their intervals, then each set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.against_truth import table
from benchmarks.intervals import ratio
from benchmarks.judging import named
from benchmarks.lines import current

Lines = Sequence[Mapping[str, Any]]

LAW = (
    "sets", "wheels drive", "by slip", "rms", "by trajectory, converged", "rms", "not converged",
    "sets, by slip",
)  # fmt: skip
"""Columns of the table of a_θ; rms is that of the deviations over their std."""

WHOLE = 4.99
"""Strength from which on an effect counts as one of five times the smallest size that is seen."""

WITHIN = 2.0
"""Std within which an a_θ is to be."""


def deviation(found: Sequence[float | None] | None, true: float) -> float | None:
    """Return by how many std an a_θ is off; None where there is none."""
    if found is None or found[0] is None or not found[1]:
        return None
    return (found[0] - true) / found[1]


def within(values: Sequence[float | None]) -> str:
    """Return how many deviations are within `WITHIN`; an a_θ that could not be had is not."""
    return ratio(sum(z is not None and abs(z) <= WITHIN for z in values), len(values))


def rms(values: Sequence[float | None]) -> str:
    """Return the rms of the deviations that are known."""
    known = [z for z in values if z is not None]
    return f"{np.sqrt(np.mean(np.square(known))):.2f}" if known else "–"


def sort_of(line: Mapping[str, Any]) -> str:
    """Return in words how the runs of a set were driven."""
    logged = "logged" if line["log_command"] else "not logged"
    whose = "unknown controller" if line["controller"] == "unknown" else "controller of the file"
    return f"{line['command']}, {logged}, {whose}"


def law_rows(lines: Lines) -> list[list[str]]:
    """Return how often a_θ is within two std, for all sets and for each sort of them."""
    sorts = sorted({sort_of(x) for x in lines})
    rows = []
    for name, some in [("all", lines), *((s, [x for x in lines if sort_of(x) == s]) for s in sorts)]:
        runs = [run for line in some for run in line["runs"]]
        slip, trajectory = ([deviation(r[key], r["true"]) for r in runs] for key in ("slip", "trajectory"))
        converged = [z for z in trajectory if z is not None]
        sets = [deviation(line["a_theta"], line["true"]) for line in some]
        wheels = sum(r["wheels"] is True for r in runs)
        rows.append([
            name, f"{wheels} of {len(runs)}", within(slip), rms(slip), within(converged), rms(converged),
            str(len(trajectory) - len(converged)), within(sets),
        ])  # fmt: skip
    return rows


def name_rows(lines: Lines) -> list[list[str]]:
    """Return how often the names are right, for all sets and for each sort of them."""
    sorts = sorted({sort_of(x) for x in lines})
    rows = []
    for name, some in [("all", lines), *((s, [x for x in lines if sort_of(x) == s]) for s in sorts)]:
        nulls = [x for x in some if x["kind"] == "null"]
        whole = [x for x in some if x["kind"] != "null" and not is_smaller(x)]
        parts = whole, [x for x in some if is_smaller(x)], nulls
        rows.append([name, *(ratio(sum(x["right"] for x in own), len(own)) for own in parts)])
    return rows


def is_smaller(line: Mapping[str, Any]) -> bool:
    """Say whether five times the smallest size that can be seen would not have been sensible."""
    return any(reached < WHOLE for reached in times(line))


def page(lines: Lines) -> str:
    """Return the page in Markdown; of either part, by the lines of the code that made its last one."""
    of = {part: current([x for x in lines if x["part"] == part]) for part in ("law", "names")}
    kept = {part: [x for x in some if x["status"] != "not made"] for part, some in of.items()}
    unmade = [x for x in of["names"] if x["status"] == "not made"]
    runs = sum(len(x["runs"]) for x in kept["law"])
    sizes = [f"{x['effect']} ({sort_of(x)})" for x in unmade if "no size" in x["error"]]
    told = f" No size of an effect could be seen in {len(sizes)} sets: {'; '.join(sizes)}." if sizes else ""
    return f"""# Joystick runs and recorded commands

Virtual runs of `granite-lab hide --command joystick` and `--command recorded`
([hidden effects](hidden.md#commands-and-controllers)), laboratory `bench`. A person's stick gives a desired
velocity that is linear between corners, with changes of speed and pauses. In one half of the sets it is
logged, in the other the command is not known. In one half the wheels have a controller that is in no file:
other gains, a voltage fed forward, proportional and integral with limited current, or a cascade. The
robot's file is that of the paper's controller everywhere. What drives the simulation is left to the tool
(`--drive auto`).

No version was developed on these seeds, and each code judged them once. (Seeds 600000 to 600014 and 610000
were used in development and do not count.) Shares are with their 95 % interval
after Wilson. `make joystick` continues the list.

## a_θ

{runs} runs in {len(kept["law"])} sets of four sticks, nothing hidden{judged_by(kept["law"])}.
A value is right within {WITHIN:g} std of the true a_θ: of a run that of its sand, of a set that of the
laboratory. Aim: 90 %. A run or a set without a value counts as wrong, but for fits by the trajectory that did
not converge: these state no std.

{table(LAW, law_rows(kept["law"]))}
{names_of(kept["names"], told)}"""


def names_of(lines: Lines, told: str) -> str:
    """Return the part of the page on names of effects; `told` says of which no size could be seen."""
    if not lines:
        return "## Names of effects\n\nNo set has been searched yet.\n"
    return f"""## Names of effects

{len(lines)} sets of four runs{judged_by(lines)}. An effect has five
times the smallest size that the set of the same laboratory without an effect can show, or less where it would
leave three times what its library entry expects. Aim: 95 % at five times. With trapezoids:
[blind benchmark](blind.md).{told}

{table(["sets", "right, at five times", "right, smaller", "right, nothing hidden"], name_rows(lines))}
{table(["seed", "sets", "hidden", "times", "outcome", "named"], set_rows(lines))}"""


def judged_by(lines: Lines) -> str:
    """Return in words which code judged some sets."""
    return f", judged by code {lines[-1]['code']} ({lines[-1]['commit']})" if lines else ""


def times(line: Mapping[str, Any]) -> list[float]:
    """Return the strengths that the hidden effects reach, over the smallest that is seen."""
    return list((line.get("reached") or {}).values())


def set_rows(lines: Lines) -> list[list[str]]:
    """Return a row for each set in which an effect was searched."""
    return [
        [
            str(x["seed"]),
            sort_of(x),
            x["effect"],
            " + ".join(f"{v:.2g}" for v in times(x)) or "–",
            str(x["outcome"]).replace("_", " "),
            named(x) or "–",
        ]
        for x in lines
    ]
