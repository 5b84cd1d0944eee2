"""What the missing force, moment or torque looks like where no candidate explains it."""

from __future__ import annotations

from granite_lab.discovery.finding import Finding
from granite_lab.reporting.discovery.names import LAW, term_of
from granite_lab.reporting.rounding import significant, with_unit

FORMULAS = {
    "motion": "",
    "velocity": "v / (0.5 m/s)",
    "velocity_squared": "(v / (0.5 m/s))²",
    "slip": "s / 0.2",
    "sinking": "(dz/dt) / (20 mm/s)",
    "start": "exp(−x / 0.2 m)",
    "distance": "x / (1 m)",
    "cos_angle": "cos θ",
    "sin_angle": "sin θ",
    "time": "t / (5 s)",
}
"""Terms of an empirical law as formulas."""


def law_formulas(finding: Finding) -> tuple[str, ...]:
    """Return the empirical law of a finding as one formula per quantity, with its numbers."""
    sums: dict[str, str] = {}
    for e in finding.effects:
        found = term_of(e.id) if e.empirical else None
        if found is None or not e.parameters:
            continue
        (target, term), p = found, e.parameters[0]
        number = with_unit(significant(abs(p.estimate.value), 3), p.unit)
        sign = "−" if p.estimate.value < 0 else "+"
        part = f"{number} · {FORMULAS[term]}" if FORMULAS.get(term) else number
        sums[target] = f"{sums[target]} {sign} {part}" if target in sums else f"{sign.strip('+')}{part}"
    return tuple(f"{LAW[target]} = {sums[target]}" for target in LAW if target in sums)
