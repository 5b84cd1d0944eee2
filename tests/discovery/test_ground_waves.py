"""What repeats with the place of the robot is found; resonances and what turns with the wheels are not."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from granite_lab.discovery import ground_waves
from granite_lab.discovery.ground_waves import ground_wave
from granite_lab.discovery.lines import table_of_gains
from granite_lab.estimate import Estimate
from granite_lab.inference.fit import fit
from tests.inference.stub import COMMANDS, ROBOT, WIDTH, drawn, measure, moving, problem_of

SLIP = (0.03, 0.12, 0.25)
"""At the three speeds, as Table 3 of the paper has it."""


@cache
def fitted(seed, commands):
    """Return trials in which the model lacks nothing, their fit, and the source of more chance."""
    rng, problem = np.random.default_rng(seed), problem_of(commands)
    measure(problem, drawn(problem, rng, common=0.2, own=0.2), rng)
    return problem, fit(problem, problem.neutral())


def found(shape, slips=SLIP, seed=0, tolerance=0.02, commands=(0, 0, 1, 1, 2, 2)):
    """Return the wave of trials whose fit leaves `shape` by place, turns and time in the pitch rate, too."""
    rng, (problem, known) = np.random.default_rng(seed), fitted(seed, commands)
    motions, residuals = [], [row.copy() for row in known.residuals]
    for trial, command, residual in zip(problem.trials, commands, residuals, strict=True):
        o = trial.observation
        t = np.linspace(o.edges[0], o.edges[-1], 4000)
        v = o.variant.velocity * moving(t - o.t_start, o.variant)
        x = cumulative_trapezoid(v, t, initial=0.0)
        rolled = v / (1 - slips[command])
        turns = cumulative_trapezoid(rolled, t, initial=0.0) / (2 * np.pi * ROBOT.wheels.radius)
        motions.append(
            SimpleNamespace(
                trial=o.name, t=t, x=x, v_wheel=np.column_stack([rolled] * 4),
                distance=Estimate(float(x[-1]), 0.001 * float(x[-1])),
            )
        )  # fmt: skip
        at = (o.edges[1:] + o.edges[:-1]) / 2
        wave = shape(np.interp(at, t, x), np.interp(at, t, turns), at - o.t_start, rng.uniform(0, 2 * np.pi))
        size = np.interp(at - o.t_start, t - o.t_start, v) / o.variant.velocity
        residual[trial.channels.index("pitch_rate")] += 0.03 * size * wave
    return ground_wave(problem, replace(known, residuals=residuals), motions, tolerance)


def by_place(length):
    return lambda x, _turns, _t, phase: np.cos(2 * np.pi * x / length + phase)


@pytest.mark.parametrize("length", [0.1, 0.13])
def test_a_wave_of_the_ground_is_found_with_its_wavelength(length):
    wave = found(by_place(length))
    assert wave is not None
    assert wave.channel == "pitch_rate"
    assert abs(wave.wavelength.value - length) < 3 * wave.wavelength.std < 0.05 * length
    assert wave.amplitude == pytest.approx(0.03, rel=0.2)


def test_without_slip_a_wave_cannot_be_told_from_what_turns_with_the_wheels():
    length = 0.11
    wave = found(by_place(length), slips=(0.0, 0.0, 0.0))
    assert wave is None or wave.order == pytest.approx(2 * np.pi * ROBOT.wheels.radius / length, rel=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_noise_a_resonance_and_orders_of_the_wheels_are_no_waves(seed):
    assert found(lambda x, _turns, _t, _p: 0 * x, seed=seed) is None
    assert found(lambda _x, _turns, t, p: np.cos(2 * np.pi * 4 * t + p), seed=seed) is None
    assert found(lambda _x, turns, _t, p: np.cos(2 * np.pi * 5 * turns + p), seed=seed) is None


def test_an_order_that_the_fastest_wheels_do_not_resolve_is_no_wave_of_the_slower_ones():
    slips, turn = (0.0, 0.01, 0.25), 2 * np.pi * ROBOT.wheels.radius
    fastest = max(variant.velocity for variant in COMMANDS)
    order = round(0.85 * turn / (2 * fastest * WIDTH))  # resolved along the way, not along the turns
    assert order > (1 - slips[-1]) * turn / (2 * fastest * WIDTH)
    assert found(lambda _x, turns, _t, p: np.cos(2 * np.pi * order * turns + p), slips=slips) is None
    length = turn / order
    wave = found(by_place(length))
    assert wave is not None
    assert abs(wave.wavelength.value - length) < 3 * wave.wavelength.std < 0.05 * length


@pytest.mark.parametrize(("by_order", "is_wave"), [(300.0, False), (200.0, True)])
def test_a_wave_that_an_order_of_the_wheels_explains_better_is_none(by_order, is_wave, monkeypatch):
    def altered(problem, left, axis, numbers):
        table = table_of_gains(problem, left, axis, numbers)
        is_turns = 1.0 < max(np.ptp(x) for x in axis) < 2.0  # ways are shorter, times longer
        return table if not is_turns or numbers.dtype == int else np.full_like(table, by_order / 2)

    wave = by_place(0.1)  # gains 261 at all speeds without the strongest
    monkeypatch.setattr(ground_waves, "table_of_gains", altered)
    assert (found(wave) is not None) is is_wave


def test_one_speed_shows_no_waves_and_small_ones_do_not_matter():
    assert found(by_place(0.1), commands=(2, 2, 2)) is None
    assert found(by_place(0.1), tolerance=100.0) is None
