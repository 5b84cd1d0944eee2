"""One type of table, written in every format, and the tables of a study by speed, quantity and trial."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from granite_lab.estimate import Estimate, Part, mean_over
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.budget import LEFT_OUT, Budget, of_a_theta, of_mean
from granite_lab.fitting.fit import AThetaFit, FitStatus, K92Fit, Law
from granite_lab.reporting.answers import Answers
from granite_lab.reporting.rounding import (
    NONE,
    percent,
    places,
    plus_minus,
    shown_as,
    significant,
    tidy_unit,
    with_unit,
)
from granite_lab.reporting.summary import ChannelAnswer, Speed
from granite_lab.reporting.words import WORDS, quantity
from granite_lab.results import Gap, Source, StudyResult, TrialResult, shown_path

Raw = float | int | bool | str | None


@dataclass(frozen=True)
class Column:
    """A column: what stands above it, and the names of the plain columns it becomes in a CSV.

    Attributes:
        name: above the column, without a unit.
        unit: of the printed cells; empty where the cells state theirs or have none.
        keys: names in the CSV, with the unit behind them; one per raw value of a cell.
        number: set flush right.
    """

    name: str
    unit: str
    keys: tuple[str, ...]
    number: bool = True

    @property
    def title(self) -> str:
        """What stands above the column: the name with the unit in brackets."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Cell:
    """What is printed, and the plain values behind it.

    Attributes:
        text: as printed.
        raw: as in the CSV, one per key of the column.
        tone: "", "good", "fair" or "bad"; the text says the same.
    """

    text: str
    raw: tuple[Raw, ...]
    tone: str = ""


@dataclass(frozen=True)
class Table:
    """A table of the report.

    Attributes:
        name: stem of its CSV.
        title: what it lists.
        caption: what to see in it.
        columns, rows: its content; the first cell of a row names the row.
        virtual: its data were written by a simulator; `heading` and a column of the CSV then say so.
    """

    name: str
    title: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    virtual: bool = False

    @property
    def heading(self) -> str:
        """The title, with "(virtual data)" behind it where that is so."""
        return f"{self.title} (virtual data)" if self.virtual else self.title

    def to_csv(self) -> str:
        """Return the plain values as CSV, a column "data" last where they are virtual.

        A text that a spreadsheet would run gets a leading quote.
        """
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        data = ["virtual"] if self.virtual else []
        writer.writerow([key for column in self.columns for key in column.keys] + ["data"] * len(data))
        for row in self.rows:
            writer.writerow([_plain(value) for cell in row for value in cell.raw] + data)
        return out.getvalue()


Cells = Mapping[str, Callable[[Any], "Cell | str | int"]]
"""What makes the cells of a column, its text, or its whole number, of an item."""


def tabulate(
    name: str,
    items: Iterable[Any],
    cells: Cells | None = None,
    *,
    virtual: bool = False,
    skip: Sequence[str] = (),
    **parts: object,
) -> Table:
    """Return a table with a row for each item; title, caption and columns stand in ``words.toml``.

    Args:
        name: of the table; there it ends before "_of_".
        items: what the rows are about.
        cells: functions that make cells, by the names that columns give them.
        virtual: as in `Table`.
        skip: functions, or attributes, whose columns are left out.
        **parts: what fills the braces of words.
    """
    known, own = WORDS["tables"][name.partition("_of_")[0]], cells or {}
    columns, made = [], []
    for heading, keys, how in WORDS["tables"][known.get("as", name.partition("_of_")[0])]["columns"]:
        if how in skip:
            continue
        full = heading.format(**parts)
        match = re.fullmatch(r"(.*) \[(.*)\]", full)
        label, unit = match.groups() if match else (full, "")
        plain = re.sub(r"\W+", "_", full.lower()).strip("_")
        columns.append(Column(label, unit, tuple(keys.split()) or (plain,), bool(keys)))
        made.append(own.get(how) or partial(_by_attribute, how))
    rows = tuple(tuple(_cell(make(item)) for make in made) for item in items)
    title, caption = (str(known[part].format(**parts)) for part in ("title", "caption"))
    return Table(name.replace("_of_", "_"), title, caption, tuple(columns), rows, virtual)


def _cell(made: Cell | str | int) -> Cell:
    return made if isinstance(made, Cell) else Cell(str(made), (made,))


def _by_attribute(how: str, item: Any) -> Cell:
    """Return the cell "attribute:format" of an item; a number as attribute is a place."""
    path, _, form = how.partition(":")
    value = item
    for part in path.split("."):
        value = value[int(part)] if part.isdigit() else getattr(value, part)
    form, _, factor = form.partition("*")
    scale = float(factor or 1)
    if isinstance(value, Cell):
        return value
    if form == "±":
        return estimate(value, scale)
    if form == "%":
        return share(value)
    if form.isdigit():
        return number(value, int(form), scale=scale)
    known = value not in (None, "") and not (isinstance(value, float) and math.isnan(value))
    return Cell(format(value, form) if known else NONE, (value,))


def words(text: str, tone: str = "") -> Cell:
    """Return a cell that holds a text."""
    return Cell(text, (text,), tone)


def number(value: float, digits: int = 3, unit: str = "", scale: float = 1.0) -> Cell:
    """Return a cell that holds a number without uncertainty; the raw value stays in the record's unit."""
    text = with_unit(significant(value * scale, digits), unit) if math.isfinite(value) else NONE
    return Cell(text, (value,))


def share(value: float) -> Cell:
    """Return a cell with a share in percent."""
    return Cell(percent(value), (value,))


def estimate(value: Estimate, scale: float = 1.0) -> Cell:
    """Return a cell with value ± std; the raw values stay in the record's unit."""
    return Cell(plus_minus(value, scale=scale), (value.value, value.std))


def _plain(value: Raw) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.9g}"
    flat = re.sub(r"[\r\n\t\v\f\x00]+", " ", str(value))
    return f"'{flat}" if isinstance(value, str) and flat.lstrip().startswith(("=", "+", "-", "@")) else flat


AGREES = {True: ("yes", "good"), False: ("no", "fair"), None: (NONE, "")}

FIT, LAWS = WORDS["fit"], WORDS["laws"]
"""Status of a fit, and laws for k_92, as a reader calls them."""


def slip_table(answers: Answers) -> Table:
    """Return slip and k_92 by speed beside the paper: the table of the first screen."""
    cells: Cells = {
        "slip": lambda s: Cell(s.slip.text, (s.slip.value / 100,)),
        "interval": lambda s: Cell(s.slip.interval, (s.slip.low / 100, s.slip.high / 100)),
        "paper": lambda s: number(s.paper_slip / 100, 3, scale=100),
        "agrees": lambda s: Cell(AGREES[s.agrees][0], (s.agrees,), AGREES[s.agrees][1]),
        "k92": lambda s: Cell(s.k92_note or s.k92.with_std, (s.k92.value, s.k92.std)),
    }
    return tabulate("slip_by_speed", answers.speeds, cells, virtual=bool(answers.virtual))


def channel_table(channels: Sequence[ChannelAnswer], virtual: bool) -> Table:
    """Return how well the model explains each quantity over whole trials."""

    def size(value: float, unit: str) -> Cell:
        return Cell(f"{significant(value, 2)} {unit}" if math.isfinite(value) else NONE, (value, unit))

    cells: Cells = {
        "verdict": lambda c: words(c.verdict, c.tone),
        "rms": lambda c: size(c.rms, c.unit),
        "noise": lambda c: size(c.noise, c.unit),
        "largest": lambda c: size(c.largest, c.unit),
    }
    return tabulate("channels", channels, cells, virtual=virtual)


def misfit_table(found: dict[tuple[str, str], Gap], virtual: bool) -> Table:
    """Return the difference in each quantity and phase."""

    def size(value: float, gap: Gap) -> Cell:
        return number(value, 2, scale=shown_as(gap.unit)[1])

    cells: Cells = {
        "name": lambda g: quantity(g.channel),
        "unit": lambda g: tidy_unit(shown_as(g.unit)[0]),
        "rms": lambda g: size(g.rms, g),
        "bias": lambda g: size(g.bias, g),
        "peak": lambda g: size(g.peak, g),
    }
    return tabulate("misfits", found.values(), cells, virtual=virtual)


def law_table(fit: AThetaFit, virtual: bool) -> Table:
    """Return the rival laws for k_92, best first, and which the data prefer; values stand in the CSV file."""
    caption = "Only one law could be fitted." if fit.laws else "No law could be compared."
    if len(fit.laws) > 1:
        lead = fit.laws[1].aicc - fit.laws[0].aicc
        first, second = (LAWS.get(law.id, law.formula) for law in fit.laws[:2])
        clear = "clearly better than" if lead > 10 else "better than" if lead > 2 else "hardly better than"
        caption = (
            f"By the corrected Akaike criterion AICc, {first} is {clear} {second} (ΔAICc "
            f"{significant(lead, 2)}; above 10 is decisive)."
        )
        if not math.isfinite(lead):
            caption = "Too few values of k_92 for an information criterion of every law."
    best = fit.laws[0].aicc if fit.laws else math.nan

    def numbers(law: Law) -> Cell:
        values = "; ".join(f"{k} = {v.value:.6g}" for k, v in law.parameters.items())
        return Cell(str(law.n_parameters), (law.n_parameters, values))

    def delta(law: Law) -> Cell:
        over = law.aicc - best
        return Cell(places(over, 1) if math.isfinite(over) else NONE, (over,))

    cells: Cells = {
        "law": lambda law: Cell(LAWS.get(law.id, law.formula), (law.id,)), "numbers": numbers, "delta": delta,
    }  # fmt: skip
    return tabulate("laws", fit.laws, cells, virtual=virtual, verdict=caption)


def trial_table(result: StudyResult) -> Table:
    """Return one row per trial."""
    mixed = result.virtual and not all(r.trial.info.virtual for r in result.trials)

    def speed(r: TrialResult) -> Cell:
        motion = r.comparison.motion
        v, source = motion.variant.velocity, motion.variant_source
        return Cell(f"{v:.3g}" + ("" if source == "given" else f" ({source})"), (v, source))

    cells: Cells = {
        "data": lambda r: "virtual" if r.trial.info.virtual else "measured",
        "speed": speed,
        "steady": lambda r: steady(r.comparison.fit),
        "trajectory": lambda r: trajectory(r.comparison.fit),
        "estimate": lambda r: good(r.comparison.motion.health.good),
        "warnings": lambda r: len(set(r.trial.warnings) | set(r.comparison.motion.warnings)),
    }
    skip = () if mixed else ("data",)
    return tabulate("trials", result.trials, cells, virtual=result.virtual and not mixed, skip=skip)


def _fitted(value: Estimate, status: FitStatus) -> Cell:
    """Return a fit of k_92; where it is no inner optimum it stands with the reason."""
    text, raw = plus_minus(value), (value.value, value.std, FIT[status])
    return Cell(text, raw) if status == "ok" else Cell(f"{text} ({FIT[status]})", raw, "fair")


def steady(fit: K92Fit) -> Cell:
    """Return k_92 by the steady slip."""
    return _fitted(fit.k92, fit.status)


def trajectory(fit: K92Fit) -> Cell:
    """Return k_92 by the whole trajectory."""
    return _fitted(fit.k92_trajectory, fit.status_trajectory)


def good(is_good: bool) -> Cell:
    """Return the verdict on an estimate."""
    return words("good", "good") if is_good else words("doubtful", "bad")


def k92_table(fits: Sequence[K92Fit]) -> Table:
    """Return k_92 of each trial, by the steady slip and by the whole trajectory."""
    cells: Cells = {"steady": steady, "trajectory": trajectory}
    return tabulate("k92", fits, cells, virtual=any(f.virtual for f in fits))


def motion_table(motions: Sequence[Motion]) -> Table:
    """Return what was estimated of each trial."""
    cells: Cells = {"estimate": lambda m: good(m.health.good)}
    return tabulate("motions", motions, cells, virtual=any(m.virtual for m in motions))


COMBINED = "combined standard uncertainty"

BUDGETS = {
    "slip": ("slip ratio λ_R", "points", 100.0),
    "k92": ("contact-angle ratio k_92", "–", 1.0),
    "a_theta": ("a_θ", "s/m", 1.0),
}
"""Quantity with a budget: in words, unit of the contributions, and the factor to it."""


def budget_tables(result: StudyResult, speeds: Sequence[Speed]) -> list[Table]:
    """Return what the std of λ_R, k_92 and a_θ is made of (JCGM 100:2008, 5.1 and 8), a table each.

    What has no stated std, or no components, has no budget.
    """
    budgets: dict[str, list[Budget | None]] = {what: [] for what in BUDGETS}
    for speed in speeds:
        motions = [r.comparison.motion for r in speed.results]
        known = [m for m in motions if math.isfinite(m.slip_ratio.value)]
        inner = [r.comparison.fit for r in speed.results if r.comparison.fit.status == "ok"]
        slip, k92 = mean_over(m.slip_ratio for m in known), mean_over(f.k92 for f in inner)
        parts = {"slip": [m.slip_parts for m in known], "k92": [f.parts for f in inner]}
        for what, mean in (("slip", slip), ("k92", k92)):
            stated = Estimate(mean.value, mean.std)
            budgets[what].append(of_mean(speed.velocity, stated, parts[what]))
    if result.a_theta is not None:
        budgets["a_theta"].append(of_a_theta(result.a_theta, [r.comparison.fit for r in result.trials]))
    there = {what: [b for b in own if b is not None] for what, own in budgets.items()}
    return [_budget_table(what, own, result.virtual) for what, own in there.items() if own]


def _budget_table(what: str, of: Sequence[Budget], virtual: bool) -> Table:
    """Return the budgets of one quantity as one table, the combined uncertainty of each last."""
    title, unit, scale = BUDGETS[what]
    rows = []
    for b in of:
        rows += [(b.speed, part, b.share(part)) for part in b.parts]
        rows.append((b.speed, Part(COMBINED, "A", "", "", b.result.std, b.combined), 1.0))

    def std(part: Part) -> Cell:
        text = f"{significant(part.std, 2)} {tidy_unit(part.unit if part.unit != '1' else '')}".strip()
        return Cell(text if part.unit else NONE, (part.std if part.unit else None, part.unit))

    cells: Cells = {
        "type": lambda r: "" if r[1].name == COMBINED else r[1].kind,
        "std": lambda r: std(r[1]),
        "sensitivity": lambda r: number(r[1].sensitivity if r[1].unit else math.nan, 2, scale=scale),
        "contribution": lambda r: number(r[1].contribution, 2, scale=scale),
    }
    each = what != "a_theta"
    return tabulate(
        f"budget_of_{what}", rows, cells, virtual=virtual, skip=() if each else ("0:g",), unit=unit,
        quantity=title, left_out=LEFT_OUT[what], mean="Mean over the trials of a speed. " if each else "",
    )  # fmt: skip


def parameter_table(source: Source) -> Table:
    """Return every parameter in force and its origin."""
    return tabulate("parameters", source.parameters, {"unit": lambda p: tidy_unit(p[2])})


def input_table(source: Source) -> Table:
    """Return the files that were read; of an absolute path only the name."""
    return tabulate("inputs", source.inputs, {"file": lambda i: shown_path(i.path)})
