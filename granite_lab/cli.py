"""The command line: finds the command and calls it; every known error ends here in two lines."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Annotated, Any, cast

import typer
from typer.core import TyperGroup

from granite_lab import __version__
from granite_lab.errors import LabError, UsageError

COMMANDS = {
    "check": ("logs", "Check whether a log is usable."),
    "inspect": ("logs", "Show what is recognised in a log."),
    "ingest": ("logs", "Estimate velocity and slip with their uncertainty."),
    "simulate": ("model", "Simulate one run."),
    "wheel": ("model", "Compute one wheel on the soil."),
    "fit-k92": ("trials", "Fit k_92 of each trial."),
    "fit-atheta": ("trials", "Estimate a_θ of k_92 = exp(-a_θ v)."),
    "compare": ("trials", "Compare measured and simulated motion."),
    "study": ("trials", "Analyse trials and write a report."),
    "view": ("logs", "Open a recording in the viewer."),
    "compare-studies": ("trials", "Compare two studies."),
    "discover": ("trials", "Find the effect that the model lacks."),
    "plan-next": ("trials", "Propose the most useful next trial."),
    "params": ("model", "Print the parameters in force."),
    "robot": ("model", "Write the file of a new robot."),
    "hide": ("hidden", "Write virtual trials with a hidden effect."),
    "reveal": ("hidden", "Decode a sealed answer and compare a finding with it."),
    "effects": ("model", "List, describe and check effects."),
}
"""Module and one line of help of each command, so that help need not import them."""


METAVARS = {"Path": "PATH", "float": "NUMBER", "int": "NUMBER", "str": "TEXT", "list[str]": "TEXT"}
"""Types of values as help prints them."""


def command_of(name: str) -> Any:
    """Import a command."""
    module = import_module(f"granite_lab.commands.{COMMANDS[name][0]}")
    made = getattr(module, name.replace("-", "_"))
    if not isinstance(made, typer.Typer):
        function, made = made, typer.Typer(add_completion=False, rich_markup_mode=None)
        made.command(name)(function)
    command = typer.main.get_command(made)
    command.name = name
    for part in (command, *getattr(command, "commands", {}).values()):
        for parameter in part.params:
            if parameter.param_type_name == "argument":  # its type in Python tells a reader nothing
                vars(parameter)["display_type_rich"] = lambda ctx: None  # noqa: ARG005
            elif not parameter.is_flag:
                parameter.metavar = parameter.metavar or METAVARS.get(parameter.bare_type())
    return command


_MISUSED = cast("type[Exception]", typer.BadParameter.__bases__[0])
"""What the parser raises; Typer gives it no name of its own."""


@contextmanager
def _as_usage_error() -> Iterator[None]:
    """Turn what the parser says of arguments into an error of this package."""
    try:
        yield
    except _MISUSED as error:
        misuse: Any = error
        if type(misuse).__name__ == "NoArgsIsHelpError":
            raise
        message, _, meant = misuse.format_message().rstrip(".").partition(". ")
        path = misuse.ctx.command_path if misuse.ctx else "granite-lab"
        hint = f"{meant[:1].lower()}{meant[1:]} " if meant else ""
        raise UsageError(f"{message[:1].lower()}{message[1:]}", f"{hint}{path} --help lists all") from None


def _refuse_repeated(command: Any, given: Sequence[str]) -> None:
    """Refuse an option that takes one value and is given twice: the parser would take the last of them."""
    single = {
        name: parameter.opts[0]
        for parameter in command.params
        if parameter.param_type_name == "option" and not (parameter.multiple or parameter.is_flag)
        for name in (*parameter.opts, *parameter.secondary_opts)
    }
    typed = Counter(single[name] for text in given if (name := text.partition("=")[0]) in single)
    for name, count in typed.items():
        if count > 1:
            hint = "a folder stands for several maps" if name == "--map" else "give it once"
            raise UsageError(f"{name} is given {count} times, and takes one value", hint)


class _Group(TyperGroup):
    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands: Any = dict.fromkeys(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        """Return a command, which is imported now; None where there is none of that name."""
        return command_of(cmd_name) if cmd_name in COMMANDS else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command of some arguments, its name and what is left of them."""
        name, command, left = super().resolve_command(ctx, args)
        _refuse_repeated(command, left)
        return name, command, left

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Read the arguments before the command."""
        with _as_usage_error():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """Read the command with its arguments, and call it."""
        with _as_usage_error():
            return super().invoke(ctx)

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Print the commands without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


def _warn_of_machine_code(*_: Any, **__: Any) -> None:
    """Warn where machine code could not be kept for the next command, if this one needed any."""
    if (stored := sys.modules.get("granite_lab.stored")) is not None:
        from granite_lab.commands.printer import warn

        warn(stored.machine_code().doubts())


app = typer.Typer(
    name="granite-lab",
    cls=_Group,
    help="From raw logs of a robot on sand to slip, fitted models and reports, with uncertainty.",
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Options of a command: granite-lab COMMAND --help\n\nA first study: granite-lab study FOLDER",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # which would swallow units in brackets
    result_callback=_warn_of_machine_code,
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"granite-lab {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """From raw logs of a robot on sand to slip, fitted models and reports, with uncertainty."""


def main() -> None:
    """Run the command line; known errors become one line, one hint and an exit code."""
    try:
        app(prog_name="granite-lab")
    except LabError as error:
        print(f"error: {error.message}", file=sys.stderr)
        if error.hint:
            print(f"hint: {error.hint}", file=sys.stderr)
        sys.exit(error.exit_code)
    except (KeyboardInterrupt, SystemExit) as end:
        if isinstance(end, SystemExit) and end.code != 130:  # 130 is Ctrl-C that the parser has seen
            raise
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:  # the reader of our output has gone, as in `… | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
