"""The tables of a study."""

from __future__ import annotations

import math
from collections.abc import Sequence

from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import AThetaFit, FitStatus, Law
from granite_lab.parameters import Paper
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.rounding import NONE, plus_minus, significant
from granite_lab.reporting.summary import Speed
from granite_lab.reporting.table import Cell, Table, columns, count, estimate, fixed, number, words

STATUS = {
    "ok": "fitted",
    "at_lower_bound": "at lower bound",
    "at_upper_bound": "at upper bound",
    "not_converged": "not converged",
    "not_evaluated": "not evaluated",
}


def data_cell(virtual: bool) -> Cell:
    """Return the cell that says whether a row comes from a simulator."""
    return Cell("virtual" if virtual else "measured", ("virtual" if virtual else "measured",))


def _virtual(speed: Speed) -> bool:
    return any(r.trial.info.virtual for r in speed.results)


def three_digits(low: float, high: float) -> str:
    """Return an interval of slip ratios in percent, three digits each."""
    return f"{significant(low * 100)} to {significant(high * 100)}" if math.isfinite(low + high) else NONE


def slip_table(speeds: Sequence[Speed]) -> Table:
    """Return slip per speed beside the paper's experiment: the table of the first page."""
    rows = []
    for s in speeds:
        published = s.published.slip_measured if s.published else math.nan
        inside = s.slip.holds(published)
        rows.append(
            (
                Cell(f"{s.velocity:g}", (s.velocity,)),
                number(s.slip.value, 3, scale=100),
                Cell(three_digits(s.slip.low, s.slip.high), (s.slip.low, s.slip.high)),
                number(published, 3, scale=100),
                Cell(
                    {True: "agrees", False: "differs", None: NONE}[inside],
                    (inside,),
                    {True: "good", False: "fair", None: ""}[inside],
                ),
                number(s.simulated, 3, scale=100),
                count(s.slip.count),
                data_cell(_virtual(s)),
            )
        )
    return Table(
        "slip_per_speed", "Robot slip ratio λ_R per speed",
        "“Agrees” means that the paper's experiment lies inside this lab's 95 % interval.",
        columns(
            ("speed [m/s]", ("speed_mps",)), ("slip [%]", ("slip_ratio",)),
            ("95 % interval [%]", ("slip_ratio_low95", "slip_ratio_high95")),
            ("paper [%]", ("slip_ratio_paper_experiment",)),
            ("against paper", ("paper_inside_interval",), False), ("model [%]", ("slip_ratio_simulated",)),
            ("trials", ("trials",)), ("data", ("data",), False),
        ),
        tuple(rows),
    )  # fmt: skip


def table3(speeds: Sequence[Speed], paper: Paper) -> Table:
    """Return Table 3 of the paper with this lab's rows."""
    velocities = sorted({s.velocity for s in speeds} | {p.velocity for p in paper.table3})
    lab = {s.velocity: s for s in speeds}
    published = {round(p.velocity, 2): p for p in paper.table3}
    nothing = Cell(NONE, (None,))
    virtual = any(_virtual(s) for s in speeds)

    def row(source: str, quantity: str, cells: list[Cell]) -> tuple[Cell, ...]:
        return (words(source), words(quantity), *cells)

    def of_paper(attribute: str, scale: float) -> list[Cell]:
        """Return a row of the paper with the digits that it prints."""
        values = [getattr(published[v], attribute) if v in published else None for v in velocities]
        return [
            nothing if x is None else number(x, 3, scale=scale) if scale > 1 else Cell(f"{x:g}", (x,))
            for x in values
        ]

    def mean(estimate: Estimate, scale: float = 1.0) -> Cell:
        return Cell(plus_minus(estimate, scale=scale), (estimate.value,))

    measured = "this lab, virtual experiment" if virtual else "this lab, experiment"
    rows = (
        row("paper, simulation", "λ_R [%]", of_paper("slip_simulated", 100)),
        row("paper, simulation", "k_92 [–]", of_paper("k92", 1)),
        row("paper, experiment", "λ_R [%]", of_paper("slip_measured", 100)),
        row("this lab, simulation", "λ_R [%]",
        [fixed(lab[v].simulated, 2, 100) if v in lab else nothing for v in velocities]),
        row("this lab, simulation", "k_92 [–]",
        [mean(lab[v].k92.estimate) if v in lab else nothing for v in velocities]),
        row(measured, "λ_R [%]",
        [mean(lab[v].slip.estimate, 100) if v in lab else nothing for v in velocities]),
    )  # fmt: skip
    return Table(
        "table3", "Table 3 of the paper, with this lab's rows",
        "Values are means over the trials ± standard error; slip ratios in the CSV are fractions.",
        columns("source", "quantity", *((f"{v:g} m/s", (f"at_{v:g}_mps",)) for v in velocities)), rows,
    )  # fmt: skip


def trial_table(result: StudyResult) -> Table:
    """Return one row per trial."""
    rows = []
    for r in result.trials:
        m, fit = r.comparison.motion, r.comparison.fit
        repetition = r.trial.info.repetition
        speed = significant(m.variant.velocity) + (
            "" if m.variant_source == "given" else f" ({m.variant_source})"
        )
        rows.append(
            (
                words(r.trial.name), data_cell(r.trial.info.virtual or m.virtual),
                Cell(speed, (m.variant.velocity, m.variant_source)),
                Cell(NONE if repetition is None else str(repetition), (repetition,)),
                estimate(m.distance), estimate(m.slip_ratio, 100), _fitted(fit.k92, fit.status),
                _fitted(fit.k92_trajectory, fit.status_trajectory), _late(m.clock_offset),
                words("good" if m.health.good else "doubtful", "good" if m.health.good else "bad"),
                count(len(set(r.trial.warnings) | set(m.warnings))),
            )
        )  # fmt: skip
    return Table(
        "trials", "Trials",
        "Value ± standard deviation of a single trial. Wheel stamps late: by how much those of encoders and "
        "currents come after the IMU's, negative where they are early; the CSV holds what is to be added to "
        "them.",
        columns(
            "trial", "data", ("speed [m/s]", ("speed_mps", "speed_is")), ("rep.", ("repetition",)),
            ("distance [m]", ("distance_m", "distance_std_m")), ("λ_R [%]", ("slip_ratio", "slip_ratio_std")),
            ("k_92, steady slip", ("k92", "k92_std", "k92_status")),
            ("k_92, trajectory", ("k92_trajectory", "k92_trajectory_std", "k92_trajectory_status")),
            ("wheel stamps late [ms]", ("clock_offset_s", "clock_offset_std_s")),
            ("filter", ("filter",), False),
            ("warnings", ("warnings",)),
        ),
        tuple(rows),
    )  # fmt: skip


def _late(offset: Estimate) -> Cell:
    """Return by how much stamps are late, the sense of a search for a missing effect."""
    late = Estimate(-offset.value + 0.0, offset.std)
    return Cell(plus_minus(late, scale=1e3), (offset.value, offset.std))


def _fitted(value: Estimate, status: FitStatus) -> Cell:
    text = plus_minus(value)
    raw = (value.value, value.std, STATUS[status])
    return Cell(text, raw) if status == "ok" else Cell(f"{text} ({STATUS[status]})", raw, "fair")


def law_table(fit: AThetaFit) -> Table:
    """Return the rival laws for k_92, best first."""
    rows = []
    for law in fit.laws:
        values = [
            f"{name.replace('a_theta', 'a_θ')} = {plus_minus(value, law.units.get(name, ''))}"
            for name, value in law.parameters.items()
        ]
        rows.append(
            (
                Cell(_formula(law), (law.formula,)), Cell("; ".join(values), ("; ".join(values),)),
                count(law.n_parameters),
                number(law.rms, 2), fixed(law.aicc, 1), fixed(law.aicc - fit.laws[0].aicc, 1),
                number(law.weight, 2),
            )
        )  # fmt: skip
    return Table(
        "laws", "Rival laws for k_92", describe_laws(fit),
        columns(
            "law", "parameters", ("fitted", ("fitted_parameters",)), ("rms [–]", ("rms",)),
            ("AICc", ("aicc",)),
            ("ΔAICc", ("delta_aicc",)), ("weight", ("weight",)),
        ),
        tuple(rows),
    )  # fmt: skip


def _formula(law: Law) -> str:
    return law.formula.replace("-", "−")


def describe_laws(fit: AThetaFit) -> str:
    """Say which law the data prefer, and how clearly."""
    if not fit.laws:
        return "No law could be compared."
    best = fit.laws[0]
    if len(fit.laws) == 1:
        return f"Only {_formula(best)} could be fitted."
    lead = fit.laws[1].aicc - best.aicc
    if not math.isfinite(lead):
        return "Too few values of k_92 for an information criterion of every law; compare the residuals."
    clear = "clearly" if lead > 10 else "slightly" if lead > 2 else "hardly"
    return (
        f"Best by the corrected Akaike criterion: {_formula(best)} (weight {significant(best.weight, 2)}), "
        f"{clear} ahead of {_formula(fit.laws[1])} (ΔAICc {significant(lead, 2)}; above 10 is decisive). "
        "Here each law has a scatter of its own, in k_92, so that a_θ may differ a little from that above."
    )
