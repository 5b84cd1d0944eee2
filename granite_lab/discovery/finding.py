"""The record of a search for the missing effect."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import PhaseName
from granite_lab.fitting.fit import View
from granite_lab.inference.constants import CERTAIN, LATENCY_LIMIT, TOLERANCE
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Active
from granite_lab.origin import NOWHERE, Origin
from granite_lab.parameters import Robot, Soil, load_paper
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd

MODEL, DESIGN = "model.toml", "design.json"
"""Files beside a report: the model with what was found, and what a plan needs of the search."""

SIMULATES_WORSE = "Simulations with what was found predict speeds left out worse than the paper's model"
UNCONVERGED = "The fit did not converge"
"""How notes begin that say so of the model with what was found."""

LIKELY = 0.5
"""Probability from which on a cause acts rather than not; convention."""

Verdict = Literal["none", "named", "partly named", "unknown"]
Status = Literal["named", "twin", "described", "small", "less likely", "screened", "at a bound"]


@dataclass(frozen=True)
class Limits:
    """What is no missing effect.

    Attributes:
        discrepancy: that does not matter, as a share of a channel's rms in motion.
        latency: largest delay between the stamps of two sensors that loggers have [s].
    """

    discrepancy: float = TOLERANCE
    latency: float = LATENCY_LIMIT


USUAL = Limits()
"""Those of a search unless others are given."""


@dataclass(frozen=True)
class FittedParameter:
    """One fitted number of an effect.

    Attributes:
        name, unit: as the effect declares them.
        estimate: value with its std; for a number that each trial has of its own, the root mean
            square over the trials.
        per_trial: the values of the trials, in their order; empty for a shared number.
    """

    name: str
    unit: str
    estimate: Estimate
    per_trial: tuple[float, ...] = ()


@dataclass(frozen=True)
class EffectFinding:
    """An effect that the trials show.

    Attributes:
        id, title, formula: of the effect.
        parameters: as fitted together with everything else.
        twins: candidates that explain these trials as well in its place.
        probability: that it, or one of its twins, is in the model; NaN where no trial left out has judged
            that.
        closes, speeds: share of the gap that it closes on trials and on speeds that were left out, with its
            standard error.
        empirical: no physical effect but a term of the dictionary, which only describes.
    """

    id: str
    title: str
    formula: str
    parameters: tuple[FittedParameter, ...]
    twins: tuple[str, ...]
    probability: float
    closes: Estimate
    speeds: Estimate
    empirical: bool = False

    @property
    def is_likely(self) -> bool:
        """Whether it is a cause that acts rather than not."""
        return not self.empirical and self.probability >= LIKELY


@dataclass(frozen=True)
class Candidate:
    """How one candidate fared.

    Attributes:
        id: of the effect.
        gain: logarithm of the Bayes factor against the model it was added to, from the full fit where there
            is one, else from the screen.
        probability: posterior probability that it is in the model.
        closes: share of the gap that it closes alone, all trials in the fit; NaN where it was not fitted.
        status: what became of it.
        bounds: parameters that ended at a bound.
    """

    id: str
    gain: float
    probability: float
    closes: float
    status: Status
    bounds: tuple[str, ...] = ()


@dataclass(frozen=True)
class Gap:
    """Root mean square of the residuals over what noise and the tolerance explain.

    Attributes:
        channel: or "all".
        train: without and with the effects, all trials in the fit; 1 is a model that is as good as asked for.
        held_out: the same, each trial predicted by the fit to the others; NaN where nothing was left out.
    """

    channel: str
    train: tuple[float, float]
    held_out: tuple[float, float]


NO_GAP = Gap("all", (math.nan, math.nan), (math.nan, math.nan))
"""That of trials in which none could be computed."""


@dataclass(frozen=True)
class Disagreement:
    """An interval in which a channel disagrees with the model.

    Attributes:
        channel: as in `inference.observation.UNITS`.
        phase: commanded phase in the interval's middle.
        variant: desired velocity of the command [m/s].
        start, end: since the start of the command [s].
        frequency: where the disagreement is strongest [Hz].
        share: rms of the disagreement over the channel's rms in motion.
        score: rms of the disagreement over its std.
    """

    channel: str
    phase: PhaseName
    variant: float
    start: float
    end: float
    frequency: float
    share: float
    score: float


@dataclass(frozen=True)
class Push:
    """An interval in which a force is certain that the model lacks.

    Attributes:
        quantity, unit: force, lift, moment or torque of a wheel, see `model.latent.PUSHES`.
        phase: commanded phase in the interval's middle.
        variant: desired velocity of the command [m/s].
        start, end: since the start of the command [s].
        size: rms of the force in the interval, with its sign [unit].
    """

    quantity: str
    unit: str
    phase: str
    variant: float
    start: float
    end: float
    size: float


@dataclass(frozen=True)
class Ceiling:
    """What any force could close of what the likeliest model leaves, all trials in the fit.

    Attributes:
        value: share of the gap that forces, free in time, could close beside the model.
        left: share of the gap that the model leaves.
        parts: quantity to the share that it could close alone.
        channels: channel to how far the forces move it, over its rms in motion.
        where: intervals in which a force is certain, the largest first.
    """

    value: float
    left: float
    parts: Mapping[str, float]
    channels: Mapping[str, float]
    where: tuple[Push, ...]


@dataclass(frozen=True)
class Detectable:
    """The smallest size of an effect that these trials can show.

    Attributes:
        effect, parameter, unit: which.
        size: strength that is named with a probability of 80 % [unit]; NaN where these trials cannot.
        limit: what sets it, "noise" or "tolerance".
        confused_with: candidates whose signature is more than 95 % the same once the nuisances are refitted.
    """

    effect: str
    parameter: str
    unit: str
    size: float
    limit: str
    confused_with: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Confusion:
    """What would come out of these trials if one candidate were in them, linear about the fit.

    Attributes:
        ids: the candidates, in the rows and columns of `matrix`.
        cosines: (k, k) cosines between the candidates' signatures, nuisances projected out.
        matrix: (k, k) share of the sets with the row's candidate in which the column's comes first; NaN in
            the row of one that these trials cannot show.
        missed: (k,) share in which nothing is named; with the row of `matrix` it sums to one.
        factor: size that was put in, over the smallest that is detectable.
        draws: sets a row.
    """

    ids: tuple[str, ...]
    cosines: Array
    matrix: Array
    missed: Array
    factor: float
    draws: int

    def taken_for(self, id_: str) -> tuple[tuple[str, float], ...]:
        """Return the wrong candidates that come first in over 1 - `CERTAIN` of the sets, likeliest first."""
        row = self.matrix[self.ids.index(id_)]
        wrong = [(o, float(x)) for o, x in zip(self.ids, row, strict=True) if o != id_ and x > 1 - CERTAIN]
        return tuple(sorted(wrong, key=lambda item: -item[1]))


@dataclass(frozen=True, eq=False)
class Residual:
    """One channel of one trial beside the model, before and after.

    Attributes:
        trial, channel, unit: which.
        variant: desired velocity [m/s].
        command: number of the command; one velocity may have several.
        t: (n,) time since the start of the command [s]; `t_start` in the log's time [s].
        phase: (n,) commanded phase.
        measured: (n,) bins, NaN where nothing was measured; wheel angles are counted from the start [unit].
        before, after: (n,) simulated without and with the effects, nuisances fitted [unit].
        discrepancy_before, discrepancy_after: (n,) what the repetitions share and the model does not
            explain [unit].
        std: (n,) of `discrepancy_after` [unit].
        size: rms of the channel in motion [unit].
    """

    trial: str
    channel: str
    unit: str
    variant: float
    command: int
    t: Array
    t_start: float
    phase: tuple[str, ...]
    measured: Array
    before: Array
    after: Array
    discrepancy_before: Array
    discrepancy_after: Array
    std: Array
    size: float


@dataclass(frozen=True)
class GroundWave:
    """What repeats with the position of the robot at all speeds, in another phase in each trial.

    Attributes:
        wavelength: of the ground [m].
        channel: that shows it most.
        unit: of that channel.
        amplitude: in that channel, median of the trials.
        share: its rms as a share of the channel's rms in motion, of the trial that shows it most.
        order: periods a turn of the wheels, where these trials cannot tell the two apart; else NaN.
    """

    wavelength: Estimate
    channel: str
    unit: str
    amplitude: float
    share: float
    order: float


@dataclass(frozen=True)
class LeftOut:
    """What was predicted of trials that were left out.

    Attributes:
        name: of the trial, or the desired velocity [m/s] of the speed that was left out.
        before, after: misfit over what noise and the tolerance explain, without and with the effects.
    """

    name: str
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Finding(Shown):
    """What the trials say about the model.

    Attributes:
        verdict: "none", "named", "partly named" or "unknown".
        sentence: the verdict in plain words.
        probability: posterior probability of the verdict.
        provisional: why the verdict is provisional; empty where it is not.
        effects: what was named.
        description: what the likeliest model holds besides, effects that are not sure and terms of the
            dictionary: no cause, but what was left out is predicted better.
        small: effects that the trials may show and that do not matter, likeliest first.
        closed: share of the gap that is closed on "trials" and on "speeds" that were left out.
        ceiling: what any force could close beside the likeliest model; None where nothing remains.
        strained: numbers that ended at a bound, or two standard deviations off their file or range; those of
            the trials on average.
        remainder: share of the gap that is left on trials that were left out; NaN without a gap.
        tolerance: discrepancy that does not matter, as a share of a channel's rms.
        latency: by how much the stamps of the IMU come later than those of wheels and currents [s].
        gap: over all channels.
        gaps: per channel.
        where: intervals in which the model without effects disagrees by more than the tolerance.
        left: the same with the effects.
        candidates: best first.
        detectable: per candidate and strength.
        confusion: what these trials can tell apart.
        residuals: per trial and channel.
        sand: parameter of the sand common to all trials to its logarithm over the file's value.
        sand_per_trial: per trial a_θ [s/m], k_φ and c as fitted.
        scales: number that differs from trial to trial to its std as learnt from the trials.
        own_means: gain or tilt [rad] to its mean over the trials, as fitted.
        discrepancy: share of each channel's rms that the model with the effects misses, as learnt.
        scatter: channel to how far repetitions of a command differ slowly and beyond noise, as a share of its
            rms in motion; only where that is more than a tenth.
        ground_wave: what repeats with the position of the robot; None where nothing does.
        trials_left_out, speeds_left_out: predictions; empty where nothing could be left out.
        dropped: name of a trial that nothing fits, and why it was left out of the analysis.
        notes: what could not be told and why.
        robot, soil: of the baseline.
        active: the effects as they are switched on in a simulation.
        virtual: all trials were written by a simulator.
        runs: simulations that were needed.
        failures: parts of the analysis that failed after the search, one line each, with their `tracebacks`.
        origin: where the finding comes from.
        a_theta: by the files, with their uncertainty, and with what was found; see `assemble.a_theta_views`.
        simulates: speeds of Table 2 [m/s] at which the model with what was found has a solution.
    """

    verdict: Verdict
    sentence: str
    probability: float
    provisional: tuple[str, ...]
    effects: tuple[EffectFinding, ...]
    description: tuple[EffectFinding, ...]
    small: tuple[EffectFinding, ...]
    closed: Mapping[str, Estimate]
    ceiling: Ceiling | None
    strained: tuple[str, ...]
    remainder: float
    tolerance: float
    latency: Estimate
    sand: Mapping[str, Estimate]
    sand_per_trial: tuple[tuple[str, Mapping[str, float]], ...]
    scales: Mapping[str, float]
    discrepancy: float
    scatter: Mapping[str, float]
    trials_left_out: tuple[LeftOut, ...]
    speeds_left_out: tuple[LeftOut, ...]
    dropped: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    robot: Robot
    soil: Soil
    active: tuple[Active, ...]
    virtual: bool
    runs: int = 0
    failures: tuple[str, ...] = field(default=())
    tracebacks: tuple[str, ...] = field(default=())
    origin: Origin = NOWHERE
    a_theta: tuple[View, ...] = ()
    simulates: tuple[float, ...] = ()
    own_means: Mapping[str, float] = field(default_factory=dict)
    ground_wave: GroundWave | None = None
    gap: Gap = NO_GAP
    gaps: tuple[Gap, ...] = ()
    where: tuple[Disagreement, ...] = ()
    left: tuple[Disagreement, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    detectable: tuple[Detectable, ...] = ()
    confusion: Confusion | None = None
    residuals: tuple[Residual, ...] = ()

    @property
    def terms(self) -> tuple[EffectFinding, ...]:
        """All that the likeliest model holds and that matters, named or not."""
        return (*self.effects, *self.description)

    @property
    def simulates_worse(self) -> bool:
        """Whether simulations with what was found predict speeds left out worse than those by the files."""
        return any(note.startswith(SIMULATES_WORSE) for note in self.notes)

    @property
    def likely(self) -> tuple[EffectFinding, ...]:
        """Causes that act rather than not, but are not sure enough to be named."""
        return tuple(e for e in self.description if e.is_likely)

    @property
    def causeless(self) -> tuple[EffectFinding, ...]:
        """What else describes the rest."""
        return tuple(e for e in self.description if not e.is_likely)

    @property
    def fitted_sand(self) -> dict[str, Estimate]:
        """a_θ [s/m], and numbers of the soil that all trials share, in their units as in `Soil`."""
        sand = {}
        for name, log in self.sand.items():
            base = load_paper().a_theta if name == "a_theta" else float(getattr(self.soil, name))
            value = base * math.exp(log.value)
            sand[name] = Estimate(value, value * log.std)
        return sand

    def sand_of(self, trial: str = "") -> tuple[Soil, float]:
        """Return the sand of a trial as fitted, and its a_θ [s/m]; of no or another trial that of all."""
        common = {name: number.value for name, number in self.fitted_sand.items()}
        numbers: dict[str, Any] = {**common, **dict(self.sand_per_trial).get(trial, {})}
        a_theta = numbers.pop("a_theta", load_paper().a_theta)
        return replace(self.soil, **numbers), a_theta

    def __repr__(self) -> str:
        names = ", ".join(effect.id for effect in self.effects)
        return (
            f"Finding('{self.verdict}'{', virtual' if self.virtual else ''}: {names or 'no effect'}, "
            f"probability {self.probability:.3g}, {len(self.candidates)} candidates)"
        )

    def to_frame(self) -> pd.DataFrame:
        """Return one row a candidate: its gain, its probability, the share of the gap it closes, its fate."""
        import pandas as pd  # noqa: PLC0415

        rows = [(c.id, c.gain, c.probability, c.closes, c.status) for c in self.candidates]
        return pd.DataFrame(rows, columns=["effect", "log_bayes_factor", "probability", "closes", "status"])
