"""`docs/effects.md`, written from what the effects say of themselves."""

from __future__ import annotations

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

EXAMPLE = '''\
"""A wind that blows against the robot."""

from dataclasses import replace

from granite_lab.model.effect import Effect, EffectParameter


class HeadWind(Effect):
    """A constant force on the body, at the height of the centre of mass."""

    id = "head_wind"
    title = "wind against the robot"
    equation = "m a_x = (20) - force"
    source = "a fan in front of the sand box"
    signature = "more slip and current at every speed, and a small creep at rest"
    parameters = (
        # name, unit, meaning, low, high, neutral, expected from, expected to
        EffectParameter("force", "N", "force of the wind", -50.0, 50.0, 0.0, 1.0, 10.0),
    )

    def body_load(self, load, body, axles, p, own):
        return replace(load, x=load.x - own.p["force"])
'''

HEAD = """\
# Effects

What the paper's model leaves out and a trial may show. Each effect is one module of
`granite_lab/effects/`; with its parameters at the neutral value the model is the paper's, to the
last digit. Symbols are the paper's, numbers in brackets its equations.

`granite-lab effects show ID` explains one effect and draws its signature at a typical size: what the
IMU, the wheels and the currents read more or less with it, in each of the four variants. The picture
is `reports/effects/ID.png`, or the PNG or SVG file named with `--picture`; `--no-picture` prints the
text alone. Orange is the change with all else equal. Blue is what is left of it once the sand, the
start of the command and the sensors' offsets, gains and tilt are fitted anew, as they are in every
search: where blue is flat, sand or a sensor can imitate the effect, and only the blue can name it.

*Neutral* is the value at which an effect vanishes, *bounds* are what it can physically be, and
*expected* is the range that the source leads to expect. A *shape* parameter says how, not how
much: it matters only once another parameter is away from neutral. A parameter *per trial* changes
from trial to trial; where two of them are cosine and sine, only the phase may, and a search drops a
candidate that would need another size in each trial. This page is written by
`python -m granite_lab.effects.documentation`.
"""

OWN = """\
## An effect of your own

Write a Python file like this one and give it with `--effects my_effect.py`. It is a candidate like
all others then. The file is run with your rights: use only code you trust.

```python
{example}```

The hooks are the methods of `granite_lab.model.effect.Effect`; each gets a quantity as a CasADi
expression and returns it rewritten:

| hook | rewrites |
|---|---|
| `system` | the parameters of the whole model |
| `desired_velocity` | the velocity that k_92 follows |
| `wheel` | the motion of a wheel as the soil meets it |
| `soil` | the soil under a wheel |
| `contact_angles` | the ends of the contact arc |
| `pressure` | the pressure at one place of the contact arc |
| `wheel_forces` | forces and moment of the ground on a wheel |
| `drive_torque`, `rim_load` | the torques on a rim |
| `rim_acceleration` | how fast a rim's turning grows |
| `shaft` | the motion of a motor's shaft, which back-EMF and encoder follow |
| `reading` | what the encoder makes of it, which controller and log follow |
| `voltages` | the voltages of the motors |
| `body_load` | forces and moment on the body, and gravity |
| `sensors` | what the sensors read |
| `delays` | by how much the stamps of sensors lag |
| `rates` | the time derivatives of the effect's own states, named in `states` |

`own.p` holds the effect's parameters, `own.x` its states, `own.t` the time and `own.model` the
robot's and the soil's parameters. Use CasADi's functions (`ca.tanh`, `ca.fmax`) in place of NumPy's,
and smooth formulas in place of jumps. When the file is loaded, the neutral values are checked
against the paper's model; an error in it is reported with file and line.
"""


NEXT = """\
## Telling effects apart: the next trial

Some effects look alike on the trials at hand, and some are too weak to be shown. `granite-lab
plan-next DIR`, with the folder that `granite-lab discover … --out DIR` wrote, says which trial would
help most. It reads `finding.json` for what is open and `design.json` for the trials, their noise and
the fitted sand, then simulates each proposed trial with every explanation that is left. Sand, start,
offsets and the rivals' own numbers are refitted over the old trials and the new one; what one
explanation cannot imitate of the other is the χ² by which the false one would lose.

- *told apart*: the chance that the false explanation is ruled out, mean over which one is true. It is
  ruled out when its χ² is worse by 9 (and by 0.4 % of what the effect explains, since no formula is
  exact), the rule of `discover` itself.
- *evidence*: the expected χ² by which the false one loses, beyond what the trials at hand give. It is
  twice the logarithm of the evidence. Of several pairs the least counts.
- Where nothing was named, the three candidates with most evidence are taken at a size that would just
  be missed, and *shown* is the chance that one of them clears the threshold after the trial. Where one
  effect stands alone, the table gives the std of its strength after the trial.

Proposed are commands (speed, acceleration, distance within `--room` and `--max-speed`), repetitions,
and conditions. A log says its conditions itself, in lines of its head, and `discover` simulates it
accordingly:

| line | meaning | how it is simulated |
|---|---|---|
| `# payload_kg = 5` | mass on top, at the centre of mass | added to m_0 |
| `# turned = true` | robot turned round, same ground | `ground_slope` changes its sign; all else stays |
| `# slope_deg = 3` | ground raised on purpose, uphill positive | added to `ground_slope` |
| `# same_rut = true` | second pass in the same rut | with `multi_pass`, all wheels in compacted sand |
| `# wheels_up = true` | robot on a level block | no ground: drives, encoders and currents alone |

Driving backwards is left out, since (26) drives forward only; so are loads off the centre of mass and
turns, since the model is planar. A second pass is taken to compact no further, and a rut to change
nothing unless `multi_pass` is among the explanations.

How often each candidate would be named on the trials at hand, and what it would be taken for, comes
from the same signatures: the scores are normal numbers whose mean is the signature and whose covariance
are the inner products of all signatures with the nuisances projected out, so that thousands of sets can
be drawn without a simulation. Full fits can do a little better or worse than this: they also move the
shape parameters.

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
    return "\n".join([*parts, NEXT + OWN.format(example=EXAMPLE)])


def _section(effect: Effect) -> str:
    rows = "\n".join(_row(p) for p in effect.parameters)
    return (
        f"### `{effect.id}`: {effect.title}\n\n"
        f"- Equation: {effect.equation}\n"
        f"- What one sees: {effect.signature}\n"
        f"- Source: {effect.source}\n\n"
        "| parameter | unit | meaning | neutral | bounds | expected |\n|---|---|---|---|---|---|\n"
        f"{rows}\n"
    )


def _row(p: EffectParameter) -> str:
    kind = ", ".join(word for word, yes in (("shape", p.shape), ("per trial", p.per_trial)) if yes)
    meaning = f"{p.meaning} ({kind})" if kind else p.meaning
    neutral = f"any, {p.neutral:g} to start" if p.shape else f"{p.neutral:g}"
    return (
        f"| `{p.name}` | {p.unit or '-'} | {meaning} | {neutral} | {p.low:g} to {p.high:g} | "
        f"{p.prior_low:g} to {p.prior_high:g} |"
    )


if __name__ == "__main__":
    from pathlib import Path

    from granite_lab.files import write_text

    write_text(Path(__file__).parents[2] / "docs" / "effects.md", markdown())
