"""What a search leaves most uncertain, and the information that a trial without data, driven or not, adds.

Every trial of a command brings the normal equations of `inference`, with its discrepancy and its own numbers
integrated out; what is left belongs to the parameters that all trials share, and adds up over commands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import toeplitz

from granite_lab.discovery.screens import probes_of
from granite_lab.effects.library import get
from granite_lab.errors import EstimateError, InputError
from granite_lab.inference.binning import Stream
from granite_lab.inference.constants import BIN, FORMULA_ERROR
from granite_lab.inference.derivatives import differentiate
from granite_lab.inference.noise import FLOOR, GRID, Whitener, white, whitener
from granite_lab.inference.normal import Posterior, Scales, posterior
from granite_lab.inference.nuisances import TrialModel
from granite_lab.inference.observation import CHANNELS, Observation
from granite_lab.inference.point import SHARED, Derivatives, Further, Point, stacked
from granite_lab.inference.pool import SAND, Setting, SimulationPool, Values
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.command import duration, peak_velocity
from granite_lab.model.effect import Effect, EffectParameter
from granite_lab.parameters import Robot, Variant
from granite_lab.planning.design import Design, Driven, Noise, commanded_share

DECISIVE = 3.0
"""Logarithm of a Bayes factor that decides between two explanations, 20 to 1 (Kass and Raftery 1995)."""

MOST = 3
"""Number of explanations that are compared."""

ROUNDS = 3
"""Steps of Gauss and Newton by which one explanation imitates another."""


@dataclass(frozen=True)
class Question:
    """What the next trial should answer.

    Attributes:
        kind: distinguish the rivals ("apart"), "show" each of them against nothing, or "sharpen" a number.
        rivals: ids of the explanations, the named one first; empty where a number is sharpened.
        named: the effects in the model; the rivals are compared with the last one.
        gains: log Bayes factor of each rival on the trials at hand, where no effect is in the model.
    """

    kind: Literal["apart", "show", "sharpen"]
    rivals: tuple[str, ...]
    named: Setting = ()
    gains: tuple[float, ...] = ()


def question(design: Design, effects: Mapping[str, Effect]) -> Question:
    """Choose the question of a plan: twins first, then an open verdict, then the least precise number.

    Effects whose strengths all differ from trial to trial cannot be foreseen for a new one and are no rivals.

    Raises:
        InputError: the design is of another version of an effect.
        UsageError: a named effect is not known.
    """
    if any(len(e.values) != len(get(e.id, effects).parameters) for e in design.named):
        raise InputError("the design is of another version of an effect", "run 'granite-lab discover' again")
    named = tuple((e.id, _within(get(e.id, effects).parameters, e.values)) for e in design.named)
    ids = [id_ for id_, _ in named]
    lasting = [i for i, e in effects.items() if any(not p.shape and not p.per_trial for p in e.parameters)]
    twins = [[t for t in e.twins if t in lasting] for e in design.named]
    if any(twins):
        k = max(range(len(named)), key=lambda k: len(twins[k]))
        return Question("apart", (ids[k], *twins[k][: MOST - 1]), (*named[:k], *named[k + 1 :], named[k]))
    most = DECISIVE if design.verdict == "none" else np.inf  # what is shown and is small needs no trial
    possible = [c for c in design.possible if c.name not in ids and c.name in lasting and c.value < most]
    rivals = tuple(c.name for c in possible[:MOST])
    gains = [c.value for c in possible[:MOST]]
    if design.verdict == "unknown" and len(rivals) > 1:
        return Question("apart", rivals, gains=tuple(max(gain, DECISIVE) for gain in gains))
    if (design.provisional or design.verdict in ("partly named", "unknown")) and rivals:
        if named:
            return Question("apart", (ids[-1], *rivals[: MOST - 1]), named)
        return Question("show", rivals, gains=tuple(max(gain, DECISIVE / 2) for gain in gains))
    return Question("sharpen", (), named)


def _within(parameters: Sequence[EffectParameter], values: Sequence[float]) -> Values:
    return tuple(float(np.clip(v, p.low, p.high)) for p, v in zip(parameters, values, strict=True))


def trial_model(number: int, variant: Variant, like: Driven, robot: Robot, width: float = BIN) -> TrialModel:
    """Return a trial of a command that reads nothing at the stamps of ideal sensors.

    Its channels and standstills are those of the trials `like`, its bins of a `width` [s].
    """
    names = [n.channel for n in like.noise]
    first = -max(1, round(like.before / width))
    last = max(first + 2, int(np.ceil((duration(variant) + like.after) / width)))
    edges = width * np.arange(first, last + 1, dtype=np.float64)
    rates = {"wheel": robot.encoders.rate, "current": robot.currents.rate}
    unit = np.eye(8)
    weights = [*unit[:3], (unit[3] + unit[4]) / 2, unit[3] - unit[4], *unit[5:7], unit[5] + unit[6]]
    if "wheel_split" not in names:
        weights[3] = unit[3]
    streams = {}
    for c in names:
        rate = max(rates.get(c.split("_")[0], robot.imu_grade.rate), 1 / width)
        t = np.arange(edges[0] - 2 / rate, edges[-1] + 3 / rate, 1 / rate)
        place = CHANNELS.index(c)
        window = 1 / rate if place < 3 else 0.0
        streams[c] = Stream(t, np.zeros(t.size), weights[place], c.startswith("wheel"), window)
    values = {c: np.zeros(edges.size - 1) for c in names}
    blank = Observation(f"plan{number}", variant, 0.0, edges, streams, values, 0.0, False)
    return TrialModel(blank, number, robot)


def whitener_of(noise: Noise, trial: Observation, learnt_at: float) -> Whitener:
    """Return the whitening filter of a channel whose noise was learnt at some speed [m/s].

    What driving adds to the noise at rest grows with the speed.
    """
    t, variant = trial.t, trial.variant
    level = float(np.hypot(noise.rest, FLOOR[noise.channel]))
    every_row = np.ones(t.size, dtype=bool)
    if not noise.driven:
        return white(level, every_row, trial.width)
    grid = np.linspace(0, 1, len(noise.driven))
    spectrum = np.interp(np.linspace(0, 1, max(GRID, t.size) + 1), grid, noise.driven)
    speed = commanded_share(t, variant) * peak_velocity(variant) / learnt_at
    shared = np.fft.irfft(spectrum)

    def covariance(stretch: slice) -> Array:
        v = speed[stretch]
        return np.asarray(np.outer(v, v) * toeplitz(shared[: v.size]) + level**2 * np.eye(v.size))

    return whitener(every_row, trial.width, covariance)


class Stage:
    """The trials at hand, then those that are proposed, numbered as the pool's commands.

    `likes` are per proposed trial those whose channels and noise it has.
    """

    def __init__(self, design: Design, pool: SimulationPool, likes: Sequence[Driven] = ()) -> None:
        self.design, self.pool = design, pool
        self.likes = (*design.driven, *likes)
        self.scales = Scales(design.share, FORMULA_ERROR[0], {s.name: s.value for s in design.scales})
        self._models: dict[int, TrialModel] = {}
        self._derivatives: dict[tuple[int, Setting], Derivatives] = {}

    def problem(self, number: int, count: int = 1) -> Problem:
        """Return the problem of some trials of a command."""
        if number not in self._models:
            variant, robot, width = self.pool.scenario.variants[number], self.design.robot, self.design.width
            self._models[number] = trial_model(number, variant, self.likes[number], robot, width)
        return Problem([self._models[number]] * count, self.pool)

    def point(self, problem: Problem, model: Setting) -> Point:
        """Return the fitted numbers, with effects switched on."""
        point = problem.neutral()
        point.shared[: len(SAND)] = self.design.sand
        point.shared[SHARED.index("latency")] = self.design.latency
        for id_, values in model:
            point = problem.with_effect(point, id_, values)
        return point

    def information(self, number: int, count: int, model: Setting, others: Sequence[Setting] = ()) -> Array:
        """Return the information of `count` trials of one command under a model with the effects of `model`.

        Returns:
            (p + k, p + k) information of the p shared parameters, which end like `Point.vector`, then of the
            differences that the k other models make.

        Raises:
            EstimateError: a simulation has no solution.
        """
        problem, like = self.problem(number, count), self.likes[number]
        point = self.point(problem, model)
        if (number, model) not in self._derivatives:
            near = next((s for (n, _), s in self._derivatives.items() if n == number), None)
            if (new := differentiate(problem, point, near)) is not None:
                self._derivatives[number, model] = new
        derivatives = self._derivatives.get((number, model))
        runs = problem.respond([problem.centre(self.point(problem, other), 0) for other in others])
        if derivatives is None or runs is None:
            raise EstimateError("a proposed trial cannot be simulated", "check the effects")
        trial = problem.trials[0]
        whiteners = [whitener_of(n, trial.observation, peak_velocity(like.variant)) for n in like.noise]
        problem.set_noise([whiteners] * count, point, derivatives)
        changes = stacked([run - derivatives.response[0] for run in runs], derivatives.response[0])
        nothing = [np.zeros_like(trial.measured)] * count
        M, _ = problem.normal(point, derivatives, nothing, further=Further((changes,))).marginal(self.scales)
        std, _ = problem.prior(point, self.scales)
        local = sum(x.size for x in point.trials)
        return posterior(M, 0.0, std[:local] ** -2.0, np.zeros(local)).rest[:-1, :-1]

    def at_hand(self, model: Setting, others: Sequence[Setting] = ()) -> Array:
        """Return `information` of all trials at hand and of the prior."""
        parts = [self.information(n, int(d.count), model, others) for n, d in enumerate(self.design.driven)]
        total = np.asarray(np.sum(parts, axis=0))
        p = total.shape[0] - len(others)
        problem = self.problem(0)
        std, _ = problem.prior(self.point(problem, model), self.scales)
        total[range(p), range(p)] += std[-p:] ** -2.0
        return total

    def further_trial(self, number: int, model: Setting, others: Sequence[Setting]) -> Array:
        """Return what a further trial of a command adds."""
        count = int(self.likes[number].count) if number < len(self.design.driven) else 0
        new = self.information(number, count + 1, model, others)
        return new - self.information(number, count, model, others) if count else new

    def possible(self, model: Setting) -> bool:
        """Whether all trials at hand can be simulated with some effects."""
        problems = [self.problem(n) for n, _ in enumerate(self.design.driven)]
        runs = self.pool.run([p.centre(self.point(p, model), 0) for p in problems])
        return all(run is not None for run in runs)


def fitted(information: Array, k: int) -> Posterior:
    """Fit the shared parameters to each of k differences, which are the last columns.

    ``rest[i, i]`` is the sum of squares that remains of a difference; ``step`` is fitted to the last one.
    """
    p = information.shape[0] - k
    return posterior(information if k else np.pad(information, (0, 1)), 0.0, np.zeros(p), np.zeros(p))


def explanations(stage: Stage, asked: Question) -> tuple[Setting, ...]:
    """Return the models that are compared; where something is to be shown, the first is that without it.

    Raises:
        EstimateError: fewer than two of them can be simulated.
    """
    others, truth = asked.named[:-1], asked.named[-1:]
    if truth:
        models = [asked.named]
        guesses = [_imitating(stage, others, truth, id_) for id_ in asked.rivals[1:]]
    else:
        models = [()] if asked.kind == "show" else []
        guesses = [_start(stage, (), i, gain=g) for i, g in zip(asked.rivals, asked.gains, strict=True)]
    models += [(*others, guess) for guess in guesses if guess is not None]
    if len(models) < 2:
        raise EstimateError("no other explanation can be simulated on these trials", "check the effects")
    return tuple(models)


def _start(
    stage: Stage, others: Setting, id_: str, truth: Setting = (), gain: float = 0.0
) -> tuple[str, Values] | None:
    """Return an effect at the size at which it comes nearest to `truth`, or has a log Bayes factor `gain`."""
    problem = stage.problem(0)
    parameters = problem.parameters_of(id_)
    neutral = np.array([p.neutral for p in parameters])
    tried = []
    for probe in probes_of(problem, id_):
        values = tuple((neutral + probe.size * (np.arange(neutral.size) == probe.place)).tolist())
        if not probe.parameter.per_trial and stage.possible((*others, (id_, values))):
            tried.append(values)
    if not tried:
        return None
    models = [(*others, other) for other in (*truth, *((id_, values) for values in tried))]
    rest = fitted(stage.at_hand(others, models), len(models)).rest
    size = np.fmax(np.diag(rest)[-len(tried) :], 1e-12)
    if truth:
        amounts = rest[0, 1:] / size
        best = int(np.argmax(amounts**2 * size))
    else:
        amounts = np.sqrt(2 * gain / size)
        best = int(np.argmin(np.abs(np.log(amounts))))
    scaled = _within(parameters, (neutral + amounts[best] * (np.array(tried[best]) - neutral)).tolist())
    return id_, scaled if stage.possible((*others, (id_, scaled))) else tried[best]


def _imitating(stage: Stage, others: Setting, truth: Setting, id_: str) -> tuple[str, Values] | None:
    """Return an effect with the values at which it comes nearest to `truth` on the trials at hand."""
    guess = nearest = _start(stage, others, id_, truth)
    if guess is None:
        return None
    parameters, least = stage.problem(0).parameters_of(id_), np.inf
    shared = [k for k, p in enumerate(parameters) if not p.per_trial]
    for _ in range(ROUNDS):
        try:
            fit = fitted(stage.at_hand((*others, guess), [(*others, *truth)]), 1)
        except EstimateError:
            break
        if fit.misfit >= least:
            break
        least, nearest = fit.misfit, guess
        values = np.array(guess[1])
        values[shared] += fit.step[-len(shared) :]
        guess = id_, _within(parameters, values.tolist())
    return nearest
