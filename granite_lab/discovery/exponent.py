"""a_θ with what was found in the model, beside a_θ by the files."""

from __future__ import annotations

import math

from granite_lab.discovery.finding import Finding
from granite_lab.estimate import Estimate, Part
from granite_lab.fitting.fit import AThetaFit, View, views_of
from granite_lab.fitting.k92 import SHARED_AS


def views(finding: Finding, fit: AThetaFit | None) -> tuple[View, ...]:
    """Return a_θ by the files, with their uncertainty, and with the soil fitted and what was found.

    The last is that of the likeliest model, fitted to all sensors together with soil, gains and offsets. An
    error of the wheel radius that all trials share is no part of that fit: what it does to the slip is added.

    Args:
        finding: with the common sand as fitted.
        fit: to the steady slip of the same trials; None where it could not be made.
    """
    value, std = finding.fitted_sand["a_theta"].value, finding.sand["a_theta"].std
    parts = [Part("fit to all sensors", "A", "log-normal", "1", std, value * std)]
    if fit is not None:
        radius = [part for part in fit.shared if part.name == SHARED_AS["radius"]]
        parts += [part.times(value / fit.a_theta.value) for part in radius]
    std = math.hypot(*(part.contribution for part in parts))
    low, high = Estimate(math.log(value), std / value).interval()
    augmented = View("found", Estimate(value, std), (math.exp(low), math.exp(high)), tuple(parts))
    return (*(views_of(fit) if fit is not None else ()), augmented)
