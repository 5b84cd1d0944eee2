"""Every option, command, make target, file and link that the documentation names exists."""

from __future__ import annotations

import re
import shlex
from contextlib import suppress
from pathlib import Path

import pytest

from granite_lab.errors import InputError
from tests.docs.pages import PAGES, ROOT, command_of, lines_to_run, text_of

SHOWN = [line for page in PAGES for line, _ in lines_to_run(page) if line.startswith("granite-lab ")]
INLINE = [
    words
    for page in PAGES
    for words in re.findall(r"(?<!`)`granite-lab ([^`]+)`", re.sub(r"(?s)```.*?```", "", text_of(page)))
]
LINK = re.compile(r"\]\((?!https?:)([^)#\s]+)(?:#([^)]*))?\)")


@pytest.mark.parametrize("line", sorted(set(SHOWN)))
def test_a_shown_command_is_understood(line: str) -> None:
    command, rest = command_of(shlex.split(line.split(" > ", maxsplit=1)[0])[1:])
    assert command.name != "granite-lab", line
    with suppress(InputError):  # the files of the page are not here
        command.make_context("granite-lab", rest)  # raises where an option or argument does not fit


@pytest.mark.parametrize("text", sorted(set(INLINE)))
def test_a_command_that_a_sentence_names_exists(text: str) -> None:
    command, rest = command_of(text.split())
    if not text.startswith("-"):
        assert command.name != "granite-lab", text
    known = {name for p in command.params for name in (*p.opts, *p.secondary_opts)} | {"--help", "-h"}
    assert {word.split("=")[0] for word in rest if word.startswith("-")} <= known


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_of_a_page_lead_somewhere(page: Path) -> None:
    for target, heading in LINK.findall(text_of(page)):
        assert (page.parent / target).exists(), target
        if heading:
            titles = re.findall(r"^#+ (.*)", text_of(page.parent / target), re.MULTILINE)
            anchors = [re.sub(r"[^\w -]", "", title).lower().replace(" ", "-") for title in titles]
            assert heading in anchors, (target, heading)


def test_every_page_is_linked_from_the_readme() -> None:
    linked = {(ROOT / target).resolve() for target, _ in LINK.findall(text_of("README.md"))}
    assert {page.resolve() for page in PAGES} - linked - {ROOT / "README.md"} == set()


def test_make_targets_that_are_named_exist() -> None:
    makefile = text_of("Makefile")
    named = {target for page in PAGES for target in re.findall(r"(?:`|^)make ([a-z-]+)", text_of(page), re.M)}
    assert len(named) > 5
    for target in named:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
