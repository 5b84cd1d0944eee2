"""Under which conditions a trial is driven: payload, direction, slope, rut, wheels off the ground."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from granite_lab.effects.library import get
from granite_lab.effects.multi_pass import MultiPass
from granite_lab.errors import InputError
from granite_lab.inference.nuisances import TrialModel
from granite_lab.inference.pool import Scenario, Task
from granite_lab.logs.trial import Array, Trial
from granite_lab.model.body import BodyLoad, BodyState
from granite_lab.model.contact import ContactAngles, WheelForces, WheelState
from granite_lab.model.effect import Axle, Effect, Symbols
from granite_lab.model.symbols import ModelParameters
from granite_lab.parameters import Soil
from granite_lab.parameters.quantity import key_of, quantity


@dataclass(frozen=True, order=True)
class Conditions:
    """What differs from a plain trial on raked, level sand.

    Attributes:
        payload: mass that is put on the robot, at its centre of mass [kg].
        turned: the robot is turned round and drives the other way over the same ground.
        slope: by which the ground is raised in the direction of travel on purpose [deg].
        same_rut: driven again in the rut of a trial before, without raking.
        wheels_up: the robot stands on a block and its wheels turn in the air.
    """

    payload: float = quantity("kg", 0, 1e4, "mass on the robot", default=0.0)
    turned: bool = False
    slope: float = quantity("deg", -45, 45, "by which the ground is raised", default=0.0)
    same_rut: bool = False
    wheels_up: bool = False

    @property
    def words(self) -> str:
        """The conditions for people; empty for a plain trial."""
        parts = []
        if self.turned:
            parts.append("robot turned round")
        if self.payload:
            parts.append(f"{self.payload:g} kg on top")
        if self.slope:
            parts.append(f"ground raised by {abs(self.slope):g}°, {'up' if self.slope > 0 else 'down'}hill")
        if self.same_rut:
            parts.append("again in the same rut")
        if self.wheels_up:
            parts.append("wheels in the air")
        return ", ".join(parts)

    @property
    def lines(self) -> tuple[str, ...]:
        """What the log of such a trial must say of itself."""
        values = {key: getattr(self, name) for key, name in KEYS.items()}
        return tuple(
            f"# {key} = {'true' if value is True else f'{value:g}'}" for key, value in values.items() if value
        )


PLAIN = Conditions()

KEYS = {key_of(f): f.name for f in dataclasses.fields(Conditions)}
"""Key of a log's own metadata to the field of `Conditions`."""


def conditions_of(trial: Trial) -> Conditions:
    """Return the conditions that a log tells of.

    Raises:
        InputError: a value is neither true or false nor a number.
    """
    stated: dict[str, Any] = {}
    for key, name in KEYS.items():
        text = trial.info.extra.get(key, "").strip().lower()
        if not text:
            continue
        try:
            number = name in ("payload", "slope")
            stated[name] = float(text) if number else {"true": True, "false": False}[text]
        except (ValueError, KeyError):
            raise InputError(
                f"trial '{trial.name}': {key} = {text} cannot be used",
                f"write a number, as in # {key} = 5" if number else f"write # {key} = true",
            ) from None
    return Conditions(**stated)


class OnABlock(Effect):
    """The body is held and the wheels touch nothing; stands last, so that it has the last word."""

    id = "on_a_block"
    title = "robot on a block, wheels in the air"
    equation = "F = 0, M_ω = 0 for each wheel; body at rest"
    source = "a common check of drives"
    signature = "the drives alone"
    parameters = ()

    def wheel_forces(
        self,
        forces: WheelForces,
        state: WheelState,  # noqa: ARG002
        angles: ContactAngles,  # noqa: ARG002
        soil: Soil,  # noqa: ARG002
        sym: Symbols,  # noqa: ARG002
    ) -> WheelForces:
        """Take the ground away."""
        return dataclasses.replace(
            forces, vertical=0.0, resistance=0.0, thrust=0.0, moment=0.0, normal=0.0, extra=0.0
        )

    def body_load(
        self,
        load: BodyLoad,
        body: BodyState,  # noqa: ARG002
        axles: tuple[Axle, Axle],  # noqa: ARG002
        p: ModelParameters,
        sym: Symbols,  # noqa: ARG002
    ) -> BodyLoad:
        """Hold the body."""
        m: Any = p.chassis.total_mass
        return dataclasses.replace(load, x=-m * load.gravity_x, z=-m * load.gravity_z, moment=0.0)


class InTheRut(MultiPass):
    """All wheels run where wheels have been, from the start."""

    id = "in_the_rut"

    def wheel(self, state: WheelState, sym: Symbols) -> WheelState:  # noqa: ARG002
        """Leave the wheels as they stand: all are equally deep."""
        return state

    def soil(self, soil: Soil, state: WheelState, sym: Symbols) -> Soil:
        """Stiffen the soil under every wheel."""
        behind = 2 * sym.model.chassis.wheel_base  # of travel: no wheel is at the edge of the rut
        return super().soil(soil, dataclasses.replace(state, front=False, travel=behind), sym)


STAGING: dict[str, Effect] = {e.id: e for e in (OnABlock(), InTheRut())}
"""Effects that stand for conditions."""


@dataclass(frozen=True)
class StagedScenario(Scenario):
    """A scenario in which each command is driven under conditions of its own.

    A slope of the ground changes sign for a robot that is turned round; every other effect of the
    library belongs to the robot or does not know directions. In the rut of a trial before, all four
    wheels meet the sand as `multi_pass` has it behind the front wheels, and a further pass compacts
    it no more; without that effect a rut changes nothing.

    Attributes:
        conditions: of each command.
    """

    conditions: tuple[Conditions, ...] = ()

    def respond(self, task: Task) -> Array | None:
        """Return the (8, M) signals of a run; None where it has no solution."""
        under = self.conditions[task.variant]
        robot, soil, setting = self.robot, self.soil, dict(task.setting)
        if under.payload and robot.chassis is not None:
            chassis = dataclasses.replace(robot.chassis, body_mass=robot.chassis.body_mass + under.payload)
            robot = dataclasses.replace(robot, chassis=chassis)
        if under.slope or (under.turned and "ground_slope" in setting):
            slope = setting.get("ground_slope", (0.0,))[0]
            setting["ground_slope"] = (under.slope + (-slope if under.turned else slope),)
        if under.same_rut and "multi_pass" in setting:
            setting[InTheRut.id] = setting.pop("multi_pass")
        if under.wheels_up:  # on a level block
            setting.pop("ground_slope", None)
            setting[OnABlock.id] = ()
        plain = Scenario(robot, soil, self.variants, self.effects)
        return plain.respond(dataclasses.replace(task, setting=tuple(setting.items())))


def under_conditions(scenario: Scenario, trials: Sequence[Trial], models: Sequence[TrialModel]) -> Scenario:
    """Return a scenario that simulates each trial under its conditions; a plain one for plain trials.

    Args:
        scenario: of the trials without conditions.
        trials: the logs.
        models: of the logs, in their order; what drives them and their commands are numbered anew where
            conditions differ.

    Raises:
        InputError: a log's conditions cannot be used.
    """
    under = [conditions_of(trial) for trial in trials]
    if all(c == PLAIN for c in under):
        return scenario
    pairs = sorted({(m.variant, c) for m, c in zip(models, under, strict=True)})
    commands = sorted({(m.command, c) for m, c in zip(models, under, strict=True)})
    for model, conditions in zip(models, under, strict=True):
        model.variant = pairs.index((model.variant, conditions))
        model.command = commands.index((model.command, conditions))
    return StagedScenario(
        scenario.robot,
        scenario.soil,
        tuple(scenario.variants[variant] for variant, _ in pairs),
        {**scenario.effects, **STAGING, "ground_slope": get("ground_slope")},
        conditions=tuple(conditions for _, conditions in pairs),
    )
