"""Options that several commands share, and the parsing of their texts."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer import Argument, Option

from granite_lab.errors import LabError, UsageError, printable
from granite_lab.estimate import Estimate

T = TypeVar("T")

AS_GIVEN = ("robot", "soil", "column_map", "use_reference", "ref_v_std", "ref_x_std")
"""Options on logs with the names that the API has."""

PASSED = ("drive", "model", "effects", "tolerance", "strict", "jobs", "scheduler", "cache")
"""Further options whose names and values are those of the API."""

TRIALS = "Logs (CSV, ROS bag, MCAP), or folders of them."
CATALOGUE = "a name of the catalogue or a .toml file"

Logs = Annotated[list[Path] | None, Argument(metavar="TRIALS…", help=TRIALS, show_default=False)]
LogsAtHand = Annotated[
    list[Path] | None,
    Argument(
        metavar="TRIALS…",
        help=f"{TRIALS} By default those that granite-lab.toml names, else those that ingest has read, else "
        "data/samples.",
        show_default=False,
    ),
]
Robot = Annotated[
    str | None,
    Option(help=f"The robot: {CATALOGUE}; by default as granite-lab.toml or the log says, else granite."),
]
Soil = Annotated[
    str | None,
    Option(help=f"The soil: {CATALOGUE}; by default as granite-lab.toml or the log says, else dry_sand."),
]
ColumnMap = Annotated[str | None, Option("--map", help=f"Column map: {CATALOGUE}, or a folder of these.")]
Topics = Annotated[list[str] | None, Option(
    "--topic", help="Topic of a bag, as imu=/imu/data, joints=… or odom=…; may be repeated.")]  # fmt: skip
Changes = Annotated[list[str] | None, Option(
    "--set", help="A number in place of the file's, as robot.wheels.radius_m=0.106; may be repeated.",
)]  # fmt: skip
Exclude = Annotated[list[str] | None, Option(
    "--exclude", help="A trial to leave out and why, as run04='a wheel hit a stone'; may be repeated.",
)]  # fmt: skip
From = Annotated[float | None, Option("--from", help="Start of the part to use [s, the log's time].")]
To = Annotated[float | None, Option("--to", help="End of the part to use [s, the log's time].")]
RestTexts = Annotated[list[str] | None, Option(
    "--rest", help="Interval in which robot and wheels stand, as 0:1.2 [s]; may be repeated.")]  # fmt: skip
BodyRests = Annotated[list[str] | None, Option(
    "--body-rest", help="Interval in which the body stands and its wheels may turn; may be repeated.",
)]  # fmt: skip
Tape = Annotated[str | None, Option(help="Total distance by tape [m], as 2.03 or 2.03±0.01.")]
UseReference = Annotated[bool, Option(
    "--use-reference", help="Use the log's external reference as a measurement; its std must be known.",
)]  # fmt: skip
RefVStd = Annotated[float | None, Option(help="Std of the reference's velocity [m/s].")]
RefXStd = Annotated[float | None, Option(help="Std of the reference's position [m].")]
DriveBy = Annotated[str, Option(
    "--drive", help="What drives the simulation: wheels, as they were measured; command; or auto, the "
    "command where it is stated and the wheels follow it, else the wheels.")]  # fmt: skip
ModelFile = Annotated[Path | None, Option(
    help="File (model.toml) of the paper's model with effects switched on.")]  # fmt: skip
EffectFile = Annotated[Path | None, Option(
    help="Your own effect file (.py). It is executed: use only code you trust.")]  # fmt: skip
Strict = Annotated[
    bool,
    Option(
        "--strict",
        help="A trial that fails is an error; by default it is left out and listed in the result.",
    ),
]
Jobs = Annotated[int, Option("--jobs", "-j", help="Number of processes; 0 means one per core.")]
Scheduler = Annotated[str | None, Option(help="Address of a Dask scheduler that does the work.")]
UseCache = Annotated[bool, Option(help="Store results and reuse those with the same inputs.")]
Tolerance = Annotated[float, Option(help="Accepted discrepancy, as a share of a channel's rms in motion.")]
Latency = Annotated[float, Option(help="Largest delay between two sensors that counts as latency [ms].")]
TableFile = Annotated[Path | None, Option("--out", help="Also write the table to this file (CSV).")]
Format = Annotated[str | None, Option(
    "--format", help="Format of the tables: csv or parquet.", show_default="csv")]  # fmt: skip
Quiet = Annotated[bool, Option("--quiet", "-q", help="No progress display.")]
Json = Annotated[bool, Option("--json", help="Print one JSON document instead of tables.")]


def picture(text: str) -> Any:
    """Return the option for the file of a figure."""

    def checked(option: typer.CallbackParam, path: Path | None) -> Path | None:
        if path and path.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise UsageError(f"{option.opts[0]} {path}: not a picture", "end the name in .png, .svg or .pdf")
        return path

    return Option(help=f"{text} (.png, .svg or .pdf).", callback=checked)


def keywords_of(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a command that several have as keywords of the API.

    Options that were not given are left out.

    Raises:
        UsageError: a text cannot be understood, or the window ends before it begins.
    """
    start, end = options["begin"], options["end"]
    first, last = -math.inf if start is None else start, math.inf if end is None else end
    if not first < last:
        raise UsageError(f"--from {first:g} --to {last:g}: not a window", "--from comes before --to")
    hint = "write start:end in seconds, the start first, as 0:1.2"
    tape = [text for text in (options["distance_measured"],) if text is not None]
    keywords = {name: options[name] for name in AS_GIVEN} | {
        "topics": topics_of(options["topics"]),
        "window": None if (first, last) == (-math.inf, math.inf) else (first, last),
        "rests": read_all("--rest", options["rests"], interval_of, hint),
        "body_rests": read_all("--body-rest", options["body_rests"], interval_of, hint),
        "distance_measured": next(
            iter(read_all("--distance-measured", tape, measured, "write 2.03 or 2.03±0.01 [m]")), None
        ),
        "changes": changes_of(options["changes"]),
    }
    given = {name: value for name, value in keywords.items() if value not in (None, False, [], {})}
    given |= {name: options[name] for name in PASSED if name in options}
    if "exclude" in options:
        given["exclude"] = excluded_of(options["exclude"])
    if "latency" in options:
        given["latency"] = options["latency"] / 1e3
    return {"logs": list(options["logs"] or ()), **given}


def at_hand(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return `keywords_of` the options; where no logs are named, with those at hand, which stderr names."""
    from granite_lab.api.at_hand import logs_at_hand

    keywords = keywords_of(options)
    if keywords["logs"]:
        return keywords
    taken = logs_at_hand()
    print(printable(taken.line), file=sys.stderr)
    return {**taken.keywords, **keywords, "logs": list(taken.logs)}


def count_of(logs: Sequence[Path]) -> int | None:
    """Return how many logs there are, for the end of a progress bar; None where that is not known."""
    from granite_lab.logs.trial import trial_files

    try:
        return len(trial_files(logs))
    except (LabError, OSError):  # the command itself reports it
        return None


def read_all(option: str, texts: Sequence[str] | None, read: Callable[[str], T], hint: str) -> list[T]:
    """Parse texts; None stands for an option that was not given.

    Raises:
        UsageError: `read` raises a ValueError; the message names the option.
    """
    try:
        return [read(text) for text in texts or ()]
    except ValueError:
        raise UsageError(f"{option} {' '.join(texts or ())}: cannot be understood", hint) from None


def read_pairs(
    option: str, texts: Sequence[str] | None, read: Callable[[str], tuple[str, T]], hint: str
) -> dict[str, T]:
    """Return names with their values; raise as `read_all`, also where a name occurs twice."""
    pairs = dict(read_all(option, texts, read, hint))
    if len(pairs) < len(texts or ()):
        raise UsageError(f"{option} {' '.join(texts or ())}: cannot be understood", hint)
    return pairs


def number_of(text: str) -> tuple[str, float]:
    """Return name and number of a text as ``name=number``."""
    name, _, value = text.partition("=")
    return name.strip(), float(value)


def changes_of(texts: Sequence[str] | None) -> dict[str, float]:
    """Return numbers of robot and soil by their keys, from texts as ``robot.wheels.radius_m=0.106``."""
    return read_pairs("--set", texts, number_of, "write key=number, each key once, as soil.cohesion_Pa=500")


def excluded_of(texts: Sequence[str] | None) -> dict[str, str]:
    """Return trials and why they are left out, from texts as ``run04=a wheel hit a stone``."""

    def read(text: str) -> tuple[str, str]:
        trial, reason = (part.strip() for part in text.split("=", 1))
        return trial, reason

    return read_pairs("--exclude", texts, read, "write trial='reason', each trial once")


def topics_of(texts: Sequence[str] | None) -> dict[str, str]:
    """Return roles of a bag's topics (``imu``, ``joints``, …) to the topics' names."""
    from granite_lab.logs.bag import ROLES

    def read(text: str) -> tuple[str, str]:
        role, _, topic = (part.strip() for part in text.partition("="))
        if role not in ROLES or not topic:
            raise ValueError
        return role, topic

    return read_pairs("--topic", texts, read, "write imu=/topic, joints=…, odom=… or reference=…, once each")


def effects_of(texts: Sequence[str] | None) -> dict[str, dict[str, float]]:
    """Return effects and their parameters, from texts as ``bulldozing.strength=0.5``."""
    hint = "write id.parameter=number"
    effects: dict[str, dict[str, float]] = {}
    for name, value in read_all("--effect", texts, number_of, hint):
        effect, _, parameter = name.partition(".")
        effects.setdefault(effect, {})[parameter] = value
    return effects


def interval_of(text: str) -> tuple[float, float]:
    """Return start and end of a text as ``0:1.2``."""
    start, end = map(float, text.split(":"))
    if not start < end:
        raise ValueError
    return start, end


def measured(text: str) -> Estimate:
    """Return a positive number with its std, from a text as ``2.03±0.01``."""
    value, _, std = text.replace("+-", "±").partition("±")
    tape = Estimate(float(value), float(std) if std else 0.005)
    if not (tape.value > 0 and tape.std > 0):
        raise ValueError
    return tape


def slips_of(text: str) -> list[float]:
    """Return the slip ratios that a text asks for: one, or start:end:step with both ends."""
    parts = [float(part) for part in text.split(":")]
    if len(parts) == 1:
        return parts
    start, end, step = parts
    if not (0 <= end - start <= 2 and step > 2e-4):  # at most 10,000 steps
        raise ValueError
    return [round(start + k * step, 12) for k in range(round((end - start) / step) + 1)]
