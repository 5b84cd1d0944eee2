"""`granite-lab effects`: the physical effects that can be added to the paper's model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.commands.common import EffectsOption, JsonOption, console, print_json
from granite_lab.errors import UsageError

if TYPE_CHECKING:
    from granite_lab.model.effect import Effect

app = typer.Typer(
    help="The physical effects that can be added to the paper's model.",
    invoke_without_command=True,
    rich_markup_mode=None,
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
    picture: Annotated[
        Path | None,
        typer.Option(
            help="PNG or SVG file for the picture of what the sensors read more or less with the effect "
            "over the four variants.",
            show_default="reports/effects/ID.png",
        ),
    ] = None,
    no_picture: Annotated[bool, typer.Option("--no-picture", help="Text only; simulates nothing.")] = False,
    effects: EffectsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Explain one effect: equation, source, parameters and what an observer sees, with a picture."""
    from granite_lab.effects import get, load_effects
    from granite_lab.reporting.terminal import show_effect

    if picture and no_picture:
        raise UsageError("--picture and --no-picture exclude each other", "give one of the two")
    if picture and picture.suffix.lower() not in (".png", ".svg"):
        raise UsageError(f"--picture {picture}: not a picture", "end the name in .png or .svg")
    own = load_effects(effects) if effects else {}
    effect = own.get(effect_id) or get(effect_id)
    if as_json:
        sentence = draw(effect, picture) if picture else None
        shown = {"picture": picture, "picture_shows": sentence} if picture else {}
        print_json({"schema": "granite-lab/effect/1"} | describe(effect) | shown)
        return
    shown_on = console()
    show_effect(effect, shown_on)
    if not no_picture:
        path = picture or Path("reports") / "effects" / f"{effect.id}.png"
        sentence = draw(effect, path)
        shown_on.print(f"picture: {path}", soft_wrap=True)
        shown_on.print(sentence, markup=False)


@app.command("check")
def check(
    effect: Annotated[
        str, typer.Argument(metavar="FILE", help="Your effect file (.py), which is run; or an id.")
    ],
    as_json: JsonOption = False,
) -> None:
    """Check that an effect keeps to what every effect must: exit code 3 if it does not."""
    from granite_lab.effects import get
    from granite_lab.effects.contract import contract, refuse_failed
    from granite_lab.effects.library import read_effects

    known = read_effects(effect) if effect.endswith(".py") or "/" in effect else {effect: get(effect)}
    found = {name: contract(one) for name, one in known.items()}
    if as_json:
        print_json({"schema": "granite-lab/effect-check/1", "effects": found})
    else:
        from granite_lab.reporting.grid import grid, row_of, say

        shown = console()
        for name, checks in found.items():
            say(shown, f"{name}: {known[name].title}", "bold")
            table = grid("", "check", "found", words=(0, 1, 2))
            for c in checks:
                mark = {True: "ok", False: "FAILED", None: "-"}[c.passed]
                table.add_row(*row_of(mark, c.name, c.detail))
            shown.print(table)
    refuse_failed(found, effect)


def draw(effect: Effect, path: Path) -> str:
    """Write the picture of an effect's signature at a typical size, and return what to see in it.

    Raises:
        EstimateError: a simulation does not converge.
    """
    import os

    from granite_lab.effects.contract import typical
    from granite_lab.files import write_bytes
    from granite_lab.parameters import load_robot, load_soil, load_variants
    from granite_lab.planning.imprint import imprint
    from granite_lab.reporting.canvas import to_png, to_svg
    from granite_lab.reporting.plot_effect import effect_drawing

    found = imprint(
        typical(effect), load_robot(), load_soil(), load_variants(), jobs=min(4, os.cpu_count() or 1)
    )
    drawing = effect_drawing(found)
    svg = path.suffix.lower() == ".svg"
    write_bytes(path, to_svg(drawing.draw()).encode() if svg else to_png(drawing.draw()))
    return drawing.caption


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
