"""The main job as a user meets it: trials in, a report and recordings out, failures told and left out."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from granite_lab.effects import get
from granite_lab.effects.model_file import load_model
from tests.corpus.cli import Done, lab, succeeded, told
from tests.running.processes import ALONE, fit_by_slip, one_picture, short

pytestmark = pytest.mark.usefixtures("few_effects")
NAMES = ("short_v0.5_r2", "short_v0.7_r1")
LOGS = tuple(f"logs/{name}.csv" for name in NAMES)


@pytest.fixture(scope="module")
def few_effects(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Search for one effect and fit by the slip, with a cache of its own; of pictures draw one."""
    few = {id_: get(id_) for id_ in ALONE}
    with pytest.MonkeyPatch.context() as patch:
        fit_by_slip(tmp_path_factory.mktemp("few") / "cache", patch)
        one_picture(patch)
        patch.setattr("granite_lab.chain.library", lambda *_: few)
        yield


def write_trials(folder: Path, *names: str) -> None:
    """Write short trials with an effect that the search can find."""
    (folder / "logs").mkdir(parents=True)
    for name in names:
        (folder / "logs" / f"{name}.csv").write_text(short(name, share=0.8), encoding="utf-8")


@pytest.fixture(scope="module")
def ended(few_effects: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Done]:
    """Two good trials of different speed and a broken one, analysed once: their folder, and what was said."""
    root = tmp_path_factory.mktemp("study")
    write_trials(root, *NAMES)
    text = (root / LOGS[0]).read_text(encoding="utf-8")
    (root / "logs" / "broken.csv").write_text(text.replace("t_s,", "when,", 1), encoding="utf-8")
    return root, lab("study", "logs", "--out", "reports/mine", "--json", cwd=root)


@pytest.fixture
def folder(ended: tuple[Path, Done]) -> Path:
    return ended[0]


def test_a_failing_trial_is_told_and_left_out(ended: tuple[Path, Done]) -> None:
    done = ended[1]
    assert done.code == 0
    document = json.loads(done.out)
    assert document["schema"] == "granite-lab/study/1"
    assert document["trials"] == 2
    assert [failure["trial"] for failure in document["failures"]] == ["broken"]
    assert "column 't' is missing" in document["failures"][0]["message"]
    assert "warning: broken: left out" in done.err
    assert "Traceback" not in done.err


def test_it_ends_with_the_search_for_a_missing_effect(ended: tuple[Path, Done]) -> None:
    folder, found = ended[0], json.loads(ended[1].out)["discovery"]
    assert found["schema"] == "granite-lab/discovery/3"
    report = json.loads((folder / "reports" / "mine" / "report.json").read_bytes())
    for key in ("verdict", "sentence", "effects", "gap"):
        assert report["discovery"][key] == found[key]
    answers = {answer["id"]: answer for answer in report["answers"]["questions"]}
    assert answers["missing"]["verdict"] != "Not searched"
    named = [e["id"] for e in found["effects"] if not e["empirical"]]
    assert named == ["drive_reaction"]
    saved = load_model(folder / "reports" / "mine" / "model.toml")
    assert set(named) <= {e.id for e in saved.effects}
    assert saved.a_theta == pytest.approx(found["a_theta"]["found"]["value"])
    assert set(saved.sand) >= {"friction_angle", "shear_modulus", "exponent"}


def test_discover_writes_page_model_and_numbers_and_prints_what_it_writes(folder: Path) -> None:
    found = folder / "found"
    found.mkdir()
    (found / "mine.txt").write_text("kept")
    done = succeeded("discover", *LOGS, "--out", "found", "--jobs", 1, "--json", cwd=folder)
    document = json.loads(done.out)
    for name in ("index.html", "report.md", "finding.json", "model.toml", "figures/found_gap.svg"):
        assert (found / name).stat().st_size > 100, name
    assert (found / "mine.txt").read_text() == "kept"
    assert not [path for path in found.rglob("*") if path.name.startswith(".")]
    assert NAMES[1] in (found / "index.html").read_text(encoding="utf-8")
    assert document == json.loads((found / "finding.json").read_text(encoding="utf-8"))
    assert document["effects"]
    for effect in document["effects"]:
        assert set(effect) >= {"id", "parameters", "indistinguishable_from", "probability", "closes"}
        assert all(set(p) >= {"value", "std", "unit"} for p in effect["parameters"].values())
    assert document["where"]
    for place in document["where"]:
        assert set(place) == {
            "channel", "phase", "variant_mps", "t_start_s", "t_end_s", "frequency_hz", "share", "score",
        }  # fmt: skip
    assert [set(document["gap"][part]) for part in ("train", "held_out")] == [{"before", "after"}] * 2
    assert document["provisional"]  # two speeds
    assert document["model"] == "found/model.toml"


def test_compare_writes_figures_and_tables_of_a_trial(folder: Path) -> None:
    document = told("compare", LOGS[1], "--out", "compared", cwd=folder)
    channels = {m["channel"] for m in document["trials"][0]["misfits"]}
    assert {"velocity", "slip_f", "torque_r", "pitch"} <= channels
    assert all((folder / name).exists() for name in document["files"])
    assert {Path(name).suffix for name in document["files"]} == {".svg", ".png", ".pdf", ".csv", ".tex"}


def test_it_says_why_no_search_was_run(folder: Path) -> None:
    model = "reports/mine/model.toml"
    done = succeeded("study", LOGS[1], "--model", model, "--out", "with", "--no-recordings", cwd=folder)
    said = " ".join(done.out.split())
    assert "Not searched. No search starts from a model with effects." in said
    assert not (folder / "with" / "model.toml").exists()


def test_report_and_recordings_are_complete(folder: Path) -> None:
    report = folder / "reports" / "mine"
    for name in ("index.html", "report.md", "report.json"):
        assert (report / name).stat().st_size > 1000
    recordings = {path.stem: path.stat().st_size for path in (report / "recordings").glob("*.rrd")}
    assert set(recordings) == {*NAMES}
    assert all(size < 2_000_000 for size in recordings.values())
    assert not [path for path in report.rglob("*") if path.name.endswith(".part")]
    page = (report / "index.html").read_text(encoding="utf-8")
    assert "broken" in page
    assert "virtual" in page.lower()
    unknown = lab("view", "reports/mine", "--trial", "nobody", cwd=folder)
    assert unknown.code == 3
    assert "no recording of trial 'nobody'" in unknown.err
    assert NAMES[0] in unknown.err


def test_an_unchanged_report_is_kept_and_an_edited_one_is_written_again(ended: tuple[Path, Done]) -> None:
    folder, first = ended[0], json.loads(ended[1].out)
    report = folder / "reports" / "mine"
    page, before = report / "index.html", stamps(report)
    text = page.read_bytes()
    done = lab("study", "logs", "--out", "reports/mine", "--json", cwd=folder)
    assert json.loads(done.out) == first | {"unchanged": True}
    assert stamps(report) == before
    page.write_text("edited", encoding="utf-8")
    done = lab("study", "logs", "--out", "reports/mine", cwd=folder)
    assert "(unchanged" not in done.out
    assert page.read_bytes() == text
    assert "(unchanged" in lab("study", "logs", "--out", "reports/mine", cwd=folder).out


def test_the_same_study_in_another_folder_does_not_make_a_report_look_changed(tmp_path: Path) -> None:
    """What is remembered of a report is that of its folder: each recording has an id of its own."""
    for name in ("one", "other"):
        write_trials(tmp_path / name, NAMES[1])
        lab("study", "logs", "--out", "report", "--no-discover", cwd=tmp_path / name)
    for name in ("one", "other"):
        done = lab("study", "logs", "--out", "report", "--no-discover", cwd=tmp_path / name)
        assert "(unchanged" in done.out, name


def stamps(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


def test_fits_leave_out_a_trial_that_fails_unless_told_otherwise(folder: Path) -> None:
    done = succeeded("fit-k92", "logs", "--json", cwd=folder)
    document = json.loads(done.out)
    assert [fit["trial"] for fit in document["fits"]] == [*NAMES]
    assert "logs/broken.csv" in {i["file"] for i in document["provenance"]["inputs"]}
    assert "warning: broken: left out" in done.err
    strict = lab("study", "logs", "--out", "strict", "--strict", "--no-discover", cwd=folder)
    assert strict.code == 3
    assert strict.err.startswith("error: logs/broken.csv")
    assert not (folder / "strict").exists()
