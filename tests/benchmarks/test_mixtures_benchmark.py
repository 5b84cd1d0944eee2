"""The benchmark of mixtures: a schedule that covers what is asked, and a page that counts rightly."""

from typing import Any

from benchmarks.mixtures import figures, page, task


def line(**changed: Any) -> dict[str, Any]:
    return {
        "key": "1/wild", "seed": 1, "status": "judged", "verdict": "partly named", "seconds": 60.0,
        "hidden": {"bulldozing": 0.4, "tyre_windup": 0.3}, "right": ["bulldozing"], "missed": ["tyre_windup"],
        "absorbed": [], "outside": [], "wrong": [], "withheld": 0.7, "closed": {"trials": 0.9, "speeds": 0.8},
        "stated": [["bulldozing", 0.97, True]], "code": "new", "commit": "abc",
    } | changed  # fmt: skip


def test_the_sets_have_two_to_five_causes_each_on_both_sorts_of_soil() -> None:
    drawn = {(task(seed)["causes"], bool(task(seed)["soil_law"])) for seed in range(300_000, 300_008)}
    assert drawn == {(causes, law) for causes in (2, 3, 4, 5) for law in (False, True)}


def test_names_and_shares_are_counted_one_by_one() -> None:
    foreign = line(
        hidden={"strap_drag": 0.5, "bulldozing": 0.4}, outside=["strap_drag"], missed=[],
        wrong=["com_offset"], withheld=0.1,
    )  # fmt: skip
    small = line(
        hidden={"bulldozing": 0.9, "payload_mass": 0.01, "ground_slope": 0.02}, missed=[],
        right=["bulldozing", "payload_mass"], absorbed=["payload_mass", "ground_slope"],
    )  # fmt: skip
    rows = {name: value for name, value, _ in figures([line(), foreign, small])}
    assert rows["hidden effects that count, named"].startswith("3 of 4 = 75 %")
    assert rows["those that do not count, named"].startswith("1 of 2 = 50 %")
    assert rows["named effects that are not hidden"].startswith("1 of 5 = 20 %")
    assert rows["60 % closed at the withheld speed"].startswith("2 of 3 = 67 %")
    assert rows["the same, all causes in the library"].startswith("2 of 2 = 100 %")


def test_the_page_leaves_other_code_out_and_says_what_was_lost() -> None:
    lines = [
        line(code="old", seed=77),
        line(),
        {"status": "crashed", "seed": 3, "code": "new", "commit": "abc"},
    ]
    text = page(lines)
    assert "| 77 |" not in text
    assert "| 1 | bulldozing (40), tyre_windup (30) |" in text
    assert "| 0.95–0.98 | 0.970 | 1/1 = 100 % (21–100) | yes |" in text
    assert "1 sets are judged, 1 were refused or crashed, 0 could not be made" in text
