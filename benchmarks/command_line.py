"""The command line of a benchmark."""

from __future__ import annotations

import argparse
from pathlib import Path


def parser_of(doc: str | None) -> argparse.ArgumentParser:
    """Return a parser whose help shows the docstring of a module as it is written."""
    return argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)


def parser_of_sets(doc: str | None, results: Path) -> argparse.ArgumentParser:
    """Return a parser with the options of a benchmark that judges sets, and goes on where it ended.

    Args:
        doc: docstring of the module.
        results: file of its results, unless another one is given.
    """
    parser = parser_of(doc)
    parser.add_argument("--jobs", type=int, default=2, help="sets side by side")
    parser.add_argument("--results", type=Path, default=results, help="one line for each set")
    parser.add_argument("--out", type=Path, help="write the page here, too")
    return parser
