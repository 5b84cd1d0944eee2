"""`plan_next`: the trials that could be driven next, and which would best answer what a search left open."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.inference.conditions import PLAIN, STAGING, Conditions, StagedScenario
from granite_lab.inference.pool import SAND, Setting, SimulationPool
from granite_lab.logs.trial import Array
from granite_lab.model.command import duration, peak_velocity
from granite_lab.model.effect import Effect
from granite_lab.parameters import Variant
from granite_lab.planning.design import Design, Driven
from granite_lab.planning.stage import DECISIVE, Question, Stage, explanations, fitted, question
from granite_lab.processes import Progress, one_thread
from granite_lab.shown import Shown, frame

if TYPE_CHECKING:
    import pandas as pd

FIFTH = 0.8
"""A standard deviation that falls to this share, or less, is worth a trial."""

FASTER, SLOWER = 1.25, 0.6
"""Proposed speeds over the fastest and the slowest so far: near enough for the fitted model to hold."""

SHARPER = 2.0
"""Factor of the accelerations so far."""

STEADY_TIME = 2.5
"""Time at constant speed of a proposed command [s], where the room allows it: slip is steady after 0.35 s."""

PAYLOAD = 0.2
"""Payload as a share of the robot's mass: it shows in slip and sinkage, and most robots bear it."""

RAMP = 3.0
"""Slope [deg]: a pull of 5 % of the weight, far below where sand gives way."""

LONGEST = 20.0
"""A proposed command takes no longer [s]."""

Outlook = dict[str, float]
"""By trials: number to relative standard deviation, or "a from b" to expected log Bayes factor."""


@dataclass(frozen=True)
class CandidateTrial:
    """A trial that could be driven: what it adds, and how it is done.

    Attributes:
        like: the trials at hand whose channels and noise it would have.
        repeats: command and conditions are those of trials at hand.
    """

    variant: Variant
    conditions: Conditions
    like: Driven
    why: str
    how: str = "rake the sand and give this command"
    repeats: bool = False


@dataclass(frozen=True)
class Proposal:
    """A trial that could be driven, with what would be known after it.

    Attributes:
        after: with it and the trials at hand.
        improves: what it improves most.
        worth: a standard deviation falls by a fifth or more, or a Bayes factor becomes 20 times larger.
        rank: the smaller, the better.
    """

    trial: CandidateTrial
    after: Outlook
    improves: str
    worth: bool
    rank: tuple[float, float, bool]


@dataclass(frozen=True)
class Plan(Shown):
    """The proposals, the best first.

    Attributes:
        models: the explanations with their values.
        now: by the trials at hand, those of the `design`.
        failed: number of commands that cannot be simulated.
    """

    question: Question
    models: tuple[Setting, ...]
    now: Outlook
    proposals: tuple[Proposal, ...]
    failed: int
    design: Design

    def __repr__(self) -> str:
        best = self.proposals[0].trial if self.proposals else None
        first = f"first {best.variant.velocity:g} m/s, {best.conditions.words or 'level'}" if best else "none"
        return (
            f"Plan({len(self.proposals)} proposals, {first}{'' if self.worth else '; none is worth driving'})"
        )

    @property
    def worth(self) -> bool:
        """Whether any trial is worth driving."""
        return any(p.worth for p in self.proposals)

    def to_frame(self) -> pd.DataFrame:
        """Return the proposals, one row each, best first, with what each improves most."""
        columns = ["v_mps", "a_mps2", "distance_m", "conditions", "repeats", "improves", "before", "after"]
        rows = []
        for p in self.proposals:
            o, v = p.trial, p.trial.variant
            change = (p.improves, self.now[p.improves], p.after[p.improves])
            row = (v.velocity, v.acceleration, v.distance, o.conditions.words, o.repeats, *change)
            rows.append(dict(zip(columns, row, strict=True)) | {"worth": p.worth, "why": o.why})
        return frame(rows, [*columns, "worth", "why"])


@one_thread()
def plan_next(
    design: Design,
    library: Mapping[str, Effect],
    *,
    room: float | None = None,
    max_speed: float | None = None,
    jobs: int = 1,
    progress: Progress = lambda *_: None,
) -> Plan:
    """Rank trials by how well they would answer what is open.

    Args:
        design: the trials at hand, and what came out.
        library: effects by id.
        room: longest way the sand allows [m]; the longest so far by default.
        max_speed: fastest command [m/s].
        jobs: number of processes.
        progress: called with what is done, how many trials are looked at, and of how many.

    Raises:
        EstimateError: the trials at hand, or the explanations, cannot be simulated.
        InputError, UsageError: as in `question`.
    """
    asked = question(design, library)
    effects = {*asked.rivals, *dict(asked.named)}
    chosen = candidate_trials(design, effects, room=room, max_speed=max_speed)
    variants = (*(d.variant for d in design.driven), *(o.variant for o in chosen))
    conditions = (*(d.conditions for d in design.driven), *(o.conditions for o in chosen))
    scenario = StagedScenario(
        design.robot, design.soil, variants, {**library, **STAGING}, conditions=conditions
    )
    with SimulationPool(scenario, jobs) as pool:
        stage = Stage(design, pool, [o.like for o in chosen])
        models = (asked.named,) if asked.kind == "sharpen" else explanations(stage, asked)
        false = models if asked.kind == "apart" else models[:1]
        pairs = [(model, [m for m in models if m is not model]) for model in false]
        at_hand = [stage.at_hand(model, others) for model, others in pairs]
        now = _outlook(stage, models, at_hand)
        looked: list[tuple[CandidateTrial, Outlook]] = []
        for k, trial in enumerate(chosen):
            progress("looking at trials", k + 1, len(chosen))
            number = design.driven.index(trial.like) if trial.repeats else len(design.driven) + k
            try:
                more = [stage.further_trial(number, model, others) for model, others in pairs]
            except EstimateError:
                continue
            after = [a + b for a, b in zip(at_hand, more, strict=True)]
            looked.append((trial, _outlook(stage, models, after)))
    if asked.kind == "sharpen":
        now = _worst(now, [o for _, o in looked])
    proposals = [_judged(asked, trial, now, {t: after[t] for t in now}) for trial, after in looked]
    proposals.sort(key=lambda p: (not p.worth, p.rank))
    return Plan(asked, models, now, tuple(proposals), len(chosen) - len(looked), design)


def _worst(now: Outlook, after: Sequence[Outlook]) -> Outlook:
    """Return the number with the largest relative std, of those that a trial can improve if there are any."""
    helped = [t for t in now if any(a[t] <= FIFTH * now[t] for a in after)]
    worst = max(helped or now, key=lambda t: now[t])
    return {worst: now[worst]}


def _judged(asked: Question, trial: CandidateTrial, now: Outlook, after: Outlook) -> Proposal:
    """Judge a trial; of several pairs those count that it decides.

    Twins must be distinguished by the new trial alone, because the trials at hand do not decide between them.
    An effect that was too weak so far is shown by all trials together.
    """
    if asked.kind == "sharpen":
        ((name, std),) = after.items()
        return Proposal(trial, after, name, std <= FIFTH * now[name], (std, 0.0, not trial.repeats))
    shows = asked.kind == "show"
    gained = {t: after[t] - (0.0 if shows and now[t] < DECISIVE else now[t]) for t in now}
    best = max(gained, key=lambda t: gained[t])
    rank = (-sum(min(g, DECISIVE) for g in gained.values()), -gained[best], not trial.repeats)
    return Proposal(trial, after, best, gained[best] >= DECISIVE, rank)


def _outlook(stage: Stage, models: Sequence[Setting], informations: Sequence[Array]) -> Outlook:
    """Return the expected outcome of trials by their information under each model that may be false."""
    if len(models) == 1:
        return _stds(stage, models[0], informations[0])
    k = len(models) - 1
    names = [m[-1][0] if m else "nothing" for m in models]
    factors_of: Outlook = {}
    for b, information in enumerate(informations):
        # half of what remains of a difference when all numbers of the false one are fitted to it
        factors = np.fmax(0.0, np.diag(fitted(information, k).rest) / 2)
        for a, factor in zip((n for n in range(len(models)) if n != b), factors, strict=True):
            pair = f"{names[max(a, b)]} from {names[min(a, b)]}"
            factors_of[pair] = min(factors_of.get(pair, np.inf), float(factor))
    return factors_of


def _stds(stage: Stage, named: Setting, information: Array) -> Outlook:
    """Return the relative std of each named strength; of a_θ and the sand where there is none."""
    std = np.sqrt(np.diag(fitted(information, 0).covariance))
    problem = stage.problem(0)
    point = stage.point(problem, named)
    strengths = problem.parameters(point.effects, per_trial=False)
    stds = {
        f"{id_}.{p.name}": float(s / abs(x - p.neutral))
        for (id_, p), x, s in zip(strengths, point.common, std[std.size - len(strengths) :], strict=True)
        if not p.shape and x != p.neutral
    }
    return stds or {name: float(std[k]) for k, name in enumerate(SAND)}


def candidate_trials(
    design: Design, effects: Collection[str], *, room: float | None = None, max_speed: float | None = None
) -> list[CandidateTrial]:
    """List the trials that are worth simulating; room and speed as in `plan_next`.

    Args:
        design: the trials at hand.
        effects: ids of all explanations; some conditions matter only to some of them.
    """
    ranked = sorted(design.driven, key=lambda d: peak_velocity(d.variant))
    slow, fast = ranked[0], ranked[-1]
    speeds = [peak_velocity(d.variant) for d in ranked]
    starts = [d.variant.acceleration for d in ranked]
    room = room or max(d.variant.distance for d in ranked)
    free, drive = math.inf, design.robot.drive
    if drive is not None:  # what the voltage allows, with a reserve for torque
        free = 0.8 * drive.voltage_max / (drive.emf_constant * drive.gear_ratio) * design.robot.wheels.radius
    top = max_speed or max(speeds[-1], min(FASTER * speeds[-1], free))
    proposed = [
        CandidateTrial(d.variant, d.conditions, d, "averages noise and scatter of the sand", repeats=True)
        for d, v in zip(ranked, speeds, strict=True)
        if d.variant.distance <= room and v <= top
    ]

    listed = {(o.variant, o.conditions) for o in proposed}

    def add(like: Driven, v: float, a: float, why: str, way: float = 0.0) -> None:
        """Add a command on raked, level sand if the room suffices and it is new."""
        digit = 10.0 ** (math.floor(math.log10(v)) - 1)  # speeds are rounded down, to two digits
        v, a = float(f"{math.floor(min(v, top) / digit + 1e-6) * digit:.2g}"), float(f"{a:.2g}")
        way = way or min(room, math.ceil(2 * (v * v / a + STEADY_TIME * v)) / 2)
        new = Variant(velocity=v, acceleration=a, distance=way)
        if v * v / a <= way and duration(new) <= LONGEST and (new, PLAIN) not in listed:
            listed.add((new, PLAIN))
            proposed.append(CandidateTrial(new, PLAIN, like, why))

    add(slow, SLOWER * speeds[0], starts[0], "lower speed than before: sinkage and slip at slow shear")
    if top > 1.02 * speeds[-1]:
        add(fast, top, starts[-1], "higher speed than before: effects that grow with speed are larger")
    below, above = max(pairwise(speeds), key=lambda p: p[1] / p[0], default=(1.0, 1.0))
    if above > 1.2 * below:
        add(fast, math.sqrt(below * above), starts[-1], "speed between the previous ones")
    for like, v in ((slow, speeds[0]), (fast, speeds[-1])):
        add(like, v, SHARPER * max(starts), "higher acceleration than before: excites pitch, tyres and gears")
        add(like, v, min(starts) / SHARPER, "lower acceleration than before: less influence of inertia")
    if room > 1.2 * fast.variant.distance:
        add(fast, speeds[-1], starts[-1], "longer distance: effects of distance or time accumulate", room)
    plain = [o.like for o in proposed if o.repeats and o.conditions == PLAIN]
    for like in dict.fromkeys(plain[:1] + plain[-1:]):
        for under, why, how in _conditions(design, effects):
            if (like.variant, under) not in listed:
                proposed.append(CandidateTrial(like.variant, under, like, why, how))
    return proposed


def _conditions(design: Design, effects: Collection[str]) -> list[tuple[Conditions, str, str]]:
    """List conditions with why and how."""
    level = f"by {RAMP:g}°, measured with a level"
    listed = [
        (Conditions(slope=RAMP), "known force against the motion: more slip, same drives",
         f"raise the far end of the box {level}"),
        (Conditions(slope=-RAMP), "known force along the motion: less slip, same drives",
         f"raise the near end of the box {level}"),
        (Conditions(wheels_up=True), "no ground contact: only the drives are measured",
         "put the robot on a block so that no wheel touches anything, and give the command"),
    ]  # fmt: skip
    if design.robot.chassis is not None:
        mass = float(f"{PAYLOAD * design.robot.chassis.total_mass:.1g}")
        how = f"fix {mass:g} kg at the centre of mass"
        listed.append((Conditions(payload=mass), "more load on the wheels, same drives", how))
    if "ground_slope" in effects:
        how = "turn the robot round and drive back over ground raked as before; do not move the IMU"
        listed.append((Conditions(turned=True), "slope with opposite sign, everything else unchanged", how))
    if "multi_pass" in effects:
        how = "drive once on raked sand, lift the robot back and drive again in the same rut"
        listed.append((Conditions(same_rut=True), "all wheels run in compacted sand from the start", how))
    return listed
