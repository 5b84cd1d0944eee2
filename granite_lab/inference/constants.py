"""Numbers set by hand, each with its reason, and what follows from them.

Everything else is measured, learnt or taken from a file. Two standard deviations count as certain throughout.
"""

from __future__ import annotations

import math
import sys
from statistics import NormalDist

TINY = sys.float_info.min
"""Keeps a division by zero finite."""

NEAR_ZERO = 1e-3
"""Share below which a size counts as none, as a thousandth of a range; convention."""

UNOBSERVABLE = 1e-5
"""Share of the robot's weight, or of a prior's std, that no sensor shows. The largest trace, that of a wrong
wheel radius, is some 10,000 times the noise."""

NEGLIGIBLE = 0.1
"""Share of a std, or of what a prior leaves open, that makes no difference: an error of that size beside one
of a whole std widens it by half a percent."""

THREE_SIGMA = 3.0
"""Standard deviations within which a normal number lies in all practice (99.7 %); convention."""

UPDATES = 8
"""Most steps of iterations that need not converge: those of the scales at each step of a fit, and of the
first fit, whose noise is not known yet; convention."""

TRIED, FEW = 3, 2
"""Number of alternatives that are tried, the most promising first: three where each may be the best, two
where one rival is enough. Convention; their ranking of first order is wrong by one or two places."""

FEWEST_SPEEDS = 3
"""Speeds from which on a law in speed is tested: it has one number more than a line."""

TOLERANCE = 0.02
"""Discrepancy that does not matter, as a share of a channel's rms in motion; the option `--tolerance`.

Repeated single-wheel runs on prepared sand agree within 2 to 5 % of drawbar pull and torque (the runs of
the K10-mini wheel at CMU: 2 % median), so that a smaller gap cannot be assigned to the model."""

LATENCY_LIMIT = 0.02
"""Largest delay between the stamps of two sensors that passes for latency [s]; the option `--latency`.

Filters, integration, transport and stamping on arrival cause 1 to 20 ms (Furgale et al. 2013; Rehder et al.
2016)."""

LATENCY_STD = 0.03
"""Std of the latency before a trial was seen [s]: loggers reach 20 ms, clocks that were never set together
more. The trials determine it within a millisecond."""

CURRENT_LATENCY_STD = LATENCY_LIMIT / 2
"""Std of the latency of the motor currents behind the encoders, which share a clock [s]: controllers poll
and filter them."""

LEAD_STD = (0.05, 0.2)
"""Std of the times by which a command that is not stated leads its wheels [s], as `model.leading.LEADS`.

Motor controllers of mobile robots close loops on the speed at 2 to 10 Hz: wheels follow 16 to 80 ms late.
Loops on the angle have gains of 3 to 20 per second: it follows 50 to 300 ms late."""

LOW_PASS = 10.0
"""Lowest cut-off of an IMU's own low-pass [Hz]; loggers set 10 to 50 Hz."""

LOW_PASS_STD = 1 / (2 * math.pi * LOW_PASS) ** 2
"""Std of the variance of the impulse response of the IMU's low-pass [s^2]: that of a first order at
`LOW_PASS`; a second order, or a mean over samples, of the same variance shows the same."""

SMOOTH = (0.1, 0.5)
"""Time over which the discrepancy of the model is smooth [s]: the pitch and slip transients of the robot last
0.1 s, its way to steady slip 0.35 s."""

BIN = 0.02
"""Width of a bin [s], where the sensors are fast enough: a fifth of the fastest of them."""

LINEAR = 0.03
"""Relative change within which the model is linear, and large beside the integrator's errors; measured."""

REST_SPEED = 0.03
"""Speed below which the model's laws are not defined [m/s]: (1) is 0/0 at rest, (11) is made for shear that
goes on; continuations of both differ below 2 to 3 cm/s."""

FORMULA_ERROR = (0.1, 0.3)
"""Median and largest error of an effect's formula, as a share of its own trace: semi-empirical terramechanics
predicts forces within 10 to 30 % where its parameters are known (Ding et al. 2011; Wong 2008)."""

LEAST_SHARE = FORMULA_ERROR[0]
"""Share of the gap that an effect must close to be named. One that closes less than formulas are usually off
by is listed as small."""

OUTLIER = 1 / LEAST_SHARE
"""Ratio to the median trial above which the residuals of a trial, or its own numbers, show that the model
does not apply to it: another command, a wheel off the ground, another robot."""

REST_SHARE = FORMULA_ERROR[1]
"""Std of the discrepancy near rest, as a share of a channel's rms in motion: there a law of the model is no
better than the roughest formula."""

MAX_REMAINDER = FORMULA_ERROR[1]
"""Share that the errors of all formulas of a set may leave of what its effects explain, as an rms."""

RELEVANT = FORMULA_ERROR[1]
"""Share by which the gap must grow without an effect, as an rms, for it to be named beside the others: errors
of their formulas make no more."""

SUBSTITUTE = FORMULA_ERROR[1]
"""Share of the gap of a cause that an effect leaves if it only resembles the cause."""

RIVAL = FORMULA_ERROR[1]
"""Share of the best candidate's gain that a rival must promise to be fitted. Gains are linear about another
fit; full fits have changed the order of candidates by factors of up to two."""

POOR_FIT = 1 + FORMULA_ERROR[1]
"""Factor of the noise above which a fit is bad: its residuals are neither smooth nor noise."""

SAME = math.sqrt(1 - FORMULA_ERROR[1] ** 2)
"""Cosine above which two signatures count as one: they differ by no more than an error of their formulas."""

PSEUDO_TRIALS = 4.0
"""Weight of a scale's first value, counted in trials; convention: those of Table 2, once each."""

_MODULUS, _ANGLE = 0.20, 0.12
SAND_STD = (_MODULUS, _MODULUS, _MODULUS, _MODULUS, _ANGLE, _ANGLE, _MODULUS)
"""Std of the logarithm of a_θ, k_φ, c, K, φ, n and μ_s about the soil's file. Dry sands of the literature
differ by 10 to 20 % in moduli and by 2 to 4° in the angle of friction (Wong 2008, table 2.3)."""

SAND_PER_TRIAL_STD = (0.05, 0.08, 0.08)
"""First value of the std of the logarithm of a_θ, k_φ and c from one raking to the next: cone indices of
prepared sand scatter by 5 to 10 %."""

_BY_HAND = 0.01
SENSOR_STD = {
    "tilt": _BY_HAND,
    "wheel offset": 0.02,
    "wheel gain": 0.002,
    "wheel_split gain": 0.003,
    "start": LATENCY_LIMIT,
    "arm": _BY_HAND,
}
"""First value of the std of what the robot's file leaves open: mounting tilt [rad], angle of the wheels at
rest [rad], their radius [-] and its difference between the axles [-], start of the command [s], place of the
IMU [m]. By hand a sensor is mounted to a centimetre, and as straight over a metre. A command is stamped as
late as a sensor."""

MEMORY = 4e8
"""Bytes that one table may take: a fifth of the 2 GB that a search may. Half of it may be held of fits, an
eighth of simulations."""

DRAWS = 4000
"""Random draws of a probability; they determine one of 0.9 to 0.005."""

EFFECT_ODDS = 0.05
"""Prior odds of one more effect in the model: of some 20 candidates about one is expected."""

LEAST_GAIN = -math.log(EFFECT_ODDS)
"""Gain of log likelihood that makes up for those odds: a candidate that promises less is not fitted."""

CREDIBLE = 0.9
"""Posterior probability that a name, or a set that cannot be told apart, must hold; convention."""

CERTAIN = 2 * NormalDist().cdf(2) - 1
"""The same of a name that explains no more than errors of other formulas at their limit could: as sure as
that a value lies within two standard deviations."""
