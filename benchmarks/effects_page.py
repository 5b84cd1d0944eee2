"""`docs/effects.md`, written from the texts and parameters of the effects."""

from __future__ import annotations

from collections.abc import Sequence

from granite_lab.effects.library import library
from granite_lab.model.effect import Effect, EffectParameter

AREAS = {
    "Soil": (
        "bulldozing", "slip_sinkage", "stress_ahead", "exit_by_sinkage", "shear_softening",
        "multi_pass", "rate_dependent_soil", "tread_ripple",
        "contact_angle_lag", "contact_angle_actual_speed", "sand_throw",
    ),
    "Tyre": ("tyre_windup", "radial_tyre_compliance"),
    "Drive": ("drivetrain_friction", "gear_backlash", "supply_sag", "torque_constant_error"),
    "Vehicle": (
        "drive_reaction", "com_offset", "payload_mass", "ground_slope", "rolling_drag",
        "wheel_eccentricity", "unequal_wheels",
    ),
    "Sensors": (
        "imu_tilt", "clock_offset", "wheel_radius_error", "encoder_eccentricity", "accel_scale_error",
    ),
}  # fmt: skip
"""The order of the page; an effect that is not named here comes last, under "Further"."""

HEAD = """\
# Effects

An effect is a physical cause that the paper's model leaves out. With all parameters at 0 the model is the
paper's. Symbols and equation numbers are those of the [paper](model.md#nomenclature). The range of a
parameter is the expected one. *Per trial*: a cosine and a sine part have the same amplitude in all trials and
another phase in each.

`granite-lab effects show ID` also prints sources, bounds and shape parameters. `granite-lab simulate` with
`--effect ID.PARAMETER=NUMBER` shows how an effect changes the sensor readings.
"""

HOOKS = """\
## Hooks of an effect

An [effect of your own](how-to-effect.md) overrides hooks: methods of `granite_lab.model.effect.Effect`
that receive a quantity as a CasADi expression and return it changed.

| hook | changes |
|---|---|
| `system` | parameters of the whole model |
| `desired_velocity` | velocity that determines k_92 |
| `wheel` | motion of a wheel relative to the soil |
| `soil` | soil under a wheel |
| `contact_angles` | ends of the contact arc |
| `bearing` | angle whose depth sets the pressure at a point of the contact arc |
| `corner` | angle at which the pressure along the arc has a corner |
| `pressure` | pressure at a point of the contact arc |
| `shear` | share of the shear strength that a shear displacement mobilises |
| `wheel_forces` | forces and moment of the ground on a wheel |
| `drive_torque`, `rim_load` | torques on a rim |
| `rim_acceleration` | angular acceleration of a rim |
| `shaft` | motion of a motor's shaft (back-EMF, encoder) |
| `reading` | encoder reading of that motion (controller, log) |
| `voltages` | voltages of the motors |
| `body_load` | forces and moment on the body, and gravity |
| `sensors` | sensor readings |
| `delays` | delays of the sensors' time stamps |
| `as_logged` | number as reported, where estimation has already scaled the accelerations |
| `rates` | time derivatives of the effect's own states, named in `states` |

`sym.p` holds the parameters of the effect, `sym.x` its states, `sym.t` the time, `sym.model` the parameters
of robot and soil. Written by `python -m benchmarks.effects_page`.
"""


def markdown() -> str:
    """Return the page."""
    effects = library()
    named = [name for names in AREAS.values() for name in names]
    areas = AREAS | {"Further": tuple(name for name in effects if name not in named)}
    parts = [HEAD]
    for area, names in areas.items():
        if names:
            parts.append(f"## {area}\n")
            parts += [_section(effects[name]) for name in names]
    return "\n".join([*parts, HOOKS])


def _section(effect: Effect) -> str:
    pairs = {name for pair in effect.circles for name in pair}
    alike = [p for p in effect.parameters if p.name in pairs]
    lines = [_line([p]) for p in effect.parameters if p.name not in pairs and not p.shape]
    lines += [_line(alike)] if alike else []
    return (
        f"### `{effect.id}`: {effect.title}\n\n"
        f"{effect.signature}\n\n"
        f"- Equation: {effect.equation}\n" + "\n".join(lines) + "\n"
    )


def _line(alike: Sequence[EffectParameter]) -> str:
    """Describe one parameter; cosine and sine parts of all wheels share a line."""
    p = alike[0]
    meaning = f"{p.meaning} (per trial)" if p.per_trial else p.meaning
    if len(alike) > 1:
        meaning = meaning.replace("cosine part", "cosine and sine parts").replace("front", "front and rear")
    names = ", ".join(f"`{q.name}`" for q in alike)
    unit = f" [{p.unit}]" if p.unit not in ("", "-") else ""
    return f"- {names}{unit}: {meaning}; {p.prior_low:g} to {p.prior_high:g}" + (
        "" if p.neutral == 0 else f", neutral {p.neutral:g}"
    )


if __name__ == "__main__":
    from pathlib import Path

    from granite_lab.files import write_text

    write_text(Path(__file__).parents[1] / "docs" / "effects.md", markdown())
