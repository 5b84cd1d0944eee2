"""The command line: parses, calls and prints; every known error ends here in two lines."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from granite_lab import __version__
from granite_lab.commands import hidden, logs, model, plan, trials
from granite_lab.errors import LabError

app = typer.Typer(
    name="granite-lab",
    help="From raw logs of a robot on sand to slip, fitted models and reports, with uncertainty.",
    context_settings={"help_option_names": ["-h", "--help"]},
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # which would swallow units in brackets
)
for command in (
    logs.check,
    logs.inspect,
    logs.ingest,
    model.simulate,
    model.wheel,
    trials.fit_k92,
    trials.fit_atheta,
    trials.compare,
    trials.study,
    logs.view,
    trials.compare_studies,
    trials.discover,
    plan.plan_next,
    model.params,
    hidden.hide,
    hidden.reveal,
    hidden.kit,
):
    app.command(command.__name__.replace("_", "-"))(command)
app.add_typer(model.effects_app, name="effects")


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


def _interrupted() -> None:
    print("interrupted", file=sys.stderr)


def main() -> None:
    """Run the command line; known errors become one line, one hint and an exit code."""
    try:
        app()
    except LabError as error:
        print(f"error: {error.message}", file=sys.stderr)
        if error.hint:
            print(f"hint: {error.hint}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        _interrupted()
        sys.exit(130)
    except SystemExit as end:
        if end.code == 130:  # Ctrl-C that the parser has seen
            _interrupted()
        raise
    except BrokenPipeError:  # the reader of our output has gone, as in `… | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
