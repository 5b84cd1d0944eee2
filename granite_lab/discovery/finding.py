"""The record of a search for the missing effect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from granite_lab.discovery.lackfit import Disagreement
from granite_lab.discovery.shown import Confusion, Detectable
from granite_lab.estimate import Estimate
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil

if TYPE_CHECKING:
    import pandas as pd

Verdict = Literal["none", "named", "unknown"]
Status = Literal["evaluated", "at a bound", "not converged", "screened only", "related", "uneven"]


@dataclass(frozen=True)
class FoundParameter:
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
class FoundEffect:
    """An effect that the trials show.

    Attributes:
        id, title: of the effect.
        parameters: as fitted together with everything else.
        twins: candidates that explain these trials as well in its place.
        evidence: drop of chi2 that it brought, as of one number.
        empirical: not a physical effect but a law that was fitted.
    """

    id: str
    title: str
    parameters: tuple[FoundParameter, ...]
    twins: tuple[str, ...]
    evidence: float
    empirical: bool = False


@dataclass(frozen=True)
class Candidate:
    """How one candidate fared in one round of the search.

    Attributes:
        id: of the effect.
        evidence: drop of chi2 as of one number, from the full fit where there is one.
        screened: the same from the screen alone.
        status: how far it was looked at.
        bounds: parameters that ended at a bound.
    """

    id: str
    evidence: float
    screened: float
    status: str
    bounds: tuple[str, ...]


@dataclass(frozen=True)
class Gap:
    """Root mean square of whitened residuals over that of the noise.

    Attributes:
        channel: or "all".
        phase: or "all".
        train: before, after, and 1 for the noise, with all trials in the fit.
        held_out: the same, each trial predicted by the fit to the others.
    """

    channel: str
    phase: str
    train: tuple[float, float, float]
    held_out: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Residual:
    """One channel of one trial beside the model, before and after.

    Attributes:
        trial, channel, unit: which.
        variant: desired velocity [m/s].
        t: (n,) time since the start of the command [s]; `t_start` in the log's time [s].
        phase: (n,) commanded phase.
        measured: (n,) bins; wheel angles are counted from the start [unit].
        before, after: (n,) simulated with the nuisances fitted.
        white_before, white_after: (n,) whitened residuals, zero where nothing was measured.
    """

    trial: str
    channel: str
    unit: str
    variant: float
    t: Array
    t_start: float
    phase: tuple[str, ...]
    measured: Array
    before: Array
    after: Array
    white_before: Array
    white_after: Array


CHANCE = 4.5
"""Standard deviations above which it is no chance: among some eighty pairs and bands one set of a thousand
reaches it, one of a hundred where the noise is learnt 20 % too low."""


@dataclass(frozen=True)
class Unrepeated:
    """The pair of channels whose pure errors go together most clearly.

    Attributes:
        score: in standard deviations of what independent noise gives; 0 where nothing was repeated.
        first, second: channels.
        low, high: band of frequency [Hz].
    """

    score: float = 0.0
    first: str = ""
    second: str = ""
    low: float = 0.0
    high: float = 0.0

    @property
    def plain(self) -> bool:
        """It is more than chance."""
        return self.score > CHANCE


@dataclass(frozen=True, eq=False)
class Finding:
    """What the trials say about the model.

    Attributes:
        verdict: "none", "named" or "unknown".
        sentence: the verdict in plain words.
        effects: what was named, or the empirical law.
        where: intervals in which the model without effects disagrees.
        left: the same with the effects.
        gap: over all channels and phases.
        gaps: per channel, per phase, and per channel and phase.
        rounds: candidates per round of the search, best first.
        threshold: evidence that chance exceeds in one set of a hundred.
        map_threshold: the same for the scores behind `where`.
        map_before, map_after: largest score on the map, without and with the effects.
        detectable: per candidate.
        confusion: (k, k) cosines between the candidates' signatures, nuisances projected out.
        confusion_ids: the candidates in the rows of `confusion`.
        residuals: per trial and channel.
        sand: number of the sand common to all trials to its logarithm over the file's value.
        sand_per_trial: per trial a_θ [s/m], k_φ and c as fitted.
        losses: speed [m/s] and the sum of whitened squares on its trials when that speed was left out,
            before and after.
        trial_losses: name of each trial, and the sum of its whitened squares when it was left out, before and
            after; empty with one trial.
        notes: what could not be told and why.
        robot, soil: of the baseline.
        active: the effects as they are switched on in a simulation.
        seed: of the bootstrap.
        virtual: all trials were written by a simulator.
        runs: simulations that were needed.
        unrepeated: what repetitions do not share and several sensors see, once the effects are in the model.
        self_check: what would come out of these very trials if one candidate were in them.
    """

    verdict: Verdict
    sentence: str
    effects: tuple[FoundEffect, ...]
    where: tuple[Disagreement, ...]
    left: tuple[Disagreement, ...]
    gap: Gap
    gaps: tuple[Gap, ...]
    rounds: tuple[tuple[Candidate, ...], ...]
    threshold: float
    map_threshold: float
    map_before: float
    map_after: float
    detectable: tuple[Detectable, ...]
    confusion: Array
    confusion_ids: tuple[str, ...]
    residuals: tuple[Residual, ...]
    sand: dict[str, Estimate]
    sand_per_trial: tuple[tuple[str, dict[str, float]], ...]
    losses: tuple[tuple[float, float, float], ...]
    trial_losses: tuple[tuple[str, float, float], ...]
    notes: tuple[str, ...]
    robot: Robot
    soil: Soil
    active: tuple[Active, ...]
    seed: int
    virtual: bool
    runs: int
    unrepeated: Unrepeated
    self_check: Confusion | None = None

    def to_frame(self) -> pd.DataFrame:
        """Return one row a candidate: its evidence beside what chance alone reaches, and its fate."""
        import pandas as pd  # noqa: PLC0415

        named = {effect.id for effect in self.effects}
        rows = [
            (number, c.id, c.evidence, self.threshold, c.status, c.id in named)
            for number, candidates in enumerate(self.rounds, 1)
            for c in candidates
        ]
        return pd.DataFrame(rows, columns=["round", "effect", "evidence", "threshold", "status", "named"])
