"""Commands on trials with a sealed answer: write them, decode the answer, compare a finding with it."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

import granite_lab as gl
from granite_lab.columns import Column, Table, words
from granite_lab.commands.options import Jobs, Json, Quiet, Robot, Soil, number_of, read_pairs
from granite_lab.commands.printer import Printer, progress, warn
from granite_lab.hidden.scoring import MEANING, ParameterScore, Score
from granite_lab.rounding import percent

PARTS = {"train": "trials in the fit", "held_out": "trials left out of the fit"}
"""Parts of the trials for which a discovery states a gap, as they are printed."""


def hide(
    effect: Annotated[str, Option(
        help="Ids joined by +; or random: one of the library; pair: two of it; outside: one that it "
        "lacks; mixture: several --causes; none.")],
    out: Annotated[Path, Option(help="Folder of the trials and the sealed answer.")],
    causes: Annotated[int, Option(
        help="Number of causes of a mixture (2 to 5). Without any of them a tenth of the squared gap is "
        "left.")] = 3,
    soil_law: Annotated[str, Option(
        help="Contact law in place of the paper's: stress_ahead, exit_by_sinkage, shear_softening, "
        "bearing_limit, or random.", show_default="the paper's")] = "",
    command: Annotated[str, Option(
        help="trapezoid: the variants of Table 2; joystick: a person's stick, another one in each trial; "
        "recorded: sticks, the same in all repetitions.")] = "trapezoid",
    log_command: Annotated[bool, Option(
        "--log-command", help="The desired velocity is a column of the logs.")] = False,
    controller: Annotated[str, Option(
        help="paper: as in the robot's file; unknown: another one that is not in any file.")] = "paper",
    seed: Annotated[int, Option(help="Seed of all random numbers.")] = 0,
    strength: Annotated[float, Option(help="Factor on the effect's size (0.001 to 1000).")] = 1.0,
    sizes: Annotated[list[str] | None, Option(
        "--size", help="A parameter of the effect: name=value, or id.name=value; may be repeated.")] = None,
    noise: Annotated[float, Option(help="Factor on the sensors' noise (0 to 100).")] = 1.0,
    sand_off: Annotated[bool, Option(
        "--sand-off", help="Change φ, K, n and μ_s of the soil by 5 to 20 %.")] = False,
    repetitions: Annotated[int | None, Option(
        help="Trials of each variant; by default 3 (bench) or 2 to 4 (wild) (1 to 99).")] = None,
    lab: Annotated[str, Option(
        help="bench: sensors, robot and sand as in the files; wild: drawn by the seed, with files of "
        "robot and sand beside the trials.")] = "bench",
    robot: Robot = None, soil: Soil = None,
    label: Annotated[str, Option("--name", help="First word of the trials' names.")] = "hidden",
    truth: Annotated[Path | None, Option(help="Folder for the true motion of each trial (CSV).")] = None,
    jobs: Jobs = 1,
    quiet: Quiet = False, as_json: Json = False,
) -> None:  # fmt: skip
    """Write virtual trials with a hidden effect, by an independent simulator; seal the answer.

    The trials and the sealed answer are written into the folder --out.
    """
    named = read_pairs("--size", sizes, number_of, "write name=number")
    with progress("trials", quiet=quiet) as watch:
        made = gl.hide(
            effect, out, causes=causes, soil_law=soil_law, command=command, log_command=log_command,
            controller=controller, seed=seed, strength=strength, sizes=named,
            noise=noise, sand_off=sand_off, repetitions=repetitions, lab=lab, robot=robot, soil=soil,
            label=label, truth=truth, jobs=jobs,
            done=watch.done,
        )  # fmt: skip
    printer = Printer(as_json)
    printer.json("hide/1", vars(made))
    folder, finding = shlex.quote(str(out)), shlex.quote(str(out / "finding.json"))
    printer.line(f"{len(made.trials)} virtual trials in {out}, the answer sealed in {made.sealed}")
    printer.line(f"find it: granite-lab discover {folder} --json > {finding}")
    printer.line(f"then:    granite-lab reveal {folder} --finding {finding}")


def reveal(
    folder: Annotated[Path, Argument(
        metavar="DIR", help="Folder written by hide, or one with logs and their answer in answer.json.")],
    finding: Annotated[Path | None, Option(
        help="Discovery to be judged: JSON of discover or study, or its folder.")] = None,
    as_json: Json = False,
) -> None:  # fmt: skip
    """Decode the answer of a set of trials, and compare a finding with it.

    Without --finding only the answer is printed.
    """
    opened, printer = gl.reveal(folder, finding), Printer(as_json)
    warn(opened.warnings)
    printer.json("reveal/1", {"answer": opened.answer, "score": opened.score})
    _show_answer(opened.answer, printer)
    if opened.score:
        _show_score(opened.score, printer)


HIDDEN = Table[tuple[str, str, float | None, str]](
    "hidden",
    "What is hidden",
    Column("effect", lambda row: words(row[0])),
    Column("parameter", lambda row: row[1]),
    Column("value", lambda row: row[2], "value", form=".4g"),
    Column("unit", lambda row: words(row[3])),
)
SCORED = Table[ParameterScore](
    "scored",
    "Sizes hidden and found",
    Column("effect", lambda p: p.effect),
    Column("parameter", lambda p: f"{p.name} [{_scale(p)[0]}]".removesuffix(" []")),
    Column("hidden", lambda p: _sized(p, p.true), "hidden", form=".4g"),
    Column("found", lambda p: _sized(p, p.value), "found", form=".4g"),
    Column("std", lambda p: _sized(p, p.std), "std", form=".2g"),
    Column("z", lambda p: p.z, "z", form="+.1f"),
    Column("meaning", lambda p: p.kind),
)


def _show_answer(answer: Mapping[str, Any], printer: Printer) -> None:
    if answer["effects"]:
        printer.say("Hidden in these trials", "bold")
        rows = []
        for effect in answer["effects"]:
            named = effect["id"] + ("" if effect["library"] else " (not in the library)")
            scales = {
                k: _printed(effect["id"], k, p["unit"], p["value"]) for k, p in effect["parameters"].items()
            }
            values = [(k, p["value"] * scales[k][1], scales[k][0]) for k, p in effect["parameters"].items()]
            rows += [("" if k else named, *cells) for k, cells in enumerate(values or [("", None, "")])]
        printer.rows(HIDDEN, rows)
        for effect in answer["effects"]:
            account = ". ".join(part for part in (effect["title"], effect["account"]) if part)
            if account:
                printer.say(f"{effect['id']}: {account}.")
    else:
        printer.say("Nothing is hidden in these trials.")
    if "seed" not in answer:
        return
    if answer["sand_off"]:
        off = ", ".join(f"{name} {100 * (x - 1):+.1f} %" for name, x in answer["sand_off"].items())
        printer.say(f"sand off its file: {off}")
    lab = answer.get("lab", {})
    for part, drawn in lab.items() if lab.get("name") == "wild" else ():
        each = drawn if isinstance(drawn, Mapping) else {"": drawn}
        if part in ("robot", "soil"):
            each = {"": drawn["name"]} | _off(drawn["filed"], drawn["real"])
        texts = ", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in each.items())
        printer.line(f"{part}: {texts.strip()}")
    printer.say(f"seed {answer['seed']}, strength {answer['strength']:g}, noise {answer['noise']:g}")


def _off(filed: Mapping[str, Any], real: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers of a robot or sand that are not those of its file."""
    numbers: dict[str, Any] = {}
    for key, value in real.items():
        if isinstance(value, Mapping):
            numbers |= {f"{key}.{name}": number for name, number in _off(filed[key], value).items()}
        elif value != filed[key]:
            numbers[key] = value
    return numbers


def _show_score(judged: Score, printer: Printer) -> None:
    mark = "right" if judged.right else "wrong"
    named = ", ".join(judged.named) or judged.verdict
    printer.say(f"judgement: {mark}; {MEANING[judged.outcome]} (found: {named})")
    for group in ("right", "missed", "absorbed", "wrong") if len(judged.hidden) > 1 else ():
        printer.say(f"names {group}: {', '.join(getattr(judged.names, group)) or 'none'}")
    for statement in judged.stated:
        was, how = "right" if statement.right else "wrong", "named" if statement.named else "described"
        printer.say(f"{statement.id}: {how} with probability {statement.probability:.3f}, {was}")
    if judged.parameters:
        printer.rows(SCORED, judged.parameters)
    for part, share in judged.gap_closed.items():
        if share is not None:
            printer.say(f"gap closed, {PARTS[part]}: {percent(share)}")
    if judged.closed_withheld is not None:
        printer.say(f"gap closed by the saved model at the withheld speed: {percent(judged.closed_withheld)}")


def _sized(size: ParameterScore, value: float | None) -> float | None:
    return None if value is None else value * _scale(size)[1]


def _scale(size: ParameterScore) -> tuple[str, float]:
    return _printed(size.effect, size.name, size.unit, size.true)


def _printed(effect: str, name: str, unit: str, size: float) -> tuple[str, float]:
    """Return the unit in which reports print a number, and the factor to it; nothing for one without."""
    from granite_lab.reporting.names import scale_of

    shown, factor = scale_of(effect, name, unit, size)
    return "" if shown == "-" else shown, factor
