"""The benchmark of mixtures: a schedule that covers what is asked, and a page that counts rightly."""

from typing import Any

from benchmarks.mixtures import figures, page, reliability, task


def line(**changed: Any) -> dict[str, Any]:
    return {
        "key": "1/wild", "seed": 1, "status": "judged", "verdict": "partly named", "seconds": 60.0,
        "hidden": ["bulldozing", "tyre_windup"], "right": ["bulldozing"], "missed": ["tyre_windup"],
        "wrong": [], "withheld": 0.7, "closed": {"trials": 0.9, "speeds": 0.8},
        "probabilities": {"bulldozing": 0.97}, "code": "new", "commit": "abc",
    } | changed  # fmt: skip


def test_the_sets_have_two_to_five_causes_each_on_both_sorts_of_soil() -> None:
    drawn = {(task(seed)["causes"], bool(task(seed)["soil_law"])) for seed in range(300_000, 300_008)}
    assert drawn == {(causes, law) for causes in (2, 3, 4, 5) for law in (False, True)}


def test_names_and_shares_are_counted_one_by_one() -> None:
    foreign = line(hidden=["strap_drag", "bulldozing"], missed=[], wrong=["com_offset"], withheld=0.1)
    rows = {name: value for name, value, _ in figures([line(), foreign])}
    assert rows["hidden effects of the library named"].startswith("2 of 3 = 67 %")
    assert rows["named effects that are not hidden"].startswith("1 of 3 = 33 %")
    assert rows["60 % closed at the withheld speed"].startswith("1 of 2 = 50 %")
    assert rows["the same, all causes in the library"].startswith("1 of 1 = 100 %")


def test_a_stated_probability_is_held_against_how_often_it_was_right() -> None:
    sets = [line(probabilities={"bulldozing": 0.9, "com_offset": 0.7}, wrong=["com_offset"]), line()]
    assert [(row[0], row[2].split(" =")[0]) for row in reliability(sets)] == [
        ("0.6–0.8", "0 of 1"), ("0.8–0.95", "1 of 1"), ("0.95–0.99", "1 of 1"),
    ]  # fmt: skip


def test_the_page_leaves_other_code_out_and_says_what_was_lost() -> None:
    lines = [
        line(code="old", seed=77),
        line(),
        {"status": "crashed", "seed": 3, "code": "new", "commit": "abc"},
    ]
    text = page(lines)
    assert "| 77 |" not in text
    assert "1 sets are judged, 1 were refused or crashed, 0 could not be made" in text
