"""The picture of an effect's signature: what the sensors read more or less with it."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from granite_lab.inference.noise import NOMINAL
from granite_lab.logs.trial import Array
from granite_lab.model.command import steady_interval
from granite_lab.planning.imprint import Imprint, Seen
from granite_lab.reporting import canvas
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.rounding import significant, tidy_unit, with_unit

ROWS = (
    ("accel_x", "IMU, along", "m/s²", 1.0, 0.02),
    ("accel_z", "IMU, up", "m/s²", 1.0, 0.02),
    ("pitch_rate", "pitch rate", "°/s", 180 / np.pi, 0.2),
    ("wheel", "wheel speed", "°/s", 180 / np.pi, 0.5),
    ("current_f", "front current", "A", 1.0, 0.05),
    ("current_r", "rear current", "A", 1.0, 0.05),
)
"""Channel, its name, unit and factor, and the smallest half height of its panels in that unit."""

IN_WORDS = {
    "accel_x": "the longitudinal acceleration",
    "accel_z": "the vertical acceleration",
    "pitch_rate": "the pitch rate",
    "wheel": "the angle of the wheels",
    "wheel_split": "the difference of front and rear wheels",
    "current_f": "the front current",
    "current_r": "the rear current",
}

WHEN = {
    "rest": "at rest before the start",
    "accelerate": "while accelerating",
    "steady": "at constant speed",
    "brake": "while braking",
    "coast": "while coming to rest",
}

WINDOW = 15
"""Number of bins over which the strongest place of a signal is sought."""

WIDE, PANEL, LEFT, RIGHT, BELOW = 9.2, 1.02, 0.85, 0.12, 0.5


def effect_drawing(imprint: Imprint) -> Figure:
    """Draw one column a command and one row a channel, raw and after what else could explain it."""
    effect = imprint.active.effect
    sentence = what_to_see(imprint)
    heading = textwrap.wrap(f"{effect.title}: {sizes(imprint)}", 84)
    lines = textwrap.wrap(sentence, 132)
    below = 0.13 + 0.18 * len(heading)  # the heading
    above = below + 0.49 + 0.16 * len(lines)
    tall = above + PANEL * len(ROWS) + BELOW
    with canvas.styled():
        figure = Canvas(figsize=(WIDE, tall))
        grid = figure.add_gridspec(
            len(ROWS), len(imprint.seen), left=LEFT / WIDE, right=1 - RIGHT / WIDE, bottom=BELOW / tall,
            top=1 - above / tall, hspace=0.16, wspace=0.08,
        )  # fmt: skip
        for k, line in enumerate(heading):
            figure.text(0.12 / WIDE, 1 - (0.1 + 0.18 * k) / tall, line, va="top",
                        fontsize=10.5, weight="bold")  # fmt: skip
        for k, line in enumerate(lines):
            figure.text(0.12 / WIDE, 1 - (below + 0.16 * k) / tall, line, va="top", fontsize=9)
        for i, row in enumerate(ROWS):
            shared: Axes | None = None
            half = row[4]
            for j, seen in enumerate(imprint.seen):
                axis = figure.add_subplot(grid[i, j], sharey=shared)
                shared = shared or axis
                half = max(half, _panel(axis, seen, row[0], row[3]))
                _frame(axis, seen, row, first=j == 0, top=i == 0, bottom=i == len(ROWS) - 1)
            assert shared is not None
            shared.set_ylim(-1.12 * half, 1.12 * half)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="upper left", ncols=3, frameon=False, fontsize=8.5,
                      bbox_to_anchor=(0.06 / WIDE, 1 - (above - 0.52) / tall))  # fmt: skip
    return Figure(
        f"effect_{effect.id}", f"Signature of {effect.id}: {effect.title}", sentence,
        "Change of IMU, pitch rate, wheel speed and currents by the effect over time for each variant, "
        "all else equal and after sand and sensors are fitted anew.",
        lambda: figure,
    )  # fmt: skip


def _panel(axis: Axes, seen: Seen, channel: str, factor: float) -> float:
    """Draw one panel and return the largest value in it."""
    start, end = steady_interval(seen.observation.variant)
    axis.axvspan(start, end, color=canvas.SHADE, linewidth=0, zorder=0, label="constant speed")
    largest = 0.0
    for values, colour, weight, label in (
        (seen.raw[channel], canvas.SIMULATED_LIGHT, 1.6, "changed by the effect, all else equal"),
        (seen.left[channel], canvas.MEASURED, 1.1, "left once sand and sensors are fitted anew"),
    ):
        shown = factor * (_rate(values, seen.observation.width) if channel == "wheel" else values)
        axis.plot(seen.observation.t, shown, color=colour, linewidth=weight, label=label)
        largest = max(largest, float(np.abs(shown).max()))
    return largest


def _rate(angle: Array, width: float) -> Array:
    """Return the (n,) rate of an angle that is known at the later edge of each bin."""
    return np.asarray(np.diff(angle, prepend=angle[0]) / width)


def _frame(
    axis: Axes, seen: Seen, row: tuple[str, str, str, float, float], *, first: bool, top: bool, bottom: bool
) -> None:
    axis.set_xlim(seen.observation.t[0], seen.observation.t[-1])
    axis.axhline(0, color=canvas.INK, linewidth=0.5, zorder=1)
    if top:
        v = seen.observation.variant
        axis.set_title(f"{v.velocity:g} m/s, {v.acceleration:g} m/s², {v.distance:g} m", pad=4)
    if first:
        axis.set_ylabel(f"{row[1]}\n[{row[2]}]")
        box, figure = axis.get_position(), axis.get_figure(root=True)
        assert figure is not None
        axis.yaxis.set_label_coords(-(LEFT - 0.34) / (box.width * figure.get_size_inches()[0]), 0.5)
    else:
        axis.tick_params(labelleft=False)
    if bottom:
        axis.set_xlabel("time since start [s]")
    else:
        axis.tick_params(labelbottom=False)


def sizes(imprint: Imprint) -> str:
    """Return the parameters with units, those of one size together."""
    active = imprint.active
    named: dict[str, list[str]] = {}
    for p, value in zip(active.effect.parameters, active.values, strict=True):
        size = with_unit(significant(value, 2), tidy_unit(p.unit)).replace("\u00a0°", "°")
        named.setdefault(size, []).append(p.name.replace("_", " "))
    return ", ".join(f"{' = '.join(names)} = {size}" for size, names in named.items())


def what_to_see(imprint: Imprint) -> str:
    """Say in one sentence where the effect shows most, and how much of it nothing else imitates."""
    best: tuple[float, Seen, str, int] | None = None
    for seen in imprint.seen:
        for channel, values in seen.left.items():
            energy = np.convolve((values / NOMINAL[channel]) ** 2, np.ones(WINDOW), mode="same")
            k = int(np.argmax(energy))
            if best is None or energy[k] > best[0]:
                best = float(energy[k]), seen, channel, k
    share = 100 * imprint.share
    left = f"{share:.0f} %" if share >= 10 else f"{significant(share, 2)} %"
    if best is None or best[0] == 0:
        return "At this size the effect changes nothing that these sensors read."
    _, seen, channel, k = best
    phase = (
        "coast"
        if seen.observation.phase[k] == "rest" and seen.observation.t[k] > 0
        else seen.observation.phase[k]
    )
    return (
        f"It shows most in {IN_WORDS[channel]} {WHEN[phase]}, in the run "
        f"at {seen.observation.variant.velocity:g} m/s; "
        f"{left} of the whole change, against the sensors' noise, is left when sand, start and the sensors' "
        "offsets are fitted anew (blue)."
    )
