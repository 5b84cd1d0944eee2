"""Screening of the dictionary: what each term would show, from the impulse responses alone.

To first order a term acts as the force that it is along the motion of the fit. The responses to pushes give
the response to any force, so that hundreds of terms need no simulation of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from granite_lab.discovery.heldout import Equations
from granite_lab.discovery.impulses import ImpulseResponses
from granite_lab.inference.constants import EFFECT_ODDS, LINEAR
from granite_lab.inference.gap import tolerated
from granite_lab.inference.normal import posterior
from granite_lab.inference.priors import width_of
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.command import V_FLOOR, smoothstep
from granite_lab.model.dictionary import QUANTITIES, Motion, Term, phi, place_of
from granite_lab.model.effect import activate
from granite_lab.model.latent import PUSHES, SPACING, WIDTH
from granite_lab.model.simulator import along
from granite_lab.model.symbols import ModelParameters
from granite_lab.parameters import GRAVITY

OF_AXLE = (
    "slip_{}", "sinkage_{}_m", "v_mps", "x_m", "theta_{}_rad", "torque_{}_Nm", "omega_{}_radps",
    "force_x_{}_N", "force_z_{}_N", "moment_{}_Nm",
)  # fmt: skip
"""Outputs of a run that tell of an axle."""


def forces(problem: Problem, impulses: ImpulseResponses, number: int, terms: Sequence[Term]) -> Array:
    """Return the (terms, K) amplitudes of the pushes of an input that act as each term of unit size does.

    Args:
        problem: the trials.
        impulses: about a fit.
        number: of the input.
        terms: of the dictionary, those without a group among them.

    Raises:
        EstimateError: the run has no solution.
    """
    scenario = problem.pool.scenario
    task = problem.centre(impulses.fit.point, number)
    p, effects = scenario.parameters(task), scenario.active(task)
    factors = [t for t in terms if QUANTITIES[t.quantity].factor and not t.groups]
    sizes = [np.zeros(len(factors)), *(LINEAR * np.eye(len(factors)))]
    others = [[activate(t, {"a": float(a)}) for t, a in zip(factors, row, strict=True)] for row in sizes]
    names = tuple(dict.fromkeys(name.format(axle) for axle in "fr" for name in OF_AXLE))
    plain, *changed = along(p, effects, others, names, scenario.accuracy)
    row = {name: k for k, name in enumerate(names)}
    by_factor = {t.quantity: (after - plain) / LINEAR for t, after in zip(factors, changed, strict=True)}
    i = problem.inputs[number][0]
    trial, command = problem.trials[i], problem.command_of[i]
    of = {axle: [plain[row[name.format(axle)]] for name in OF_AXLE] for axle in "fr"}
    groups = {t.groups for t in terms}
    φ = {axle: {g: _phi(g, of[axle], axle == "f", p) for g in groups} for axle in "fr"}
    amplitudes = np.zeros((len(terms), impulses.kind[command].size))
    for n, term in enumerate(terms):
        of_term = {axle: φ[axle][term.groups] for axle in "fr"}
        change = (
            {name: by_factor[term.quantity][k] for name, k in row.items()}
            if term.quantity in by_factor
            else {}
        )
        acting = _acting(term, of_term, change, of, p) / impulses.sizes[:, None]
        for q in range(len(PUSHES)):
            at = impulses.kind[command] == q
            amplitudes[n, at] = np.interp(impulses.centres[command][at], trial.t, acting[q])
    overlap = WIDTH * np.sqrt(2 * np.pi) / SPACING
    return np.asarray(amplitudes / overlap)  # neighbouring pushes overlap


def _phi(groups: tuple[str, ...], of: Sequence[Array], front: bool, p: ModelParameters) -> Array:
    """Return (N,) φ of an axle along a run, without the part near standstill."""
    λ, z, v, x, θ, T, ω = (ca.DM(values) for values in of[:7])
    moving = smoothstep(ca.fabs(ω * p.wheels.radius) / (2 * V_FLOOR))
    return np.asarray(moving * phi(groups, Motion(λ, z, v, x, place_of(x, front, p), θ, T), p)).ravel()


def _acting(
    term: Term,
    φ: Mapping[str, Array],
    change: Mapping[str, Array],
    of: Mapping[str, Sequence[Array]],
    p: ModelParameters,
) -> Array:
    """Return the (5, N) force, lift, moment and torques against the wheels that a term of unit size is.

    Args:
        term: the term.
        φ: per axle (N,).
        change: output to its (N,) change by the factor, for a term that is a factor of the soil.
        of: per axle the outputs `OF_AXLE`.
        p: of the run.
    """
    size = φ["f"].size
    acting = dict.fromkeys(PUSHES, np.zeros(size))
    mean, weight = (φ["f"] + φ["r"]) / 2, p.chassis.total_mass * GRAVITY
    arm = weight * p.wheels.radius
    if term.quantity in ("force", "lift"):
        acting[term.quantity] = weight * mean
    elif term.quantity == "moment":
        acting["moment"] = arm * mean
    elif term.quantity in ("torque_f", "torque_r"):
        acting[term.quantity] = arm / 4 * φ[term.quantity[-1]]
    elif term.quantity == "drive":
        for axle in "fr":
            acting[f"torque_{axle}"] = -of[axle][OF_AXLE.index("torque_{}_Nm")] * φ[axle]
    else:
        for axle, side in (("f", 1), ("r", -1)):
            x, z, M = (change[f"{n}_{axle}_{u}"] * φ[axle] for n, u in
                       (("force_x", "N"), ("force_z", "N"), ("moment", "Nm")))  # fmt: skip
            lever = side * p.chassis.wheel_base / 2 - p.chassis.com_x
            acting["force"] = acting["force"] + 2 * x
            acting["lift"] = acting["lift"] + 2 * z
            acting["moment"] = acting["moment"] - 2 * x * p.chassis.com_z - 2 * z * lever  # (22)
            acting[f"torque_{axle}"] = -M
    return np.stack([acting[name] for name in PUSHES])


class ScreenedTerms:
    """All terms about one fit, as columns of the normal equations of each trial.

    Args:
        problem: the trials.
        impulses: about the fit.
        terms: of the dictionary.
    """

    def __init__(self, problem: Problem, impulses: ImpulseResponses, terms: Sequence[Term]) -> None:
        self.problem, self.fit, self.terms = problem, impulses.fit, tuple(terms)
        fit = self.fit
        self.normal = problem.normal(
            fit.point, fit.derivatives, fit.residuals, apart=True, further=impulses.further, keep=False
        )
        acting = [forces(problem, impulses, k, terms) for k, _ in enumerate(problem.inputs)]
        self._acting = [acting[problem.input_of[i]] for repetitions in problem.commands for i in repetitions]
        self._parts: dict[tuple[int, float], tuple[Array, float]] = {}

    def part(self, number: int, share: float) -> tuple[Array, float]:
        """Return the matrix of one trial: its parameters, the terms, the residual; and a log determinant."""
        key = number, share
        if key not in self._parts:
            place = self.normal.parts[number].place
            M, logdet = self.normal.marginal(tolerated(self.fit.scales, share), [number])
            M = M[np.ix_(place, place)]
            n, K = len(self.terms), self._acting[number].shape[1]
            first = place.size - 1 - K
            X = np.zeros((place.size, first + n + 1))
            X[:first, :first] = np.eye(first)
            X[first:-1, first:-1] = self._acting[number].T
            X[-1, -1] = 1.0
            self._parts[key] = X.T @ M @ X, logdet
        return self._parts[key]

    def beside(self, chosen: Sequence[int]) -> EquationsWithTerms:
        """Return the equations with some terms in the model."""
        return EquationsWithTerms(self, chosen)

    def gains(self, chosen: Sequence[int], share: float) -> Array:
        """Return the (terms,) log Bayes factors of one more term, the odds of each included.

        Args:
            chosen: places of the terms that are in the model; they gain nothing.
            share: discrepancy that is taken for granted.
        """
        equations = self.beside(range(len(self.terms)))
        M, logdet = equations.marginal(share, range(len(self.normal.parts)))
        n = len(self.terms)
        widths = np.array([width_of(t.parameters[0]) for t in self.terms])
        p = equations.precision.size - n
        rest = posterior(M, logdet, equations.precision[:p], equations.pull[:p]).rest
        scaled = rest * np.outer(np.append(widths, 1.0), np.append(widths, 1.0))
        if chosen:
            at = list(chosen)
            inner = np.eye(len(at)) + scaled[np.ix_(at, at)]
            scaled = scaled - scaled[:, at] @ np.linalg.solve(inner, scaled[at, :])
        power, pull = np.fmax(np.diag(scaled)[:n], 0.0), scaled[:n, -1]
        gains = 0.5 * (pull**2 / (1 + power) - np.log1p(power)) + np.log(EFFECT_ODDS / n)
        gains[list(chosen)] = -np.inf
        return np.asarray(gains)

    def sizes(self, chosen: Sequence[int], share: float) -> Array:
        """Return the likeliest coefficients of some terms."""
        equations = self.beside(chosen)
        M, logdet = equations.marginal(share, range(len(self.normal.parts)))
        step = posterior(M, logdet, equations.precision, equations.pull).step
        return step[step.size - len(chosen) :]


class EquationsWithTerms(Equations):
    """The normal equations with some terms in the model; see `Equations`."""

    def __init__(self, screened: ScreenedTerms, chosen: Sequence[int]) -> None:
        self.problem, self.fit = screened.problem, screened.fit
        self.normal, self.screened = screened.normal, screened
        self.chosen = np.array(chosen, dtype=int)
        std, mean = screened.problem.prior(self.fit.point, self.fit.scales)
        sizes = [screened.terms[k].parameters[0] for k in chosen]
        self.precision = np.append(std, [width_of(p) for p in sizes]) ** -2.0
        self.pull = np.append(mean - self.fit.point.vector, np.zeros(len(sizes)))
        low, high = (side - self.fit.point.vector for side in screened.problem.bounds(self.fit.point))
        self.low, self.high = np.append(low, [p.low for p in sizes]), np.append(high, [p.high for p in sizes])

    def marginal(self, share: float, only: Sequence[int]) -> tuple[Array, float]:
        """Return the matrix of some trials under a discrepancy of some share, and its log determinant."""
        size = self.precision.size + 1
        M, total = np.zeros((size, size)), 0.0
        p = self.normal.parameters
        for number in only:
            block, logdet = self.screened.part(number, share)
            place = self.normal.parts[number].place
            place = place[place < p]
            here = np.concatenate([np.arange(place.size), place.size + self.chosen, [block.shape[0] - 1]])
            there = np.concatenate([place, np.arange(p, size)])
            M[np.ix_(there, there)] += block[np.ix_(here, here)]
            total += logdet
        return M, total
