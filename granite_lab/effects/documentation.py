"""`docs/effects.md`, written from the texts and parameters of the effects."""

from __future__ import annotations

from collections.abc import Sequence

from granite_lab.effects.library import library
from granite_lab.model.effect import Effect, EffectParameter

AREAS = {
    "Soil": (
        "bulldozing", "slip_sinkage", "multi_pass", "rate_dependent_soil", "tread_ripple",
        "contact_angle_lag", "contact_angle_actual_speed", "sand_throw",
    ),
    "Tyre": ("tyre_windup", "radial_tyre_compliance"),
    "Drive": ("drivetrain_friction", "gear_backlash", "supply_sag", "torque_constant_error"),
    "Vehicle": (
        "drive_reaction", "com_offset", "payload_mass", "ground_slope", "rolling_drag",
        "wheel_eccentricity",
    ),
    "Sensors": (
        "imu_tilt", "clock_offset", "wheel_radius_error", "encoder_eccentricity", "accel_scale_error",
    ),
}  # fmt: skip
"""The order of the page; an effect that is not named here comes last, under "Further"."""

HEAD = """\
# Effects

An effect is a physical cause that the paper's model leaves out. Each one is a module in
`granite_lab/effects/`. With neutral parameter values the model equals the paper's. Symbols and
equation numbers are those of the paper.

`granite-lab effects show ID` prints the description of an effect and draws how it changes the sensor
readings in the four variants. The picture is `reports/effects/ID.png`; `--picture FILE` names another
PNG or SVG file and `--no-picture` prints the text only.

- Orange: the change with all other parameters fixed.
- Blue: what remains after sand, start time and sensor errors are refitted, as in every search. Where blue
  is flat, sand or a sensor error can imitate the effect.

Columns of the tables:

- *neutral*: the value at which the effect vanishes.
- *bounds*: the physical limits.
- *expected*: the range given by the source.
- *shape*: the parameter has no influence while the other parameters are neutral.
- *per trial*: the parameter has a new value in each trial. A cosine and a sine part describe one amplitude,
  the same in all trials, and a phase that changes.

This page is written by `python -m granite_lab.effects.documentation`.
"""

NEXT = """\
## Planning the next trial

`granite-lab plan-next DIR` proposes the next trial. DIR is a folder written by `discover` or `study`. The
command reads the file `design.json` in it (trials, noise, fitted sand) and no log. It treats the first open
question of this list:

1. Twins: which of the effects that cannot be told apart is present?
2. A verdict that is provisional or *unknown*: which of the three likeliest candidates is present?
3. Otherwise: the parameter with the largest relative standard deviation that a trial can lower.

Each proposed trial is simulated with every competing explanation, and all other parameters are refitted. The
result is an expected log Bayes factor or an expected standard deviation. A trial is worth driving if the log
Bayes factor grows by 3 (20 to 1) or the standard deviation falls by a fifth.

Proposals are commands within `--room` and `--max-speed`, repetitions, and conditions. A log states its
conditions in its header, and `discover` simulates them:

| line | meaning | simulated as |
|---|---|---|
| `# payload_kg = 5` | mass at the centre of mass | added to m_0 |
| `# turned = true` | robot turned round, same ground | `ground_slope` with opposite sign |
| `# slope_deg = 3` | ground raised, uphill positive | added to `ground_slope` |
| `# same_rut = true` | second pass in the same rut | with `multi_pass`, all wheels in compacted sand |
| `# wheels_up = true` | robot on a level block | no ground forces |

Driving backward, turning and loads away from the centre of mass are not simulated.

"""

HOOKS = """\
## Hooks of an effect

An effect of your own is a Python file, given with `--effects my_effect.py`; [how to add an
effect](how-to-effect.md) contains a complete one. The file is executed with your rights: use only code you
trust.

A hook is a method of `granite_lab.model.effect.Effect`. It receives a quantity as a CasADi expression and
returns the changed quantity:

| hook | changes |
|---|---|
| `system` | parameters of the whole model |
| `desired_velocity` | velocity that determines k_92 |
| `wheel` | motion of a wheel relative to the soil |
| `soil` | soil under a wheel |
| `contact_angles` | ends of the contact arc |
| `pressure` | pressure at one point of the contact arc |
| `wheel_forces` | forces and moment of the ground on a wheel |
| `drive_torque`, `rim_load` | torques on a rim |
| `rim_acceleration` | angular acceleration of a rim |
| `shaft` | motion of a motor's shaft (back-EMF, encoder) |
| `reading` | encoder reading of that motion (controller, log) |
| `voltages` | voltages of the motors |
| `body_load` | forces and moment on the body, and gravity |
| `sensors` | sensor readings |
| `delays` | delays of the sensors' time stamps |
| `rates` | time derivatives of the effect's own states, named in `states` |

`own.p` holds the parameters of the effect, `own.x` its states, `own.t` the time and `own.model` the
parameters of robot and soil. Use functions of CasADi (`ca.tanh`, `ca.fmax`), not of NumPy, and smooth
formulas instead of jumps.
"""


def markdown() -> str:
    """Return the page."""
    known = library()
    named = [name for names in AREAS.values() for name in names]
    areas = AREAS | {"Further": tuple(name for name in known if name not in named)}
    parts = [HEAD]
    for area, names in areas.items():
        if names:
            parts.append(f"## {area}\n")
            parts += [_section(known[name]) for name in names]
    return "\n".join([*parts, NEXT + HOOKS])


def _section(effect: Effect) -> str:
    pairs = {name for pair in effect.circles for name in pair}
    alike = [p for p in effect.parameters if p.name in pairs]
    rows = [_row([p]) for p in effect.parameters if p.name not in pairs]
    rows += [_row(alike)] if alike else []
    return (
        f"### `{effect.id}`: {effect.title}\n\n"
        f"{effect.signature}\n\n"
        f"- Equation: {effect.equation}\n"
        f"- Source: {effect.source}\n\n"
        "| parameter | unit | meaning | neutral | bounds | expected |\n|---|---|---|---|---|---|\n"
        + "\n".join(rows)
        + "\n"
    )


def _row(alike: Sequence[EffectParameter]) -> str:
    """Return one row; cosine and sine parts of all wheels share it."""
    p = alike[0]
    kind = ", ".join(word for word, yes in (("shape", p.shape), ("per trial", p.per_trial)) if yes)
    meaning = f"{p.meaning} ({kind})" if kind else p.meaning
    if len(alike) > 1:
        meaning = meaning.replace("cosine part", "cosine and sine parts").replace("front", "front and rear")
    neutral = f"any (start {p.neutral:g})" if p.shape else f"{p.neutral:g}"
    names = ", ".join(f"`{q.name}`" for q in alike)
    return (
        f"| {names} | {p.unit or '-'} | {meaning} | {neutral} | {p.low:g} to {p.high:g} | "
        f"{p.prior_low:g} to {p.prior_high:g} |"
    )


if __name__ == "__main__":
    from pathlib import Path

    from granite_lab.files import write_text

    write_text(Path(__file__).parents[2] / "docs" / "effects.md", markdown())
