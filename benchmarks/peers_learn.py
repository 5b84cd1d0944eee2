"""Peers that learn the residual from the motion: sparse regression as in PySINDy, and a Gaussian process."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.estimation.motion import Motion
from granite_lab.inference.fit import Fit
from granite_lab.inference.pool import SAND_PER_TRIAL, SIGNALS
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.command import velocities_at
from granite_lab.parameters import Variant

Places = Sequence[int]

NAMES = ("commanded speed", "commanded acceleration", "wheel speed", "slip velocity", "acceleration")
"""The inputs of both peers."""

INPUTS = ("command", "trial")
"""Where wheel speed, slip and acceleration come from: a simulation of the command, or the trial itself."""

THRESHOLDS = (0.01, 0.03, 0.1, 0.3)
"""Thresholds of STLSQ that are tried, on residuals and terms of unit std."""

POINTS = 300
"""Bins from which a Gaussian process learns: its time grows with their third power."""

Learn = Callable[[Places], list[Array]]


@dataclass(frozen=True, eq=False)
class Table:
    """What the peers learn from.

    Attributes:
        problem: the trials.
        base: the fit without effects, whose residuals are learnt.
        inputs: per trial (n, k) `NAMES` at its bins.
    """

    problem: Problem
    base: Fit
    inputs: Sequence[Array]

    def rows(self, trials: Places, channel: str) -> tuple[Array, Array]:
        """Return (m, k) inputs and (m,) residuals of a channel in some trials, where it was measured."""
        own = [i for i in trials if channel in self.problem.trials[i].channels]
        y = [self.base.residuals[i][self.problem.trials[i].channels.index(channel)] for i in own]
        x, residual = np.concatenate([self.inputs[i] for i in own]), np.concatenate(y)
        known = np.isfinite(residual) & np.isfinite(x).all(axis=1)
        return x[known], residual[known]

    def command_of(self, rest: Places) -> tuple[int, bool]:
        """Return the command that some trials lack, or lack a trial of, and whether they lack all of it."""
        for number, own in enumerate(self.problem.commands):
            if not set(own) <= set(rest):
                return number, not set(own) & set(rest)
        raise ValueError("no trial is left out")

    def predicted(self, out: Places, learn: Callable[[Places, str], Callable[[Array], Array]]) -> list[Array]:
        """Return per trial (C, n) the residual as a peer predicts it that has not seen some trials."""
        trials, found = self.problem.trials, [np.zeros_like(r) for r in self.base.residuals]
        rest = [i for i in range(len(trials)) if i not in out]
        for channel in dict.fromkeys(c for t in trials for c in t.channels):
            if not any(channel in trials[i].channels for i in rest):
                continue
            law = learn(rest, channel)
            for i, t in enumerate(trials):
                if channel in t.channels:
                    x = np.nan_to_num(self.inputs[i])
                    found[i][t.channels.index(channel)] = law(x)
        return found


def simulated(problem: Problem, base: Fit) -> list[Array]:
    """Return the inputs of each trial as the model without effects moves."""
    found = []
    front, rear, body = (SIGNALS.index(name) for name in ("enc_f_rad", "enc_r_rad", "v_mps"))
    responses = problem.respond([problem.task(base.point, i) for i, _ in enumerate(problem.trials)])
    assert responses is not None, "a fit has a solution"
    for t, response, x in zip(problem.trials, responses, base.point.trials, strict=True):
        wheel = t.radius * np.gradient((response[front] + response[rear]) / 2, t.t)
        at = t.observation.t - x[SAND_PER_TRIAL]
        rows = (wheel, wheel - response[body], np.gradient(response[body], t.t))
        found.append(_inputs(at, t.observation.variant, [np.interp(at, t.t, row) for row in rows]))
    return found


def measured(problem: Problem, motions: Mapping[str, Motion]) -> list[Array]:
    """Return the inputs of each trial as they were estimated from it, by Kalman filter and smoother."""
    found = []
    for t in problem.trials:
        motion = motions[t.observation.name]
        at = t.observation.t
        rows = (np.nanmean(motion.v_wheel, axis=1), motion.slip_velocity, np.gradient(motion.v, motion.t))
        stamps = motion.t - t.observation.t_start
        found.append(_inputs(at, t.observation.variant, [np.interp(at, stamps, row) for row in rows]))
    return found


def _inputs(at: Array, command: Variant, rows: Sequence[Array]) -> Array:
    commanded = velocities_at(at, command)
    return np.column_stack([commanded, np.gradient(commanded, at), *rows])


def residuals_without(base: Fit, predicted: Sequence[Array]) -> tuple[Array, ...]:
    """Return the residuals less what a peer predicts of them."""
    return tuple(r - p for r, p in zip(base.residuals, predicted, strict=True))


def _scaled(values: Array) -> tuple[Array, Array]:
    """Return mean and std of columns; 1 where they do not vary."""
    std = values.std(axis=0)
    return values.mean(axis=0), np.where(std > 0, std, 1.0)


def sparse(table: Table) -> Learn:
    """Return a peer that learns by sequentially thresholded least squares on products of two inputs.

    S. L. Brunton, J. L. Proctor, J. N. Kutz, Discovering governing equations from data by sparse
    identification of nonlinear dynamical systems, PNAS 113 (2016) 3932-3937. The threshold is that with the
    least error on speeds left out of those that are learnt from; of a trial that is left out that which is
    chosen without its whole command.
    """
    from pysindy import STLSQ, PolynomialLibrary  # noqa: PLC0415, of the extra `peers`

    def law(x: Array, y: Array, threshold: float) -> Callable[[Array], Array]:
        (centre, width), (mean, std) = _scaled(x), _scaled(y)
        terms = PolynomialLibrary(degree=2).fit((x - centre) / width)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that no term is left
            found = STLSQ(threshold=threshold).fit(
                np.asarray(terms.transform((x - centre) / width)), (y - mean) / std
            )
        coefficients = np.asarray(found.coef_)[0]

        def predict(new: Array) -> Array:
            return np.asarray(
                mean + std * (np.asarray(terms.transform((new - centre) / width)) @ coefficients)
            )

        return predict

    chosen: dict[tuple[int, str], float] = {}

    def learn(rest: Places, channel: str) -> Callable[[Array], Array]:
        seen = [i for i in rest if channel in table.problem.trials[i].channels]
        groups = [g for own in table.problem.commands if (g := [i for i in own if i in seen])]

        def error(threshold: float) -> float:
            total = 0.0
            for out in groups:
                x, y = table.rows([i for i in seen if i not in out], channel)
                new, true = table.rows(out, channel)
                total += float(np.sum((law(x, y, threshold)(new) - true) ** 2))
            return total

        command, whole = table.command_of(rest)
        if whole or (command, channel) not in chosen:
            chosen[command, channel] = min(THRESHOLDS, key=error) if len(groups) > 1 else THRESHOLDS[0]
        return law(*table.rows(rest, channel), chosen[command, channel])

    return lambda out: table.predicted(out, learn)


def process(table: Table) -> Learn:
    """Return a peer that learns by a Gaussian process with a width for each input and white noise.

    Of a trial that is left out the widths are those learnt without its whole command.
    """
    from sklearn.gaussian_process import GaussianProcessRegressor  # noqa: PLC0415, of the extra `peers`
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel  # noqa: PLC0415

    kernels: dict[tuple[int, str], object] = {}

    def learn(rest: Places, channel: str) -> Callable[[Array], Array]:
        x, y = table.rows(rest, channel)
        (centre, width), (mean, std) = _scaled(x), _scaled(y)
        some = spread((x - centre) / width, POINTS)
        command, whole = table.command_of(rest)
        key, start = (command, channel), ConstantKernel() * RBF(np.ones(x.shape[1])) + WhiteKernel()
        known = None if whole else kernels.get(key)
        gp = GaussianProcessRegressor(known or start, optimizer=None if known else "fmin_l_bfgs_b")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that a width has reached its bound
            gp.fit((x[some] - centre) / width, (y[some] - mean) / std)
        kernels.setdefault(key, gp.kernel_)
        return lambda new: np.asarray(mean + std * gp.predict((new - centre) / width))

    return lambda out: table.predicted(out, learn)


def spread(x: Array, count: int) -> Places:
    """Return the places of rows that cover the inputs evenly: each is the farthest from those before it.

    Most bins are of steady motion; drawn evenly in time they would leave the transients out.
    """
    places, away = [0], np.full(len(x), np.inf)
    while len(places) < min(count, len(x)):
        away = np.minimum(away, np.sum((x - x[places[-1]]) ** 2, axis=1))
        places.append(int(np.argmax(away)))
    return places


PEERS: Mapping[str, Callable[[Table], Learn]] = {"STLSQ": sparse, "GP": process}
