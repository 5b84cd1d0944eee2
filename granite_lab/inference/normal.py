"""The normal equations of all trials, with the discrepancy integrated out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dpotrf, dtrtri, dtrtrs
from scipy.optimize import lsq_linear

from granite_lab.inference.constants import FORMULA_ERROR, POOR_FIT, TINY
from granite_lab.inference.discrepancy import variances
from granite_lab.logs.trial import Array

Places = npt.NDArray[np.int64]

Factor = tuple[Array, Array, float]

JITTER = 1e-11
"""Share of its scaled diagonal that a precision gets, so that one that is nearly singular has a factor."""


@dataclass(frozen=True, eq=False)
class Scales:
    """What is learnt by the marginal likelihood.

    Attributes:
        discrepancy: of the model, as a share of a channel's rms in motion, where `discrepancies` has none.
        formula: error of the effects' formulas, as a share of their traces, where `formulas` has none.
        priors: name of a number that differs from trial to trial to the std of its prior.
        discrepancies: channel to that share as learnt.
        formulas: channel to the error of the formulas as learnt: one may be exact for a speed and rough for
            a pitch rate.
        noise_factor: channel to how many times larger its noise is than the repetitions show; above one where
            the model misses what is not smooth, so that a bad fit is not believed to the last digit.
    """

    discrepancy: float
    formula: float
    priors: Mapping[str, float] = field(default_factory=dict)
    discrepancies: Mapping[str, float] = field(default_factory=dict)
    formulas: Mapping[str, float] = field(default_factory=dict)
    noise_factor: Mapping[str, float] = field(default_factory=dict)

    def discrepancy_of(self, channel: str) -> float:
        """Return the discrepancy of a channel."""
        return self.discrepancies.get(channel, self.discrepancy)

    def formula_of(self, channel: str) -> float:
        """Return the error of the formulas in a channel."""
        return self.formulas.get(channel, self.formula)

    @property
    def largest(self) -> float:
        """The largest share that was learnt."""
        return max(self.discrepancies.values(), default=self.discrepancy)

    @property
    def poor_fit(self) -> bool:
        """Whether the noise of a channel is so much larger than its repetitions show that the fit is bad."""
        return max(self.noise_factor.values(), default=1.0) > POOR_FIT

    @property
    def is_misfit(self) -> bool:
        """Whether the model is off by more than formulas are, in the noise or as a share of a channel."""
        return self.poor_fit or self.largest > FORMULA_ERROR[1]


@dataclass(frozen=True, eq=False)
class Rows:
    """The bins of one channel of one trial, whitened.

    Attributes:
        trial: its number.
        bins: place of the bins in the trial's whitened residual.
        place: (k,) places of the columns among those of the command.
        columns: (n, k).
        basis: (n, m) of the discrepancy.
    """

    trial: int
    bins: slice
    place: Places
    columns: Array
    basis: Array


@dataclass(frozen=True, eq=False)
class ChannelPart:
    """One channel of one command, over one stretch of it.

    Attributes:
        name: of the channel.
        kind: (m,) kinds of the columns of its discrepancy, see `Problem.bases`.
        rows: per trial that has the channel.
        gram: (a, a) inner products of all columns, the residual's last.
        basis: (m, m) inner products of the discrepancy's columns.
        across: (m, a) products of both.
    """

    name: str
    kind: Places
    rows: tuple[Rows, ...]
    gram: Array
    basis: Array
    across: Array
    _factor: dict[tuple[float, float, float], Factor] = field(default_factory=dict, init=False, repr=False)

    def factor(self, scales: Scales) -> Factor:
        """Return sqrt(Λ), the upper Cholesky factor of 1 + sqrt(Λ) G sqrt(Λ), and log det of the latter.

        The last one is remembered, as each step of a fit asks for it several times.
        """
        noise_factor = scales.noise_factor.get(self.name, 1.0)
        share, formula = scales.discrepancy_of(self.name), scales.formula_of(self.name)
        key = share, formula, noise_factor
        if (factor := self._factor.get(key)) is not None:
            return factor
        root = np.sqrt(variances(self.kind, share, formula)) / noise_factor
        M = root[:, None] * self.basis * root
        M.flat[:: root.size + 1] += 1
        U, failed = dpotrf(M) if root.size else (M, 0)
        if failed:  # where the unit is lost in rounding, add what rounding takes
            lost = np.finfo(float).eps * np.trace(M) * np.eye(root.size)
            U = cholesky(M + lost, check_finite=False)
        self._factor.clear()
        self._factor[key] = root, U, 2 * float(np.log(np.diag(U)).sum())
        return self._factor[key]

    def inverse(self, scales: Scales) -> tuple[Array, Array]:
        """Return sqrt(Λ), and the inverse of the upper Cholesky factor; see `factor`."""
        root, U, _ = self.factor(scales)
        return root, np.asarray(dtrtri(U)[0] if U.size else U)

    def marginal(self, scales: Scales) -> tuple[Array, float]:
        """Return the (a, a) matrix with the discrepancy integrated out, and the log determinant it brings."""
        root, U, logdet = self.factor(scales)
        X = _solved(U, root[:, None] * self.across)
        return (self.gram - X.T @ X) / scales.noise_factor.get(self.name, 1.0) ** 2, logdet

    def amplitudes(self, step: Array, scales: Scales, covariance: Array | None = None) -> tuple[Array, Array]:
        """Return mean and variance of the amplitudes of the discrepancy, by default the parameters given.

        Args:
            step: (a,) change of each column's parameter with its sign turned, 1 for the residual.
            scales: learnt.
            covariance: (a, a) of the columns' parameters, 0 for the residual.
        """
        root, inverse = self.inverse(scales)
        noise_factor = scales.noise_factor.get(self.name, 1.0)
        variance = (noise_factor * root) ** 2 * (inverse**2).sum(axis=1)
        if covariance is None:
            mean = root * (inverse @ (inverse.T @ (root * (self.across @ step))))
            return np.asarray(mean), np.asarray(variance)
        follow = root[:, None] * (inverse @ (inverse.T @ (root[:, None] * self.across)))
        return np.asarray(follow @ step), np.asarray(variance + np.sum(follow @ covariance * follow, axis=1))

    def misfit(self, white: Sequence[Array], scales: Scales) -> float:
        """Return the sum of squares of other whitened residuals once the discrepancy is refitted."""
        root, U, _ = self.factor(scales)
        b = np.sum([r.basis.T @ white[r.trial][r.bins] for r in self.rows], axis=0)
        x = _solved(U, root * b)
        squares = sum(float(w @ w) for w in (white[r.trial][r.bins] for r in self.rows))
        return (squares - float(x @ x)) / scales.noise_factor.get(self.name, 1.0) ** 2

    def at(self, white: Sequence[Array]) -> ChannelPart:
        """Return the same with other whitened residuals."""
        gram, across = self.gram.copy(), self.across.copy()
        gram[-1], across[:, -1] = 0.0, 0.0
        for r in self.rows:
            w = white[r.trial][r.bins]
            gram[-1, r.place] += r.columns.T @ w
            gram[-1, -1] += w @ w
            across[:, -1] += r.basis.T @ w
        gram[:, -1] = gram[-1]
        return replace(self, gram=gram, across=across)


@dataclass(frozen=True, eq=False)
class CommandPart:
    """One command.

    Attributes:
        place: (a,) places of its columns among all columns, the residual's last.
        channels: its channels.
    """

    place: Places
    channels: tuple[ChannelPart, ...]

    def without_rows(self) -> CommandPart:
        """Return the same without the rows, which only other residuals need."""
        return replace(self, channels=tuple(replace(c, rows=()) for c in self.channels))

    def place_in(self, size: int) -> Places:
        """Return the places among `size` columns that begin and end as all columns, further ones left out."""
        return np.where(self.place == self.place[-1], size - 1, self.place)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """All commands; the columns are the parameters, then candidates, then the residual.

    Attributes:
        parts: per command.
        size: number of columns, the residual included.
        parameters: number of parameters.
    """

    parts: tuple[CommandPart, ...]
    size: int
    parameters: int
    _marginals: dict[object, tuple[Array, float]] = field(default_factory=dict, init=False, repr=False)

    def at(self, white: Sequence[Array]) -> NormalEquations:
        """Return the same with other whitened residuals."""
        parts = tuple(replace(p, channels=tuple(c.at(white) for c in p.channels)) for p in self.parts)
        return replace(self, parts=parts)

    def without_rows(self) -> NormalEquations:
        """Return the same without the rows, which only other residuals need."""
        return replace(self, parts=tuple(part.without_rows() for part in self.parts))

    def marginal(self, scales: Scales, only: Sequence[int] | None = None) -> tuple[Array, float]:
        """Integrate the discrepancy out.

        Args:
            scales: learnt.
            only: numbers of the parts that take part; all by default.

        Returns:
            the (size, size) matrix, and the log determinant of what was integrated out.
        """
        M = np.zeros((self.size, self.size))
        logdet = 0.0
        for number in range(len(self.parts)) if only is None else only:
            place = self.parts[number].place
            block, more = self._of_part(number, scales)
            M[np.ix_(place, place)] += block
            logdet += more
        return M, logdet

    def _of_part(self, number: int, scales: Scales) -> tuple[Array, float]:
        """Return the matrix and the log determinant of one part; they are remembered."""
        learnt = (*scales.noise_factor.items(), *scales.discrepancies.items(), *scales.formulas.items())
        key = number, scales.discrepancy, scales.formula, learnt
        if key not in self._marginals:
            marginals = [channel.marginal(scales) for channel in self.parts[number].channels]
            self._marginals[key] = sum(M for M, _ in marginals), sum(logdet for _, logdet in marginals)  # type: ignore[assignment]
        return self._marginals[key]

    def misfits(self, white: Sequence[Array], scales: Scales) -> dict[str, float]:
        """Return channel to the misfit of other whitened residuals, the discrepancy refitted."""
        total: dict[str, float] = {}
        for part in self.parts:
            for c in part.channels:
                total[c.name] = total.get(c.name, 0.0) + c.misfit(white, scales)
        return total


def _solved(U: Array, b: Array) -> Array:
    """Return the solution of U^T x = b; LAPACK complains on stdout of a matrix without rows."""
    return np.asarray(dtrtrs(U, b, trans=1)[0] if U.size else b)


def least_within(N: Array, right: Array, low: Array, high: Array, damping: float = 0.0) -> Array:
    """Return the (p,) step x to the least of x^T N x - 2 x^T right within bounds.

    A step that is only cut off at the bounds may lead uphill.

    Args:
        N: (p, p), positive definite.
        right: (p,).
        low, high: (p,) least and largest step.
        damping: added to the diagonal of N, which is scaled to ones.

    Raises:
        numpy.linalg.LinAlgError: N leaves a direction open.
    """
    scale = 1 / np.sqrt(np.fmax(np.diag(N), TINY))
    bounded = np.isfinite(low) | np.isfinite(high)
    order = np.argsort(bounded, kind="stable")  # the last rows of the factor hold the bounded numbers alone
    size, lower, upper = scale[order], (low / scale)[order], (high / scale)[order]
    factor = cholesky(
        N[np.ix_(order, order)] * np.outer(size, size) + damping * np.eye(size.size), lower=True
    )
    white = solve_triangular(factor, size * right[order], lower=True)
    x = solve_triangular(factor, white, lower=True, trans="T")
    if np.any((x < lower) | (x > upper)):
        free = int(np.sum(~bounded))
        rest, of_free = slice(free, None), factor[:free, :free]
        bounds = lower[rest], upper[rest]
        x[rest] = lsq_linear(factor[rest, rest].T, white[rest], bounds, method="bvls").x
        remaining = white[:free] - factor[rest, :free].T @ x[rest]
        x[:free] = solve_triangular(of_free, remaining, lower=True, trans="T")
    step = np.empty_like(x)
    step[order] = size * x
    return step


@dataclass(frozen=True, eq=False)
class Posterior:
    """The linear posterior of the parameters about a point.

    Attributes:
        step: (p,) from the point to the mean.
        evidence: logarithm of the marginal likelihood, up to a constant of the noise.
        misfit: sum of squares left at the mean, priors included.
        rest: (k+1, k+1) the matrix of the candidates and the residual, the parameters integrated out.
        follow: (p, k) how far the parameters follow the candidates.
        factor: (p, p) lower Cholesky factor of the precision, each row over `scale`.
        scale: (p,) that brings the precision's diagonal to one.
    """

    step: Array
    evidence: float
    misfit: float
    rest: Array
    follow: Array
    factor: Array
    scale: Array

    @cached_property
    def covariance(self) -> Array:
        """(p, p) of the parameters."""
        inverse = cho_solve((self.factor, True), np.diag(self.scale), check_finite=False)
        return np.asarray(self.scale[:, None] * inverse)

    @property
    def predicted_drop(self) -> float:
        """The drop of the sum of squares, priors included, from the point to the mean."""
        return float(np.sum((np.tril(self.factor).T @ (self.step / self.scale)) ** 2))


def posterior(M: Array, logdet: float, precision: Array, pull: Array) -> Posterior:
    """Return the posterior of the parameters.

    Args:
        M: of `NormalEquations.marginal`.
        logdet: of the discrepancy.
        precision: (p,) inverse variances of the priors, 0 for a flat one.
        pull: (p,) means of the priors minus the present values.
    """
    p = precision.size
    N = M[:p, :p] + np.diag(precision)
    right = M[:p, p:].copy()
    right[:, -1] += precision * pull
    scale = 1 / np.sqrt(np.fmax(np.diag(N), TINY))
    factor = cho_factor(N * np.outer(scale, scale) + JITTER * np.eye(p), lower=True, check_finite=False)
    solved = scale[:, None] * cho_solve(factor, scale[:, None] * right, check_finite=False)
    rest = M[p:, p:] - right.T @ solved
    rest[-1, -1] += float(precision @ pull**2)
    informative = precision > 0
    logdet_N = 2 * float(np.log(np.diag(factor[0])).sum()) - 2 * float(np.log(scale).sum())
    evidence = -0.5 * (rest[-1, -1] + logdet + logdet_N - float(np.log(precision[informative]).sum()))
    return Posterior(solved[:, -1], evidence, float(rest[-1, -1]), rest, solved[:, :-1], factor[0], scale)
