"""`granite-lab hide`, `reveal` and `kit`: trials with a sealed answer, to judge discoveries."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from granite_lab.api import hidden as api
from granite_lab.commands.command import Call, command, warn
from granite_lab.commands.options import Flag
from granite_lab.hidden.catalogue import LIBRARY, OUTSIDE
from granite_lab.hidden.lab import LABS
from granite_lab.hidden.scoring import MEANING
from granite_lab.hidden.wish import LOTS

if TYPE_CHECKING:
    from granite_lab.hidden.scoring import Score


@command(
    api.hide,
    busy="trials",
    effect=Flag(("--effect",), complete=lambda: (*LOTS, *LIBRARY, *OUTSIDE)),
    lab=Flag(complete=lambda: tuple(LABS)),
)
def hide(call: Call[api.HiddenSet]) -> None:
    """The trials and the sealed answer are written into the folder --out."""
    made, out = call(), call.said["out"]
    call.json("hide/1", vars(made))
    folder, finding = shlex.quote(str(out)), shlex.quote(str(out / "finding.json"))
    call.line(f"{len(made.trials)} virtual trials in {out}, the answer sealed in {made.sealed}")
    call.line(f"find it: granite-lab discover {folder} --json > {finding}")
    call.line(f"then:    granite-lab reveal {folder} --finding {finding}")


@command(api.reveal)
def reveal(call: Call[api.Revealed]) -> None:
    """Without a discovery, only the answer is printed."""
    opened = call()
    warn(opened.warnings)
    call.json("reveal/1", {"answer": opened.answer, "score": opened.score})
    _show_answer(opened.answer, call)
    if opened.score:
        _show_score(opened.score, call)


def _show_answer(answer: Mapping[str, Any], call: Call[Any]) -> None:
    trials = "virtual trials" if answer.get("virtual", True) else "trials"
    if answer["effects"]:
        call.say(f"Hidden in these {trials}", "bold")
        rows = []
        for effect in answer["effects"]:
            named = effect["id"] + ("" if effect["library"] else " (not in the library)")
            values = [(name, p["value"], p["unit"]) for name, p in effect["parameters"].items()]
            rows += [("" if k else named, *cells) for k, cells in enumerate(values or [("", None, "")])]
        call.rows("hidden", rows, {"0": lambda row: row[0]})
        for effect in answer["effects"]:
            told = ". ".join(part for part in (effect["title"], effect["account"]) if part)
            call.say(f"{effect['id']}: {told}.")
    else:
        call.say(f"Nothing is hidden in these {trials}.")
    if "made_by" in answer:
        call.say(f"made by {answer['made_by']}")
        return
    if answer["sand_off"]:
        off = ", ".join(f"{name} {100 * (x - 1):+.1f} %" for name, x in answer["sand_off"].items())
        call.say(f"sand off its file: {off}")
    lab = answer.get("lab", {})
    for part, drawn in lab.items() if lab.get("name") == "wild" else ():
        each = drawn.items() if isinstance(drawn, Mapping) else [("", drawn)]
        told = ", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in each)
        call.line(f"{part}: {told.strip()}")
    call.say(f"seed {answer['seed']}, strength {answer['strength']:g}, noise {answer['noise']:g}")


def _show_score(judged: Score, call: Call[Any]) -> None:
    mark = "right" if judged.right else "wrong"
    named = ", ".join(judged.named) or judged.verdict
    call.say(f"judgement: {mark}; {MEANING[judged.outcome]} (found: {named})")
    if judged.parameters:
        call.rows("scored", judged.parameters, {"parameter": lambda p: f"{p.name} [{p.unit}]"})
    for part, share in judged.gap_closed.items():
        if share is not None:
            call.say(f"gap closed, {part.replace('_', ' ')} trials: {100 * share:.1f} %")


@command(api.kit, out=Flag(metavar="OUT", help="New folder of the kit."))
def kit(call: Call[api.Kit]) -> None:
    """`granite-lab reveal` judges `discover` by the kit that comes back."""
    made = call()
    call.json("kit/1", vars(made))
    for path in made.files:
        call.line(path)
    call.line(f"read {made.folder / 'README.md'}; python {made.folder / 'check.py'} checks and seals it")
