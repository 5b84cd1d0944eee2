"""The tables of a study: slip by speed, channels, laws, trials, filters, and what they were made from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import AThetaFit, FitStatus, K92Fit
from granite_lab.reporting.answers import Answers, ChannelAnswer
from granite_lab.reporting.content import Source, StudyResult
from granite_lab.reporting.rounding import NONE, Number, plus_minus, shown_as, significant, tidy_unit
from granite_lab.reporting.summary import Gap
from granite_lab.reporting.table import Cell, Table, columns, count, estimate, fixed, number, words

STATUS = {
    "ok": "fitted",
    "at_lower_bound": "at lower limit",
    "at_upper_bound": "at upper limit",
    "not_converged": "not converged",
    "not_evaluated": "not evaluated",
}

AGREES = {True: ("yes", "good"), False: ("no", "fair"), None: (NONE, "")}


def slip_table(answers: Answers) -> Table:
    """Return slip and k_92 by speed beside the paper: the table of the first screen."""
    rows = tuple(
        (
            Cell(f"{s.velocity:g}", (s.velocity,)),
            _decided(s.slip, 0.01), Cell(s.slip.interval, (0.01 * s.slip.low, 0.01 * s.slip.high)),
            number(s.paper_slip / 100, 3, scale=100),
            Cell(AGREES[s.agrees][0], (s.agrees,), AGREES[s.agrees][1]),
            Cell(s.k92_note or s.k92.with_std, (s.k92.value, s.k92.std)), _as_printed(s.paper_k92),
            count(s.trials),
        )
        for s in answers.speeds
    )  # fmt: skip
    return Table(
        "slip_by_speed", "Slip ratio λ_R and contact-angle ratio k_92 by speed",
        "Means over the trials; the interval covers their scatter and their standard deviations. k_92 ± "
        "standard "
        "error is fitted to the slip.",
        columns(
            ("speed [m/s]", ("speed_mps",)), ("slip [%]", ("slip_ratio",)),
            ("95 % interval [%]", ("slip_ratio_low95", "slip_ratio_high95")),
            ("paper [%]", ("slip_ratio_paper_experiment",)),
            ("paper inside", ("paper_inside_interval",), False), ("k_92 [–]", ("k92", "k92_std")),
            ("paper's k_92 [–]", ("k92_paper",)), ("trials", ("trials",)),
        ),
        rows, bool(answers.virtual),
    )  # fmt: skip


def _decided(value: Number, scale: float = 1.0) -> Cell:
    return Cell(value.text, (scale * value.value,))


def _as_printed(value: float) -> Cell:
    """Return a number of the paper with the digits that it prints."""
    return Cell(f"{value:g}" if math.isfinite(value) else NONE, (value,))


def channel_table(channels: Sequence[ChannelAnswer], virtual: bool) -> Table:
    """Return how well the model explains each quantity over whole trials."""
    rows = tuple(
        (
            words(c.name), words(c.verdict, c.tone), _in_unit(c.rms, c.unit), _in_unit(c.noise, c.unit),
            _in_unit(c.largest, c.unit), words(c.worst or NONE),
        )
        for c in channels
    )  # fmt: skip
    return Table(
        "channels", "Simulated minus measured, by quantity",
        "Root mean square of the difference over whole trials, beside the noise of the measurement (its "
        "standard deviation) and the largest simulated value. Points: percentage points of slip.",
        columns(
            "quantity", "verdict", ("difference, rms", ("rms", "rms_unit")),
            ("noise", ("noise", "noise_unit")),
            ("largest value", ("largest", "largest_unit")), "largest difference",
        ),
        rows, virtual,
    )  # fmt: skip


def _in_unit(value: float, unit: str) -> Cell:
    text = f"{significant(value, 2)} {unit}" if math.isfinite(value) else NONE
    return Cell(text, (value, unit))


def misfit_table(found: dict[tuple[str, str], Gap], virtual: bool) -> Table:
    """Return the difference in each channel and phase."""
    rows = []
    for (_, phase), gap in found.items():
        unit, scale = shown_as(gap.unit)
        sizes = [number(x, 2, scale=scale) for x in (gap.rms, gap.bias, gap.peak)]
        row = (words(gap.name), words(phase), words(tidy_unit(unit)), *sizes)
        rows.append((*row, number(gap.normalised, 2), count(gap.trials)))
    return Table(
        "misfits", "Simulated minus measured, by quantity and phase",
        "Over all trials. The CSV file holds SI units, slip ratios as fractions.",
        columns(
            "quantity", "phase", "unit", ("rms", ("rms_si",)), ("mean", ("bias_si",)),
            ("largest", ("peak_si",)),
            ("rms over noise [–]", ("rms_over_noise",)), ("trials", ("trials",)),
        ),
        tuple(rows), virtual,
    )  # fmt: skip


def law_table(fit: AThetaFit, virtual: bool) -> Table:
    """Return the rival laws for k_92, best first; parameters stand in the CSV file."""
    rows = []
    for law in fit.laws:
        values = "; ".join(f"{name} = {value.value:.6g}" for name, value in law.parameters.items())
        delta = law.aicc - fit.laws[0].aicc
        rows.append(
            (
                Cell(LAWS.get(law.id, law.formula), (law.id,)),
                Cell(str(law.n_parameters), (law.n_parameters, values)),
                number(law.rms, 2), fixed(delta, 1),
            )
        )  # fmt: skip
    return Table(
        "laws", "Laws for k_92 compared", describe_laws(fit),
        columns(
            "law", ("fitted numbers", ("fitted_numbers", "values")), ("rms residual [–]", ("rms",)),
            ("ΔAICc [–]", ("delta_aicc",)),
        ),
        tuple(rows), virtual,
    )  # fmt: skip


LAWS = {
    "exponential": "k_92 = exp(−a_θ v)",
    "linear_slip": "k_92 = b_0 + b_1 λ_R",
    "free": "k_92 constant at each speed",
}


def describe_laws(fit: AThetaFit) -> str:
    """Say which law the data prefer, and how clearly."""
    if len(fit.laws) < 2:
        return "Only one law could be fitted." if fit.laws else "No law could be compared."
    lead = fit.laws[1].aicc - fit.laws[0].aicc
    if not math.isfinite(lead):
        return "Too few values of k_92 for an information criterion of every law."
    first, second = (LAWS.get(law.id, law.formula) for law in fit.laws[:2])
    clear = "clearly better than" if lead > 10 else "better than" if lead > 2 else "hardly better than"
    return (
        f"By the corrected Akaike criterion AICc, {first} is {clear} {second} (ΔAICc {significant(lead, 2)}; "
        "above 10 is decisive)."
    )


def trial_table(result: StudyResult) -> Table:
    """Return one row per trial."""
    mixed = result.virtual and not all(r.trial.info.virtual for r in result.trials)
    rows = []
    for r in result.trials:
        m, fit, repetition = r.comparison.motion, r.comparison.fit, r.trial.info.repetition
        source = "" if m.variant_source == "given" else f" ({m.variant_source})"
        rows.append(
            (
                words(r.trial.name),
                *((words("virtual" if r.trial.info.virtual else "measured"),) if mixed else ()),
                Cell(f"{m.variant.velocity:.3g}{source}", (m.variant.velocity, m.variant_source)),
                Cell(NONE if repetition is None else str(repetition), (repetition,)),
                estimate(m.distance), estimate(m.slip_ratio, 100), fitted(fit.k92, fit.status),
                fitted(fit.k92_trajectory, fit.status_trajectory), late(m.stamps_late),
                words("good" if m.health.good else "doubtful", "good" if m.health.good else "bad"),
                count(len(set(r.trial.warnings) | set(m.warnings))),
            )
        )  # fmt: skip
    return Table(
        "trials", "Trials",
        "Value ± standard deviation of a single trial. Wheel stamps late: how much later the time stamps of "
        "encoders and currents are than those of the IMU; negative where they are earlier.",
        columns(
            "trial", *(("data",) if mixed else ()), ("speed [m/s]", ("speed_mps", "speed_is")),
            ("repetition", ("repetition",)), ("distance [m]", ("distance_m", "distance_std_m")),
            ("λ_R [%]", ("slip_ratio", "slip_ratio_std")),
            ("k_92, steady slip [–]", ("k92", "k92_std", "k92_status")),
            ("k_92, trajectory [–]", ("k92_trajectory", "k92_trajectory_std", "k92_trajectory_status")),
            ("wheel stamps late [ms]", ("wheel_stamps_late_s", "wheel_stamps_late_std_s")),
            ("estimate", ("estimate",), False), ("warnings", ("warnings",)),
        ),
        tuple(rows), result.virtual and not mixed,
    )  # fmt: skip


def late(offset: Estimate) -> Cell:
    """Return by how much stamps are late [ms]."""
    return Cell(plus_minus(offset, scale=1e3), (offset.value, offset.std))


def fitted(value: Estimate, status: FitStatus) -> Cell:
    """Return a fitted k_92; where it is no inner optimum, with the reason."""
    text, raw = plus_minus(value), (value.value, value.std, STATUS[status])
    return Cell(text, raw) if status == "ok" else Cell(f"{text} ({STATUS[status]})", raw, "fair")


def k92_table(fits: Sequence[K92Fit]) -> Table:
    """Return k_92 of each trial, by the steady slip and by the whole trajectory."""
    rows = tuple(
        (
            words(f.trial), Cell(f"{f.variant.velocity:.3g}", (f.variant.velocity,)),
            estimate(f.slip_measured, 100),
            fitted(f.k92, f.status), fitted(f.k92_trajectory, f.status_trajectory),
        )
        for f in fits
    )  # fmt: skip
    return Table(
        "k92", "k_92 of each trial", "Value ± standard deviation.",
        columns(
            "trial", ("speed [m/s]", ("speed_mps",)), ("λ_R [%]", ("slip_ratio", "slip_ratio_std")),
            ("k_92, steady slip [–]", ("k92", "k92_std", "k92_status")),
            ("k_92, trajectory [–]", ("k92_trajectory", "k92_trajectory_std", "k92_trajectory_status")),
        ),
        rows, any(f.virtual for f in fits),
    )  # fmt: skip


def parameter_table(source: Source) -> Table:
    """Return every parameter in force and its origin."""
    rows = tuple(
        (words(key), Cell(value, (value,)), words(tidy_unit(unit)), words(origin))
        for key, value, unit, origin in source.parameters
    )
    head = columns("parameter", ("value", ("value",)), "unit", "origin")
    return Table("parameters", "Parameters in force", "Each with the file it was read from.", head, rows)


def input_table(source: Source) -> Table:
    """Return the files that were read; of an absolute path only the name."""
    rows = tuple((words(shown_path(i.path)), words(i.sha256)) for i in source.inputs)
    return Table("inputs", "Files that were read", "", columns("file", "SHA-256"), rows)


def shown_path(path: Path) -> str:
    """Return a path as a report may show it: of an absolute one only the name."""
    return path.name if path.is_absolute() else path.as_posix()
