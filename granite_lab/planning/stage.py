"""Trials without data: what one of them, driven or not, tells about the parameters and the explanations.

Every trial of a command brings the normal equations of `inference`, with its discrepancy and its own numbers
integrated out; what is left belongs to the parameters that all trials share, and adds up over commands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, toeplitz
from scipy.linalg.lapack import dtrtri

from granite_lab.errors import EstimateError
from granite_lab.inference.bench import SAND, Bench, Task
from granite_lab.inference.binning import Stream
from granite_lab.inference.constants import FORMULA_ERROR
from granite_lab.inference.noise import FLOOR, NOMINAL, Whitener
from granite_lab.inference.normal import Posterior, Scales, posterior
from granite_lab.inference.nuisances import TrialModel
from granite_lab.inference.observation import CHANNELS, Observation
from granite_lab.inference.problem import SHARED, Point, Problem, Slopes
from granite_lab.logs.trial import Array
from granite_lab.model.command import duration, peak_velocity
from granite_lab.parameters import Robot, Soil, Variant
from granite_lab.planning.design import FREQUENCIES, Design, Driven, Noise, commanded_share

GRID = 1024
"""Least number of frequencies on which a spectrum becomes a covariance."""


@dataclass(frozen=True)
class Explanation:
    """An effect with the values of all its parameters."""

    id: str
    values: tuple[float, ...]


Model = tuple[Explanation, ...]
"""Effects that are switched on together."""


def nominal(robot: Robot, soil: Soil, variants: Sequence[Variant], share: float = 0.0) -> Design:
    """Return the design of one trial a command, with white noise of a common strength."""
    noise = tuple(Noise(channel=c, rest=NOMINAL[c]) for c in CHANNELS)
    driven = tuple(Driven(variant=v, noise=noise) for v in variants)
    return Design(verdict="none", robot=robot, soil=soil, share=share, driven=driven, virtual=True)


def trial_model(design: Design, number: int, variant: Variant, like: Driven) -> TrialModel:
    """Return a trial that reads nothing at the stamps of ideal sensors.

    Args:
        design: gives robot and bins.
        number: of the command.
        variant: the command.
        like: trials whose channels it has, and whose share of rest.
    """
    robot, width = design.robot, design.width
    names = [n.channel for n in like.noise]
    first = -max(1, round(like.before / width))
    last = max(first + 2, int(np.ceil((duration(variant) + like.after) / width)))
    edges = width * np.arange(first, last + 1, dtype=np.float64)
    rates = {"wheel": robot.encoders.rate, "current": robot.currents.rate}
    unit = np.eye(8)
    weights = dict(zip(CHANNELS[:3], unit[:3], strict=True)) | {
        "wheel": (unit[3] + unit[4]) / 2 if "wheel_split" in names else unit[3],
        "wheel_split": unit[3] - unit[4],
        "current_f": unit[5],
        "current_r": unit[6],
    }
    streams = {}
    for c in names:
        rate = max(rates.get(c.split("_")[0], robot.imu_grade.rate if robot.imu_grade else 200.0), 1 / width)
        t = np.arange(edges[0] - 2 / rate, edges[-1] + 3 / rate, 1 / rate)
        window = 1 / rate if weights[c][:3].any() else 0.0
        streams[c] = Stream(t, np.zeros(t.size), weights[c], c.startswith("wheel"), window)
    values = {c: np.zeros(edges.size - 1) for c in names}
    blank = Observation(f"plan{number}", variant, 0.0, edges, streams, values, 0.0, False)
    return TrialModel(blank, number, robot)


def whitener_of(noise: Noise, t: Array, variant: Variant, learnt_at: float) -> Whitener:
    """Return the whitening filter of a trial to come; what driving adds grows with the speed.

    Args:
        noise: of the channel.
        t: (n,) middle of each bin since the start of the command [s].
        variant: the command.
        learnt_at: speed at which the noise was learnt [m/s].
    """
    level = float(np.hypot(noise.rest, FLOOR[noise.channel]))
    known = np.ones(t.size, dtype=bool)
    if not noise.driven:
        return Whitener(np.full(t.size, 1 / level), known)
    size = max(GRID, t.size)
    grid = np.linspace(0, 1, FREQUENCIES)
    spectrum = np.interp(np.linspace(0, 1, size + 1), grid, noise.driven)
    speed = commanded_share(t, variant) * peak_velocity(variant) / learnt_at
    Σ = np.outer(speed, speed) * toeplitz(np.fft.irfft(spectrum)[: t.size]) + level**2 * np.eye(t.size)
    return Whitener(np.tril(dtrtri(cholesky(Σ, lower=True), lower=1)[0]), known)


class Stage:
    """Trials of numbered commands.

    Args:
        design: the trials at hand.
        bench: its world knows the commands.
    """

    def __init__(self, design: Design, bench: Bench) -> None:
        self.design, self.bench = design, bench
        self.scales = Scales(design.share, FORMULA_ERROR[0], {s.name: s.std for s in design.scales})
        self._models: dict[int, TrialModel] = {}
        self._slopes: dict[tuple[int, Model], Slopes] = {}

    def problem(self, number: int, like: Driven, count: int = 1) -> Problem:
        """Return the problem of some trials of a command."""
        if number not in self._models:
            variant = self.bench.world.variants[number]
            self._models[number] = trial_model(self.design, number, variant, like)
        return Problem([self._models[number]] * count, self.bench)

    def point(self, problem: Problem, model: Model) -> Point:
        """Return the fitted numbers, with effects switched on."""
        point = problem.neutral()
        shared = point.shared.copy()
        shared[: len(SAND)], shared[len(SAND)] = self.design.sand, self.design.latency
        point = replace(point, shared=shared)
        for e in model:
            point = problem.with_effect(point, e.id, e.values)
        return point

    def information(
        self, number: int, like: Driven, count: int, model: Model, others: Sequence[Model] = ()
    ) -> Array:
        """Return what trials of one command tell.

        Args:
            number: of the command.
            like: the trials whose channels and noise they have.
            count: number of repetitions.
            model: effects that are switched on; their shared parameters are fitted.
            others: models whose difference from this one stands in a column of its own.

        Returns:
            (p + k, p + k) information of the p shared parameters, as in `Point`, then of k differences.

        Raises:
            EstimateError: a simulation has no solution.
        """
        problem = self.problem(number, like, count)
        point = self.point(problem, model)
        slopes = self._differentiated(problem, number, model, point)
        trial = problem.trials[0]
        own = [
            whitener_of(n, trial.observation.t, trial.observation.variant, peak_velocity(like.variant))
            for n in like.noise
        ]
        problem.weigh([own] * count, point, slopes)
        tasks = [problem.centre(self.point(problem, other), 0) for other in others]
        changes = [{0: r - slopes.response[0]} for r in self._respond(tasks)]
        nothing = [np.zeros((len(trial.channels), trial.observation.bins))] * count
        M, _ = problem.normal(point, slopes, nothing, candidates=changes).marginal(self.scales)
        std, _ = problem.prior(point, self.scales)
        local = sum(x.size for x in point.trials)
        return posterior(M, 0.0, std[:local] ** -2.0, np.zeros(local)).rest[:-1, :-1]

    def prior(self, model: Model) -> Array:
        """Return the (p,) precisions of the shared parameters before any trial."""
        like = self.design.driven[0]
        problem = self.problem(0, like)
        std, _ = problem.prior(self.point(problem, model), self.scales)
        return np.asarray(std[-(len(SHARED) + self._count(problem, model)) :] ** -2.0)

    @staticmethod
    def _count(problem: Problem, model: Model) -> int:
        return len(problem.parameters([e.id for e in model], per_trial=False))

    def _differentiated(self, problem: Problem, number: int, model: Model, point: Point) -> Slopes:
        if (number, model) not in self._slopes:
            kept = len(self.design.driven)  # of the trials at hand; a proposed one is looked at once
            self._slopes = {k: s for k, s in self._slopes.items() if k[0] < kept or k[0] == number}
            known = next((s for (n, _), s in self._slopes.items() if n == number), None)
            found = problem.slopes(point, known)
            if found is None:
                raise EstimateError("a proposed trial cannot be simulated", "check robot and soil")
            self._slopes[number, model] = found
        return self._slopes[number, model]

    def possible(self, model: Model) -> bool:
        """Whether all trials at hand can be simulated with some effects."""
        tasks = []
        for number, like in enumerate(self.design.driven):
            problem = self.problem(number, like)
            tasks.append(problem.centre(self.point(problem, model), 0))
        return all(r is not None for r in self.bench.run(tasks))

    def at_hand(self, model: Model, others: Sequence[Model] = ()) -> Array:
        """Return `information` of all trials at hand."""
        parts = [
            self.information(k, d, int(d.count), model, others) for k, d in enumerate(self.design.driven)
        ]
        return np.asarray(np.sum(parts, axis=0))

    def _respond(self, tasks: Sequence[Task]) -> list[Array]:
        found = [r for r in self.bench.run(tasks) if r is not None]
        if len(found) < len(tasks):
            raise EstimateError("a proposed trial cannot be simulated", "check the effects")
        return found


def integrated(information: Array, precision: Array) -> Posterior:
    """Integrate the shared parameters out; ``rest[:-1, :-1]`` holds what remains of the differences.

    Args:
        information: (p + k, p + k) sum over all commands.
        precision: (p,) of the prior.
    """
    return posterior(np.pad(information, (0, 1)), 0.0, precision, np.zeros(precision.size))


def against(information: Array, precision: Array, column: int) -> Posterior:
    """Fit the shared parameters to one difference.

    ``misfit`` is the sum of squares that remains of it, ``step`` are the parameters.

    Args:
        information: (p + k, p + k) sum over all commands.
        precision: (p,) of the prior.
        column: place of the difference among the k.
    """
    p = precision.size
    own = [*range(p), p + column]
    return posterior(information[np.ix_(own, own)], 0.0, precision, np.zeros(p))
