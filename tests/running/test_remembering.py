"""A result is remembered as long as everything it was made from is the same, and no longer."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from granite_lab.errors import LabError
from granite_lab.estimate import Estimate
from granite_lab.parameters import load_robot
from granite_lab.parameters.catalogue import CATALOGUE
from granite_lab.running import Cache, Execution, Options, cache, each_trial

worked: list[str] = []


def measure(path: Path, options: Options) -> Estimate:
    """Stand in for the chain: the length of the log, with the robot's mass beside it."""
    worked.append(path.name)
    text = path.read_text(encoding="utf-8")
    if "interrupt" in text:
        raise KeyboardInterrupt
    robot = load_robot(options.robot or text.partition("robot=")[2].strip() or "granite")
    return Estimate(float(len(text)), robot.chassis.body_mass)


@pytest.fixture
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    worked.clear()
    monkeypatch.chdir(tmp_path)
    for i in range(4):
        Path(f"{i}.csv").write_text("x" * (i + 1), encoding="utf-8")
    return [Path(f"{i}.csv") for i in range(4)]


@pytest.fixture
def how(tmp_path: Path) -> Execution:
    return Execution(1, cache=Cache(tmp_path / "cache"))


def run(logs: list[Path], how: Execution, options: Options = Options()) -> list[Estimate | LabError]:  # noqa: B008
    worked.clear()
    return each_trial(measure, logs, options, execution=how)


def test_nothing_is_done_twice(logs: list[Path], how: Execution) -> None:
    first = run(logs, how)
    assert worked == ["0.csv", "1.csv", "2.csv", "3.csv"]
    assert run(logs, how) == first
    assert worked == []


def test_a_changed_log_is_done_again_and_only_that(logs: list[Path], how: Execution) -> None:
    run(logs, how)
    logs[2].write_text("other", encoding="utf-8")
    found = run(logs, how)
    assert worked == ["2.csv"]
    assert found[2] == Estimate(5.0, load_robot().chassis.body_mass)
    logs[2].write_text("xxx", encoding="utf-8")  # as it was: remembered, too
    run(logs, how)
    assert worked == []


def test_an_interrupted_run_keeps_what_was_finished(logs: list[Path], how: Execution) -> None:
    logs[2].write_text("interrupt", encoding="utf-8")
    with pytest.raises(KeyboardInterrupt):
        run(logs, how)
    logs[2].write_text("xxx", encoding="utf-8")
    run(logs, how)
    assert worked == ["2.csv", "3.csv"]


def robot_file(path: Path, mass: float) -> None:
    text = (CATALOGUE / "robots" / "granite.toml").read_text(encoding="utf-8")
    old = f"body_mass_kg = {load_robot().chassis.body_mass:g}"
    assert old in text
    path.write_text(text.replace(old, f"body_mass_kg = {mass}", 1), encoding="utf-8")


@pytest.mark.parametrize("by", ["option", "log"])
def test_an_edited_robot_counts_whoever_names_it(logs: list[Path], how: Execution, by: str) -> None:
    robot_file(Path("mine.toml"), 5.0)
    options = Options(robot="mine.toml") if by == "option" else Options()
    if by == "log":
        logs[1].write_text("robot=mine.toml", encoding="utf-8")
    assert run(logs[1:2], how, options)[0].std == 5.0
    assert run(logs[1:2], how, options)[0].std == 5.0
    assert worked == []
    robot_file(Path("mine.toml"), 6.0)
    assert run(logs[1:2], how, options)[0].std == 6.0
    assert worked == ["1.csv"]


def test_a_new_sidecar_an_option_and_new_code_count(
    logs: list[Path], how: Execution, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(logs, how)
    Path("0.toml").write_text("", encoding="utf-8")
    run(logs, how)
    assert worked == ["0.csv"]
    run(logs, how, Options(rows="run = 1"))
    assert len(worked) == 4
    monkeypatch.setattr(cache, "code", lambda **_: "another version")
    run(logs, how)
    assert len(worked) == 4


def test_a_damaged_entry_is_made_again(logs: list[Path], how: Execution) -> None:
    first = run(logs, how)
    entries = sorted(how.cache.folder.glob("*/*.bin"))
    data = entries[0].read_bytes()
    entries[0].write_bytes(data[: len(data) // 2])
    entries[1].write_bytes(data.replace(b"value", b"valve"))
    entries[2].write_bytes(b"")
    entries[3].write_bytes(data[:120] + bytes([data[120] ^ 1]) + data[121:])
    assert run(logs, how) == first
    assert len(worked) >= 3


def test_a_cache_that_cannot_be_written_costs_nothing_but_time(logs: list[Path], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    how = Execution(1, cache=Cache(tmp_path / "file" / "cache"))
    assert len(run(logs, how)) == 4
    assert "cannot be written" in how.cache.trouble.message


def test_the_cache_stays_within_its_size_and_drops_what_was_used_longest_ago(
    logs: list[Path], how: Execution
) -> None:
    run(logs, how)
    cache = how.cache
    entries = sorted(cache.folder.glob("*/*.bin"))
    for age, path in enumerate(entries):
        os.utime(path, (time.time() - 100 * age,) * 2)
    left_over = cache.folder / "ab" / ".x.bin.0123456789ab.part"
    left_over.parent.mkdir(exist_ok=True)
    left_over.write_bytes(b"x")
    os.utime(left_over, (0, 0))
    cache.trim(2 * entries[0].stat().st_size + 10)
    assert sorted(cache.folder.glob("*/*")) == sorted(entries[:2])
