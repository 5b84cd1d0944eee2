"""From fits to the Finding: gaps, residuals, named numbers and plain words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granite_lab.discovery.baseline import by_command, noise_floor, pure_error
from granite_lab.discovery.bench import PER_TRIAL, SAND
from granite_lab.discovery.empirical import EmpiricalLaw
from granite_lab.discovery.finding import (
    Candidate,
    Finding,
    FoundEffect,
    FoundParameter,
    Gap,
    Residual,
)
from granite_lab.discovery.lackfit import disagreements, rows_of
from granite_lab.discovery.observation import CHANNELS, UNITS
from granite_lab.discovery.point import Fit
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.refit import covariance, held_out
from granite_lab.discovery.select import Choice
from granite_lab.discovery.shown import Confusion, Detectable
from granite_lab.discovery.slopes import blocks_at
from granite_lab.discovery.unknown import Judgement
from granite_lab.discovery.words import notes, sentence
from granite_lab.estimate import Estimate
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Active
from granite_lab.parameters import load_paper

PHASES = ("rest", "accelerate", "steady", "brake")


def assemble(
    *,
    problem: Problem,
    base: Fit,
    choice: Choice,
    judgement: Judgement,
    detectable: tuple[tuple[Detectable, ...], tuple[str, ...], Array],
    threshold: float,
    seed: int,
    virtual: bool,
    self_check: Confusion | None = None,
) -> Finding:
    """Gather everything under the noise as it was learnt last."""
    world, after = problem.bench.world, judgement.fit
    before = _under_present_noise(problem, base)
    after = _under_present_noise(problem, after)
    each = list(range(len(problem.trials)))
    speeds = [t.variant for t in problem.trials]
    many = len(each) > 1
    predicted = [held_out(problem, f, each).white if many else f.white for f in (before, after)]
    floor = noise_floor(problem, pure_error(problem, after.white))
    gaps = _gaps(problem, [before.white, after.white, floor], [*predicted, floor])
    found = effects_of(problem, after, choice, threshold)
    # so that noise alone gives one for each number that was measured
    unit = sum(float(e @ e) for e in floor) / problem.count
    losses: list[tuple[float, float, float]] = []
    if len(set(speeds)) > 1:
        other = [held_out(problem, f, speeds).white for f in (before, after)]
        for own in by_command(problem):
            sums = [float(sum(w[i] @ w[i] for i in own)) / unit for w in other]
            losses.append((problem.trials[own[0]].observation.variant.velocity, sums[0], sums[1]))
    return Finding(
        verdict=judgement.verdict,
        sentence=sentence(judgement, found, gaps[0]),
        effects=found,
        where=tuple(disagreements(problem, before.white, judgement.threshold)),
        left=tuple(disagreements(problem, after.white, judgement.threshold)),
        gap=gaps[0],
        gaps=tuple(gaps[1:]),
        rounds=tuple(
            tuple(Candidate(t.effect, t.evidence, t.screened.evidence, t.status, t.bounds) for t in r)
            for r in choice.rounds
        ),
        threshold=threshold,
        map_threshold=judgement.threshold,
        map_before=judgement.score_before,
        map_after=judgement.score_after,
        detectable=detectable[0],
        confusion=detectable[2],
        confusion_ids=detectable[1],
        residuals=tuple(_residuals(problem, before, after)),
        sand=_sand(problem, after),
        sand_per_trial=tuple(_sand_of(problem, after, i) for i in each),
        losses=tuple(losses),
        trial_losses=tuple(
            (t.observation.name, float(a @ a) / unit, float(b @ b) / unit)
            for t, a, b in zip(problem.trials, *predicted, strict=True)
            if many
        ),
        notes=notes(problem, judgement, choice, found),
        robot=world.robot,
        soil=world.soil,
        active=_active(problem, after),
        seed=seed,
        virtual=virtual,
        runs=problem.bench.runs,
        unrepeated=judgement.unrepeated,
        self_check=self_check,
    )


def _under_present_noise(problem: Problem, fit: Fit) -> Fit:
    white = problem.white(fit.residuals)
    blocks = blocks_at(problem, fit.point, fit.slopes)
    return Fit(
        fit.point, fit.residuals, problem.chi2(white, fit.point), blocks, fit.slopes, fit.converged, white
    )


def _gaps(problem: Problem, train: Sequence[Sequence[Array]], held: Sequence[Sequence[Array]]) -> list[Gap]:
    """Return the gap over all, per channel, per phase, and per channel and phase."""
    channels = [c for c in CHANNELS if any(c in t.channels for t in problem.trials)]
    pairs = [("all", "all"), *((c, "all") for c in channels), *(("all", p) for p in PHASES)]
    pairs += [(c, p) for c in channels for p in PHASES]
    # sums of squares and counts of each cell, once
    cells: dict[tuple[str, str], Array] = {}
    for i, trial in enumerate(problem.trials):
        phase = np.array(trial.observation.phase)
        for k, c in enumerate(trial.channels):
            known = problem.whiteners[i][k].known
            rows = [rows_of(problem, i, c, w[i]) ** 2 for w in (*train, *held)]
            for p in PHASES:
                inside = known & (phase == p)
                add = np.array([*(float(r[inside].sum()) for r in rows), float(inside.sum())])
                cells[c, p] = cells.get((c, p), np.zeros(add.size)) + add
    found = []
    for channel, name in pairs:
        own = [v for (c, p), v in cells.items() if channel in ("all", c) and name in ("all", p)]
        total = np.sum(own, axis=0) if own else np.zeros(len(train) + len(held) + 1)
        rms = np.sqrt(total[:-1] / total[-1]) if total[-1] > 0 else np.full(total.size - 1, np.nan)
        a, b = (
            (part / part[-1] if part[-1] > 0 else np.full(3, np.nan)).tolist() for part in np.split(rms, 2)
        )
        found.append(Gap(channel, name, (a[0], a[1], a[2]), (b[0], b[1], b[2])))
    return found


def effects_of(problem: Problem, fit: Fit, choice: Choice, threshold: float) -> tuple[FoundEffect, ...]:
    """Return the effects of a fit with their numbers."""
    Σ = covariance(problem, fit)
    place = len(SAND)
    n_own = 0
    found = []
    for id_ in fit.point.effects:
        effect, parameters = problem.effect(id_), []
        for k in problem.places(id_):
            p = effect.parameters[k]
            if p.per_trial:
                column = [t.size + n_own for t in problem.trials]
                values = [float(x[c]) for x, c in zip(fit.point.trials, column, strict=True)]
                variance = [
                    float(b.solve(np.eye(b.normal.shape[0])[:, c])[c])
                    for b, c in zip(fit.blocks, column, strict=True)
                ]
                rms = float(np.sqrt(np.mean(np.square(values))))
                std = float(np.sqrt(np.mean(variance) / len(values)))
                parameters.append(FoundParameter(p.name, p.unit, Estimate(rms, std), tuple(values)))
                n_own += 1
            else:
                value = float(fit.point.common[place - len(SAND)])
                parameters.append(
                    FoundParameter(p.name, p.unit, Estimate(value, float(np.sqrt(max(Σ[place, place], 0)))))
                )
                place += 1
        evidence = next(
            (t.evidence for r in choice.rounds for t in r if t.effect == id_ and t.fit is not None), threshold
        )
        found.append(
            FoundEffect(
                id_,
                effect.title,
                tuple(parameters),
                choice.twins.get(id_, ()),
                evidence,
                id_ == EmpiricalLaw.id,
            )
        )
    return tuple(found)


def _active(problem: Problem, fit: Fit) -> tuple[Active, ...]:
    point = fit.point
    own = np.mean([x[t.size :] for t, x in zip(problem.trials, point.trials, strict=True)], axis=0)
    return tuple(
        Active(problem.effect(id_), values)
        for id_, values in problem.setting(point.effects, point.common, own)
    )


def _residuals(problem: Problem, before: Fit, after: Fit) -> list[Residual]:
    found = []
    for i, trial in enumerate(problem.trials):
        o = trial.observation
        for k, c in enumerate(trial.channels):
            found.append(
                Residual(
                    trial=o.name,
                    channel=c,
                    unit=UNITS[c],
                    variant=o.variant.velocity,
                    t=o.t,
                    t_start=o.t_start,
                    phase=o.phase,
                    measured=trial.measured[k],
                    before=trial.measured[k] - before.residuals[i][k],
                    after=trial.measured[k] - after.residuals[i][k],
                    white_before=rows_of(problem, i, c, before.white[i]),
                    white_after=rows_of(problem, i, c, after.white[i]),
                )
            )
    return found


def _sand(problem: Problem, fit: Fit) -> dict[str, Estimate]:
    std = np.sqrt(np.diag(covariance(problem, fit)))
    return {name: Estimate(float(fit.point.sand[k]), float(std[k])) for k, name in enumerate(SAND)}


def _sand_of(problem: Problem, fit: Fit, i: int) -> tuple[str, dict[str, float]]:
    soil = problem.bench.world.soil
    base = {"a_theta": load_paper().a_theta} | {n: float(getattr(soil, n)) for n in SAND[1:]}
    ratio = np.exp(fit.point.sand[:PER_TRIAL] + fit.point.trials[i][:PER_TRIAL])
    return problem.trials[i].observation.name, {
        n: base[n] * float(r) for n, r in zip(SAND[:PER_TRIAL], ratio, strict=True)
    }
