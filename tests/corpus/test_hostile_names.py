"""Names and cells from logs are shown as text: on the terminal, in messages, in maps and tables.

Pages, Markdown, CSV and recordings with such names are tested beside their writers.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from granite_lab.errors import printable
from granite_lab.logs import inspect_logs, read_trial
from tests.corpus.cli import LOG, lab

NAMES = {
    "markup": "[bold red]sand",
    "an open bracket": "sand[",
    "an escape sequence": "sand\x1b[2J\x1b]0;title\x07",
    "HTML": "<script>alert(1)<",
    "a formula": "=cmd|' C calc'!A0",
    "a link": "[x](javascript:alert(1))",
    "reading direction": "sand\u202egnp",
    "not a character": "sand\udcff",
    "quotes": "a\"b'c`d",
    "a line end": "two\nlines",
    "an option": "-rf",
}


def tame(text: str) -> bool:
    """Say whether a terminal shows a text as it stands."""
    return not any(c in text for c in "\x1b\x07\u202e\udcff\r")


@pytest.mark.parametrize("kind", NAMES)
def test_a_name_is_text_on_the_terminal_in_a_message_and_in_json(kind: str, tmp_path: Path) -> None:
    log, out = tmp_path / f"{NAMES[kind]}.csv", tmp_path / "out"
    done = lab("ingest", log)
    assert done.code == 3
    assert len(done.err.splitlines()) == 2
    assert tame(done.err)
    log.write_text(LOG)
    ingest, inspect = lab("ingest", log, "--out", out, "--jobs", 1), lab("inspect", log)
    for done in (ingest, inspect):
        assert done.code == 0, done
        assert tame(done.out), done.out
        assert tame(done.err), done.err
    if kind in ("markup", "an open bracket", "HTML", "a formula"):
        assert NAMES[kind].replace(" ", "")[:6] in "".join(ingest.out.split())
    document = json.loads(lab("inspect", log, "--json").out)
    assert document["files"][0]["path"].encode("utf-8", "replace") == str(log).encode("utf-8", "replace")


@pytest.mark.parametrize("kind", sorted({*NAMES} - {"not a character"}))
def test_a_column_of_any_name_goes_through_a_map(kind: str, tmp_path: Path) -> None:
    """Into the map that inspect writes, and out of it again."""
    header, _, rows = LOG.partition("\n")
    name = '"' + NAMES[kind].replace('"', '""').replace("\n", " ") + '"'
    log, own = tmp_path / "log.csv", tmp_path / "map.toml"
    log.write_text(header.replace("enc_rr_rad", name) + "\n" + rows, encoding="utf-8")
    report = inspect_logs([log])
    own.write_text(report.to_map_toml(), encoding="utf-8")
    assert lab("inspect", log, "--map", own).code == 0
    done = lab("inspect", log)
    assert tame(done.out)
    assert tame(done.err)


@pytest.mark.parametrize("kind", sorted({*NAMES} - {"not a character"}))
def test_metadata_are_text(kind: str, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text(f"# operator = {json.dumps(NAMES[kind])}\n" + LOG, encoding="utf-8")
    assert read_trial(log).info.extra["operator"] == NAMES[kind]
    log.write_text(f"# robot = {json.dumps(NAMES[kind])}\n" + LOG, encoding="utf-8")
    done = lab("ingest", log)
    assert done.code in (2, 3)
    assert len(done.err.splitlines()) == 2
    assert tame(done.err)


def test_a_line_for_the_terminal_is_one_line() -> None:
    assert printable("a\n b\tc") == "a b c"
    assert printable("a\x1b[1mb") == "a\ufffd[1mb"
    assert printable("Müller, 20 °C, λ_R ≤ 5 %") == "Müller, 20 °C, λ_R ≤ 5 %"
