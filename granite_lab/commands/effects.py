"""`granite-lab effects`: the physical effects that can be added to the paper's model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.commands.common import EffectsOption, JsonOption, console, print_json

if TYPE_CHECKING:
    from granite_lab.model.effect import Effect

app = typer.Typer(
    help="The physical effects that can be added to the paper's model.", invoke_without_command=True
)


def register(parent: typer.Typer) -> None:
    """Add the commands to the app."""
    parent.add_typer(app, name="effects")


def _ids(incomplete: str) -> list[str]:
    from granite_lab.effects import library

    return [name for name in library() if name.startswith(incomplete)]


@app.callback(invoke_without_command=True)
def listing(
    context: typer.Context,
    effects: EffectsOption = None,
    as_json: JsonOption = False,
) -> None:
    """List the effects."""
    if context.invoked_subcommand is not None:
        return
    from granite_lab.effects import library, load_effects
    from granite_lab.reporting.terminal import show_effects

    known = library() | (load_effects(effects) if effects else {})
    if as_json:
        print_json({"schema": "granite-lab/effects/1", "effects": [describe(e) for e in known.values()]})
    else:
        show_effects(list(known.values()), console())


@app.command("show")
def show(
    effect_id: Annotated[str, typer.Argument(metavar="ID", autocompletion=_ids)],
    effects: EffectsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Explain one effect: equation, source, parameters and what an observer sees."""
    from granite_lab.effects import get, load_effects
    from granite_lab.reporting.terminal import show_effect

    own = load_effects(effects) if effects else {}
    effect = own.get(effect_id) or get(effect_id)
    if as_json:
        print_json({"schema": "granite-lab/effect/1"} | describe(effect))
    else:
        show_effect(effect, console())


def describe(effect: Effect) -> dict[str, Any]:
    """Return an effect as it stands in JSON."""
    return {
        "id": effect.id,
        "title": effect.title,
        "equation": effect.equation,
        "source": effect.source,
        "signature": effect.signature,
        "parameters": effect.parameters,
    }
