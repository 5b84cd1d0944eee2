"""`discover`: from trials to a Finding."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from granite_lab.discovery.assemble import assemble
from granite_lab.discovery.baseline import baseline, from_weak_sand, pure_error
from granite_lab.discovery.bench import Bench, Respond, World
from granite_lab.discovery.chance import null_maximum
from granite_lab.discovery.confusion import confusion
from granite_lab.discovery.detect import detectability
from granite_lab.discovery.empirical import EmpiricalLaw
from granite_lab.discovery.finding import Finding
from granite_lab.discovery.lackfit import largest_score
from granite_lab.discovery.plan_conditions import under_conditions
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.refit import enough
from granite_lab.discovery.screen import scores
from granite_lab.discovery.select import search
from granite_lab.discovery.setup import trial_models
from granite_lab.discovery.signature import signatures
from granite_lab.discovery.unknown import LEAST, judge
from granite_lab.estimation.motion import Motion
from granite_lab.logs.trial import Trial
from granite_lab.model.effect import Effect
from granite_lab.parameters import Robot, Soil
from granite_lab.processes import one_thread

ALLOWANCE = 18.0
"""Least evidence that counts. By chance alone 1 set of 100 exceeds about 12 over all candidates; the
rest is for what the chance model leaves out (sand off the file, noise that is not quite as learnt)."""

FALSE_ALARMS = 0.01


def discover(
    trials: Sequence[Trial],
    robot: Robot,
    soil: Soil,
    *,
    effects: Mapping[str, Effect],
    motions: Sequence[Motion] | None = None,
    seed: int = 0,
    jobs: int = 1,
    respond: Respond | None = None,
    progress: Callable[[str, int], None] = lambda *_: None,
) -> Finding:
    """Find out whether the model explains trials, and if not, what is missing.

    Args:
        trials: the logs of one robot on one soil.
        robot, soil: the model's numbers.
        effects: candidates by id.
        motions: estimates of the trials, in their order; without them the logs say what was
            commanded and when.
        seed: of the bootstrap that sets the thresholds.
        jobs: number of processes.
        respond: does the simulations in their place.
        progress: told what is being done and how many simulations are done so far.

    Raises:
        InputError: nothing says what was commanded, or the robot cannot be simulated.
        EstimateError: a trial has no sensor to compare with, or the simulation fails.
    """
    order = sorted(range(len(trials)), key=lambda i: trials[i].name)
    trials = [trials[i] for i in order]
    motions = [motions[i] for i in order] if motions is not None else None
    models, variants = trial_models(trials, robot, motions)
    candidates = dict(sorted(effects.items()))
    world = World(robot, soil, variants, candidates | {EmpiricalLaw.id: EmpiricalLaw()})
    world = under_conditions(world, trials, models)
    stage = ["fitting the model"]

    def tell(text: str) -> None:
        stage[0] = text
        progress(text, bench.runs)

    with one_thread(), Bench(world, jobs, lambda _: progress(stage[0], bench.runs), respond) as bench:
        problem = Problem(models, bench)
        tell("fitting the model without effects")
        base = baseline(problem)
        tell("screening every candidate")
        signs = signatures(problem, base, candidates, small=enough(problem, base))
        rng = np.random.default_rng(seed)
        error = pure_error(problem, base.white)
        chance = null_maximum(problem, base, signs, error, rng)
        threshold = max(ALLOWANCE, float(np.quantile(chance, 1 - FALSE_ALARMS)))
        promising = scores(problem, base, signs, candidates)[0].evidence > threshold
        if promising or largest_score(problem, base.white) > LEAST:
            tell("trying weaker sand")
            other = from_weak_sand(problem, base)
            if other is not base:
                base = other
                signs = signatures(problem, base, candidates)
        detectable = detectability(base, signs, candidates, threshold)
        tell("checking what these trials could show")
        check = confusion(problem, base, signs, candidates, threshold, detectable=detectable[0], seed=seed)
        choice = search(problem, base, signs, candidates, threshold, tell)
        tell("looking at what is left")
        judgement = judge(problem, choice.base, choice, threshold, rng, FALSE_ALARMS)
        return assemble(
            problem=problem,
            base=choice.base,
            choice=choice,
            judgement=judgement,
            detectable=detectable,
            threshold=threshold,
            seed=seed,
            self_check=check,
            virtual=all(t.info.virtual for t in trials),
        )
