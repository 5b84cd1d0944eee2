"""Every command, file and link that the documentation shows exists."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import typer

from granite_lab.cli import app
from tests.docs.pages import PAGES, ROOT, blocks, text_of

LINES = [
    pytest.param(words, id=f"{page.name}: {' '.join(words)}"[:90])
    for page in PAGES
    for block in blocks(page)
    for words in block.commands()
]
INLINE = [
    pytest.param(words, id=f"{page.name}: {words}"[:90])
    for page in PAGES
    for words in re.findall(r"(?<!`)`granite-lab ([^`]+)`", re.sub(r"(?s)```.*?```", "", text_of(page)))
]
ROOT_COMMAND: Any = typer.main.get_command(app)
LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)(?:#[^)]*)?\)")


def _command(words: list[str]) -> tuple[Any, list[str]]:
    """Return the command that words name, and its arguments."""
    command: Any = ROOT_COMMAND
    rest = list(words)
    while rest and rest[0] in getattr(command, "commands", {}):
        command = command.commands[rest.pop(0)]
    return command, rest


def test_the_pages_show_commands_at_all() -> None:
    assert len(LINES) > 50
    assert len(INLINE) > 10


@pytest.mark.parametrize("words", LINES)
def test_a_line_of_the_documentation_is_understood(words: list[str]) -> None:
    command, rest = _command(words)
    assert command.name != "granite-lab", words
    command.make_context("granite-lab", rest)  # raises where a command, option or argument does not fit


@pytest.mark.parametrize("text", INLINE)
def test_a_command_that_a_sentence_names_exists(text: str) -> None:
    command, rest = _command(text.split())
    if not text.startswith("-"):
        assert command.name != "granite-lab", text
    known = {name for p in command.params for name in (*p.opts, *p.secondary_opts)} | {"--help", "-h"}
    assert {word.split("=")[0] for word in rest if word.startswith("-")} <= known


@pytest.mark.parametrize("wrong", [["studi", "a.csv"], ["study", "--no-such", "a.csv"], ["hide"], ["view"]])
def test_a_line_that_does_not_fit_would_be_seen(wrong: list[str]) -> None:
    command, rest = _command(wrong)
    if command.name == "granite-lab":
        return
    with pytest.raises(Exception, match=r"(?i)no such option|missing"):
        command.make_context("granite-lab", rest)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_of_a_page_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(text_of(page)):
        assert (page.parent / target).exists(), target


def test_every_page_is_linked_from_the_readme() -> None:
    linked = {(ROOT / target).resolve() for target in LINK.findall(text_of("README.md"))}
    assert {page.resolve() for page in PAGES} - linked - {ROOT / "README.md"} == set()


def test_make_targets_that_are_named_exist() -> None:
    makefile = text_of("Makefile")
    named = {target for page in PAGES for target in re.findall(r"(?:`|^)make ([a-z-]+)", text_of(page), re.M)}
    assert len(named) > 5
    for target in named:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
