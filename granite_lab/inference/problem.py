"""The least-squares problem: trials, simulations, noise and priors, as functions of the numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from granite_lab.inference.constants import LEAD_STD, NEAR_ZERO, SAND_STD, THREE_SIGMA
from granite_lab.inference.discrepancy import FORMULA, Basis, joined, modulated, plain_bases, sizes_of
from granite_lab.inference.noise import Filter, Whitener, stretches
from granite_lab.inference.normal import ChannelPart, CommandPart, NormalEquations, Places, Rows, Scales
from granite_lab.inference.nuisances import SENSORS, SENSORS_LEAST, TrialModel, sensors_std
from granite_lab.inference.observation import Mask
from granite_lab.inference.point import SHARED, Derivatives, Further, Point
from granite_lab.inference.pool import SAND, SAND_PER_TRIAL, SIMULATED, Setting, SimulationPool, Task
from granite_lab.inference.priors import centre_of, trial_scale_name, width_of
from granite_lab.logs.trial import Array
from granite_lab.model.effect import EffectParameter


def _numbered(numbers: Sequence[int]) -> tuple[tuple[tuple[int, ...], ...], tuple[int, ...]]:
    """Return the trials that have each of some numbers, in their order, and per trial its place there."""
    distinct = sorted(set(numbers))
    groups = tuple(tuple(i for i, value in enumerate(numbers) if value == number) for number in distinct)
    return groups, tuple(distinct.index(value) for value in numbers)


SECONDS = 60.0
"""Processor time for the simulations of each trial [s], beyond which a search tries nothing further. Those of
twelve trials usually take 10 to 500 s in all. Stiff ones (play in gears) with numbers that each trial has of
its own took more than an hour. Convention."""


class Problem:
    """The trials, the simulations, the noise and the priors.

    Args:
        trials: in bins.
        pool: runs the simulations.
        sand_std: std of the common sand, as `SAND`.

    Attributes:
        inputs: numbers of the trials that one simulation serves; what motors follow is the same in all
            repetitions of a command, wheels that drive the simulation are those of one trial.
        commands: numbers of the trials that repeat a command; they share noise and discrepancy.
        input_of, command_of: per trial its place among these.
        learnt_std: number of the trials whose std is learnt to the first value of that std, see `Slack`.
    """

    def __init__(
        self, trials: Sequence[TrialModel], pool: SimulationPool, sand_std: Sequence[float] = SAND_STD
    ) -> None:
        self.trials, self.pool, self.sand_std = tuple(trials), pool, np.array(sand_std)
        self.learnt_std = {s.name: s.std for t in self.trials for s in t.slacks if s.learnt}
        self.simulated_std = np.append(self.sand_std, LEAD_STD)
        self.sensors_std = sensors_std(self.learnt_std)
        self.inputs, self.input_of = _numbered([t.variant for t in trials])
        self.commands, self.command_of = _numbered([t.command for t in trials])
        self.whiteners: list[list[Whitener]] = []
        self._alike: dict[Whitener, list[tuple[int, int]]] = {}  # trials and channels that share it
        self._plain: list[dict[str, tuple[Basis, ...]]] = []
        self._white_plain: dict[tuple[int, str, Filter], tuple[Array, Array]] = {}
        self._sizes: list[dict[str, tuple[float, Mask, Mask]]] = []
        self.rows = tuple(
            {c: slice(k * t.observation.bins, (k + 1) * t.observation.bins) for k, c in enumerate(t.channels)}
            for t in self.trials
        )

    @property
    def is_exhausted(self) -> bool:
        """Whether the simulations have taken the time that a search has for them."""
        return self.pool.seconds > SECONDS * len(self.trials)

    def places_of(self, trials: Sequence[int]) -> dict[str, list[tuple[int, int]]]:
        """Return channel to (trial, row there), of those of some trials that measured it."""
        places: dict[str, list[tuple[int, int]]] = {}
        for i in trials:
            for k, c in enumerate(self.trials[i].channels):
                places.setdefault(c, []).append((i, k))
        return places

    # --- parameters

    def parameters_of(self, id_: str) -> tuple[EffectParameter, ...]:
        """Return the parameters of a candidate."""
        return self.pool.scenario.effects[id_].parameters

    def parameters(self, ids: Sequence[str], *, per_trial: bool) -> list[tuple[str, EffectParameter]]:
        """Return the shared or the per-trial parameters of effects, each with its effect's id, in order."""
        return [(id_, p) for id_ in ids for p in self.parameters_of(id_) if p.per_trial == per_trial]

    def neutral(self) -> Point:
        """Return the point of the files' values."""
        return Point(np.zeros(len(SHARED)), (), np.zeros(0), tuple(np.zeros(t.size) for t in self.trials))

    def with_effect(
        self, point: Point, id_: str, values: Sequence[float], trial_values: Array | None = None
    ) -> Point:
        """Return the point with one more effect switched on.

        Args:
            point: without it.
            id_: the effect.
            values: of all its parameters.
            trial_values: (trials, o) its own parameters of each trial, in place of those among `values`.
        """
        pairs = list(zip(self.parameters_of(id_), values, strict=True))
        private = np.array([v for p, v in pairs if p.per_trial])
        table = np.tile(private, (len(self.trials), 1)) if trial_values is None else trial_values
        return replace(
            point,
            effects=(*point.effects, id_),
            common=np.concatenate([point.common, [v for p, v in pairs if not p.per_trial]]),
            trials=tuple(np.concatenate([x, o]) for x, o in zip(point.trials, table, strict=True)),
        )

    def without_effect(self, point: Point, id_: str) -> Point:
        """Return the point with an effect switched off."""
        keep = [k for k, (e, _) in enumerate(self.parameters(point.effects, per_trial=False)) if e != id_]
        keep_private = [
            k for k, (e, _) in enumerate(self.parameters(point.effects, per_trial=True)) if e != id_
        ]
        return replace(
            point,
            effects=tuple(e for e in point.effects if e != id_),
            common=point.common[keep],
            trials=tuple(
                np.concatenate([x[: t.size], x[t.size :][keep_private]])
                for t, x in zip(self.trials, point.trials, strict=True)
            ),
        )

    def under_other_limit(self, point: Point) -> Point:
        """Return the point with the sand's strength at the files, where the other limit of (10) rules.

        Where friction on the tyre limits the shear stress everywhere, c and φ show nothing and stay at the
        files: the sand's strength limits it where μ_s is above tan φ by one std of its prior. Elsewhere the
        friction on the tyre limits it, with μ_s at tan φ.
        """
        names, soil = list(SAND), self.pool.scenario.soil
        c, φ, μ_s = (names.index(name) for name in ("cohesion", "friction_angle", "tyre_friction"))
        shared = point.shared.copy()
        by_tyre = np.abs(shared[[c, φ]]).max() < NEAR_ZERO
        shared[[c, φ]] = 0.0
        tan_φ = max(float(np.tan(np.radians(soil.friction_angle))), NEAR_ZERO)
        shared[μ_s] = np.log(tan_φ / soil.tyre_friction)
        shared[μ_s] += self.sand_std[μ_s] if by_tyre else 0.0
        trials = [x.copy() for x in point.trials]
        for x in trials:
            x[c] = 0.0
        return self.stepped(replace(point, shared=shared, trials=tuple(trials)), np.zeros(point.vector.size))

    def bounds(self, point: Point) -> tuple[Array, Array]:
        """Return the least and the largest values of `Point.vector`.

        The sand of a trial may be as far from that of the others as theirs may be from the file.
        """
        sides = []
        for sign, side, sensors in ((-1, "low", SENSORS_LEAST), (1, "high", np.full(len(SENSORS), np.inf))):
            private, common = (
                [getattr(p, side) for _, p in self.parameters(point.effects, per_trial=per_trial)]
                for per_trial in (True, False)
            )
            of_sand = sign * THREE_SIGMA * self.sand_std[:SAND_PER_TRIAL]
            trials = [
                np.concatenate([of_sand, np.full(t.size - SAND_PER_TRIAL, sign * np.inf), private])
                for t in self.trials
            ]
            sides.append(np.concatenate([*trials, THREE_SIGMA * sign * self.simulated_std, sensors, common]))
        return sides[0], sides[1]

    def stepped(self, point: Point, step: Array) -> Point:
        """Return the point a step further, within the bounds."""
        whole = np.clip(point.vector + step, *self.bounds(point))
        *trials, shared, common = np.split(
            whole, np.cumsum([*(x.size for x in point.trials), point.shared.size])
        )
        return Point(shared, point.effects, common, tuple(trials))

    def prior(self, point: Point, scales: Scales) -> tuple[Array, Array]:
        """Return standard deviations and means of the priors of `Point.vector`."""
        private = self.parameters(point.effects, per_trial=True)
        widths = [scales.priors.get(trial_scale_name(id_), width_of(p)) for id_, p in private]
        std = [
            np.array([*(scales.priors.get(s.name, s.std) for s in t.slacks), *widths]) for t in self.trials
        ]
        common = self.parameters(point.effects, per_trial=False)
        std += [self.simulated_std, self.sensors_std, np.array([width_of(p) for _, p in common])]
        size = sum(s.size for s in std[:-1])
        means = np.concatenate([np.zeros(size), [centre_of(p) for _, p in common]])
        return np.concatenate(std), means

    # --- simulations

    def setting(self, ids: Sequence[str], common: Array, trial_values: Array) -> Setting:
        """Return the effects with their values, for the simulator."""
        shared, private = iter(common.tolist()), iter(trial_values.tolist())
        return tuple(
            (id_, tuple(next(private if p.per_trial else shared) for p in self.parameters_of(id_)))
            for id_ in ids
        )

    def task(self, point: Point, trial: int, origin: Point | None = None) -> Task:
        """Return the simulation of one trial at its own sand, by the steps of that at an origin."""
        task = self.mean_task(point, (trial,))
        like = None if origin is None else self.task(origin, trial)
        return (
            replace(task, like=like)
            if like and like.leads == task.leads and self.pool.repeats(task)
            else task
        )

    def centre(self, point: Point, number: int) -> Task:
        """Return the simulation of an input at the mean of its trials' own numbers."""
        return self.mean_task(point, self.inputs[number])

    def mean_task(self, point: Point, group: Sequence[int]) -> Task:
        """Return the simulation at the mean of the own numbers of some trials of an input."""
        numbers = point.shared[: len(SIMULATED)].copy()
        numbers[:SAND_PER_TRIAL] += np.mean([point.trials[i][:SAND_PER_TRIAL] for i in group], axis=0)
        setting = self.setting(point.effects, point.common, self.private_mean(point, group))
        return self.pool.scenario.task(self.trials[group[0]].variant, numbers, setting)

    def private_mean(self, point: Point, group: Sequence[int]) -> Array:
        """Return (o,) the mean of the effects' own parameters of some trials."""
        return np.asarray(np.mean([point.trials[i][self.trials[i].size :] for i in group], axis=0))

    def respond(self, tasks: Sequence[Task]) -> list[Array] | None:
        """Return the (8, M) response of each simulation; None where one has no solution."""
        responses = [r for r in self.pool.run(tasks) if r is not None]
        return responses if len(responses) == len(tasks) else None

    def residuals(self, point: Point, responses: Sequence[Array]) -> tuple[Array, ...]:
        """Return per trial (C, n) measured minus predicted."""
        return tuple(
            t.measured - t.predict(r, x[: t.size], point.sensors)
            for t, r, x in zip(self.trials, responses, point.trials, strict=True)
        )

    def white(self, residuals: Sequence[Array]) -> tuple[Array, ...]:
        """Return per trial the (C n,) whitened residuals."""
        white = [np.empty(r.size) for r in residuals]
        for whitener, rows in self._alike.items():
            whitened = whitener(np.column_stack([residuals[i][k] for i, k in rows]))
            for (i, k), row in zip(rows, whitened.T, strict=True):
                white[i][k * row.size : (k + 1) * row.size] = row
        return tuple(white)

    def whiten(self, trial: int, columns: Array) -> Array:
        """Return whitened (C n,) or (C n, k) columns of one trial."""
        parts = np.split(columns, len(self.whiteners[trial]))
        return np.concatenate([w(part) for w, part in zip(self.whiteners[trial], parts, strict=True)])

    @property
    def counts(self) -> dict[str, int]:
        """Channel to how many bins were measured, over all trials."""
        counts: dict[str, int] = {}
        for t, whiteners in zip(self.trials, self.whiteners, strict=True):
            for c, w in zip(t.channels, whiteners, strict=True):
                counts[c] = counts.get(c, 0) + int(w.measured.sum())
        return counts

    # --- normal equations

    def set_noise(self, whiteners: list[list[Whitener]], point: Point, derivatives: Derivatives) -> None:
        """Set the noise, and the size of each channel's discrepancy from the responses at a point."""
        self.whiteners = whiteners
        self._alike = {}
        for i, of_trial in enumerate(whiteners):
            for k, whitener in enumerate(of_trial):
                self._alike.setdefault(whitener, []).append((i, k))
        self._plain, self._white_plain, self._sizes = [], {}, []
        for repetitions in self.commands:
            t, x, response = (
                self.trials[repetitions[0]],
                point.trials[repetitions[0]],
                derivatives.response[self.input_of[repetitions[0]]],
            )
            bins = t.bins_of(response, x, point.sensors)
            size, moving, resting = sizes_of([self.trials[i] for i in repetitions], response, bins)
            sizes = {c: (size.get(c, 0.0), moving, resting) for c in self.places_of(repetitions)}
            self._plain.append({c: plain_bases(*of, t.observation.width) for c, of in sizes.items()})
            self._sizes.append(sizes)

    def rms_of(self, command: int, channel: str) -> tuple[float, Mask]:
        """Return the rms of a channel in motion, and (n,) where the robot moves."""
        return self._sizes[command][channel][:2]

    def resting(self, command: int, channel: str) -> Array:
        """Return (n,) the rms of a channel in motion where the robot is near rest, else 0."""
        size, _, at = self._sizes[command][channel]
        return np.where(at, size, 0.0)

    def normal(
        self,
        point: Point,
        derivatives: Derivatives,
        residuals: Sequence[Array],
        *,
        apart: bool = False,
        further: Further | None = None,
        keep: bool = True,
    ) -> NormalEquations:
        """Return the normal equations at a point.

        Args:
            point: where.
            derivatives: there.
            residuals: (C, n) per trial there.
            apart: each trial has a discrepancy of its own instead of sharing it with its repetitions.
            further: columns behind those of the parameters; those that each trial has of its own become a
                column a trial, behind the others.
            keep: keep the rows, which only other residuals need.
        """
        white = self.white(residuals)
        first = np.cumsum([0, *(x.size for x in point.trials)])
        local = int(first[-1])
        p = local + len(SHARED) + point.common.size
        per_trial = further.per_trial if further else 0
        end = p + (further.count if further else 0)
        size = end + per_trial * len(self.trials) + 1

        parts = []
        for command, repetitions in enumerate(self.commands):
            rows: dict[int, tuple[Places, Array]] = {}
            shared = np.arange(local, p)
            if further:
                shared = np.append(shared, p + further.places(command))
            for i in repetitions:
                private, candidates = (
                    np.arange(first[i], first[i + 1]),
                    end + i * per_trial + np.arange(per_trial),
                )
                columns = further.columns.get(i) if further else None
                columns = self.columns(i, point, derivatives, further) if columns is None else columns
                rows[i] = np.concatenate([private, shared, candidates]), self.whiten(i, columns)
            traces = self._traces(point, derivatives, command)
            for group in [(i,) for i in repetitions] if apart else [repetitions]:
                at = np.unique(np.concatenate([*(rows[i][0] for i in group), [size - 1]]))
                channels = (
                    self._channel((command, c), places, at, rows, white, traces)
                    for c, places in self.places_of(group).items()
                )
                part = CommandPart(at, tuple(chain.from_iterable(channels)))
                parts.append(part if keep else part.without_rows())
        return NormalEquations(tuple(parts), size, p)

    def _traces(self, point: Point, derivatives: Derivatives, command: int) -> dict[str, list[Array]]:
        """Return channel to the (n,) trace of each effect in a command."""
        if not point.effects:
            return {}
        i = self.commands[command][0]
        bins = self.trials[i].bins_of(derivatives.traces[self.input_of[i]], point.trials[i], point.sensors)
        return {c: list(values.T) for c, values in bins.items()}

    def bases(self, point: Point, derivatives: Derivatives, command: int, name: str) -> list[Basis]:
        """Return per stretch of a command the (n, m) discrepancy of a channel [unit of the channel]."""
        return [
            joined(parts) for parts in self._bases(self._traces(point, derivatives, command), command, name)
        ]

    def _bases(self, traces: Mapping[str, list[Array]], command: int, name: str) -> list[list[Basis]]:
        """Return the columns per stretch, those of the errors of formulas, one effect each, the last ones."""
        o = self.trials[self.commands[command][0]].observation
        bases = []
        for plain, part in zip(self._plain[command][name], stretches(o.bins, o.width), strict=True):
            formula = [modulated(trace[part], FORMULA, o.width) for trace in traces.get(name, ())]
            bases.append([plain, *formula])
        return bases

    def _channel(
        self,
        key: tuple[int, str],
        trials: Sequence[tuple[int, int]],
        at: Places,
        whitened: Mapping[int, tuple[Places, Array]],
        white: Sequence[Array],
        traces: Mapping[str, list[Array]],
    ) -> list[ChannelPart]:
        """Return the parts of a channel by stretch; `key`: command and name, `trials`: as `places_of`."""
        command, name = key
        o = self.trials[trials[0][0]].observation
        parts = []
        bases = self._bases(traces, command, name)
        for number, part in enumerate(stretches(o.bins, o.width)):
            plain, *formula = bases[number]
            kind = np.concatenate([b.kind for b in bases[number]])
            gram, basis = np.zeros((at.size, at.size)), np.zeros((kind.size, kind.size))
            across = np.zeros((kind.size, at.size))
            rows = []
            cache: dict[Filter, tuple[Array, Array]] = {}  # repetitions share it
            for i, k in trials:
                first, whiten = self.rows[i][name].start, self.whiteners[i][k].filters[number]
                bins = slice(first + part.start, first + part.stop)
                if whiten not in cache:
                    cache[whiten] = self._white_basis((command, name, whiten), plain, formula)
                B, BB = cache[whiten]
                place = np.searchsorted(at, whitened[i][0])
                A, w = whitened[i][1][bins], white[i][bins]
                full = np.column_stack([A, w])
                places = np.append(place, at.size - 1)
                gram[np.ix_(places, places)] += full.T @ full
                basis += BB
                across[:, places] += B.T @ full
                rows.append(Rows(i, bins, place, A, B))
            parts.append(ChannelPart(name, kind, tuple(rows), gram, basis, across))
        return parts

    def _white_basis(
        self, key: tuple[int, str, Filter], plain: Basis, formula: Sequence[Basis]
    ) -> tuple[Array, Array]:
        """Return the (n, m) whitened discrepancy of a channel, and its (m, m) inner products.

        Args:
            key: command, channel and filter; they tell what is known already.
            plain: discrepancy without the errors of formulas.
            formula: those of each effect.
        """
        whiten = key[-1]
        if key not in self._white_plain:
            white = whiten(plain.columns)
            self._white_plain[key] = white, white.T @ white
        B, BB = self._white_plain[key]
        if not formula:
            return B, BB
        F = whiten(np.hstack([f.columns for f in formula]))
        across = B.T @ F
        return np.hstack([B, F]), np.block([[BB, across], [across.T, F.T @ F]])

    def columns(
        self, i: int, point: Point, derivatives: Derivatives, further: Further | None = None
    ) -> Array:
        """Return the (C n, k) derivatives of what a trial should show.

        Args:
            i: the trial.
            point: where.
            derivatives: there.
            further: changes whose columns come last.

        Returns:
            by the trial's own parameters, the shared ones, the further ones.
        """
        t, x, number = self.trials[i], point.trials[i], self.input_of[i]
        changes = derivatives.per_trial[i] if derivatives.per_trial else derivatives.changes[number]
        local, sensors, others = t.columns(changes, x, point.sensors)
        first, count = len(SIMULATED) - SAND_PER_TRIAL, derivatives.private
        rest, private, common = np.split(others, [first, first + count], axis=1)
        more = [t.effect_columns(further.changes[number], x, point.sensors)] if further else []
        return np.column_stack([local, private, local[:, :SAND_PER_TRIAL], rest, sensors, common, *more])
