"""Every command is a function: the same numbers, as records and tables."""

import dataclasses
import importlib.util
import inspect
import json
import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import granite_lab as gl
from granite_lab.api.records import Records
from granite_lab.discovery.finding import Finding
from granite_lab.errors import EstimateError, InputError, UsageError
from granite_lab.fitting.fit import K92Fit
from granite_lab.parameters import load_variants
from granite_lab.reporting import write_report
from granite_lab.reporting.answers import of_study
from granite_lab.reporting.render import marked, study_as_html
from tests.corpus.cli import ROOT, SAMPLES, lab, refused, succeeded, told
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import made_up_finding

SAMPLE = SAMPLES / "virtual_v0.3_r1.csv"
VERBS = {name: getattr(gl, name) for name in gl.__all__ if inspect.isfunction(getattr(gl, name))}
OTHER = SAMPLES / "virtual_v0.7_r1.csv"


def test_every_function_is_described_and_listed() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    for name, function in VERBS.items():
        assert name in dir(gl)
        text = inspect.getdoc(function) or ""
        for argument in inspect.signature(function).parameters:
            assert f"{argument}:" in text or f"{argument}," in text, (name, argument)
        assert f"gl.{name}(" in page
    with pytest.raises(AttributeError, match="nonsense"):
        gl.nonsense  # noqa: B018


@pytest.fixture(scope="module")
def fits() -> Records[K92Fit]:
    return gl.fit_k92([SAMPLE, OTHER])


def test_motions_fits_and_findings_are_drawn_and_shown_in_a_notebook(
    tmp_path: Path, fits: Records[K92Fit]
) -> None:
    motions, finding, law = gl.ingest(SAMPLE), made_up_finding(), gl.fit_a_theta(list(fits))
    records = {"motion": motions[0].motion, "fits": fits, "fit": fits[0], "law": law, "finding": finding}
    records |= {"run": gl.simulate(0.3), "wheel": gl.wheel([0.1, 0.2]), "slip": gl.wheel(0.2)}
    for name, record in records.items():
        assert len(repr(record)) < 600
        assert "<table" in record._repr_html_()
        assert len(record._repr_html_()) < 20_000
        figure = gl.plot(record)
        assert figure._repr_png_().startswith(b"\x89PNG")
        if name not in ("run", "wheel", "slip"):
            assert any("virtual" in text.get_text() for text in figure.texts)
        labels = [label for axis in figure.axes for label in (axis.get_xlabel(), axis.get_ylabel()) if label]
        assert labels
        assert all(label.endswith("]") for label in labels), (name, labels)
        figure.savefig(tmp_path / f"{name}.png")
    assert "virtual_v0.3_r1" in repr(motions)
    drawn = [bar.lines[0].get_ydata()[0] for bar in gl.plot(fits).axes[0].containers]
    np.testing.assert_array_equal(drawn, [fit.k92.value for fit in fits])
    velocity = gl.plot(motions).axes[0].lines[0]
    np.testing.assert_array_equal(velocity.get_ydata(), motions[0].motion.v)
    with pytest.raises(TypeError, match="of other records one"):
        gl.plot(gl.params())


@pytest.mark.usefixtures("one_picture")
def test_every_record_has_a_short_repr_and_a_table_for_a_notebook(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("granite_lab.hidden.making.load_variants", lambda: load_variants()[:1])
    study = made_up_study(speeds=(0.3, 0.7), repetitions=1)
    write_report(study, tmp_path / "a")
    hidden = gl.hide("none", tmp_path / "set", repetitions=1)
    records = [
        gl.inspect(SAMPLE), gl.check(SAMPLE), gl.params(), gl.list_effects(), study, study.trials[0], hidden,
        gl.reveal(tmp_path / "set"), gl.compare_studies(tmp_path / "a", tmp_path / "a"),
    ]  # fmt: skip
    for record in records:
        assert len(repr(record)) < 600, record
        assert "<table" in record._repr_html_()
        assert len(record._repr_html_()) < 20_000
    assert len(repr(study.trials[0].trial)) < 200


def test_a_study_shows_its_answers_in_a_notebook() -> None:
    study = dataclasses.replace(made_up_study(), finding=made_up_finding(), name="<b>x</b>")
    shown = study_as_html(study)
    assert study._repr_html_() == shown
    for answer in of_study(study).questions:
        assert str(marked(answer.question)) in shown
        assert str(marked(answer.verdict)) in shown


def test_what_a_command_prints_and_writes_is_what_the_function_returns(
    tmp_path: Path, fits: Records[K92Fit]
) -> None:
    document = told("ingest", SAMPLE, "--out", tmp_path, "--jobs", 1)["trials"][0]
    found = gl.ingest(SAMPLE)
    motion = found[0].motion
    assert document["slip_ratio"] == {"value": motion.slip_ratio.value, "std": motion.slip_ratio.std}
    assert document["variant"]["velocity"] == 0.3
    table, frame = pd.read_csv(tmp_path / "virtual_v0.3_r1.csv"), found.to_frame()
    assert list(frame.columns) == ["trial", *table.columns]
    wheels = [f"{n}_{w}{s}" for w in ("fl", "fr", "rl", "rr") for n, s in
              (("v_wheel", "_mps"), ("slip", ""), ("slip", "_std"))]  # fmt: skip
    assert {*["t_s", "x_m", "x_std_m", "v_mps", "v_std_mps", "pitch_rad", "pitch_std_rad"], *wheels} <= set(
        frame.columns
    )
    assert set(frame["phase"]) == {"rest", "accelerate", "steady", "brake"}
    np.testing.assert_allclose(frame["v_mps"], table["v_mps"], rtol=1e-8, atol=1e-12)
    log = pd.read_csv(SAMPLE, comment="#")
    stamps = log.loc[log["imu_ax_mps2"].notna(), "t_s"].to_numpy()
    assert table["t_s"].to_numpy() == pytest.approx(stamps, abs=1e-9)

    document = told("simulate", "--variant", 0.5, "--k92", 0.111, "--out", tmp_path / "r.csv")
    run, table = gl.simulate(0.5, k92=0.111), pd.read_csv(document["run"])
    assert run.slip_ratio == document["slip_ratio"] == pytest.approx(0.1625, abs=0.001)
    assert list(run.to_frame()) == list(table)
    np.testing.assert_allclose(run.to_frame()["v_mps"], table["v_mps"], rtol=1e-8, atol=1e-12)
    assert table["t_s"].iloc[0] == -1
    assert not table.isna().any().any()

    columns = told("inspect", SAMPLE)["files"][0]["columns"]
    inspection = gl.inspect(SAMPLE)
    assert columns == json.loads(json.dumps(inspection.as_json()))["files"][0]["columns"]
    assert list(inspection.to_frame()["column"]) == [c["name"] for c in columns]

    document = told("fit-k92", SAMPLE, OTHER, "--jobs", 1, "--no-cache")
    assert [f["k92"]["value"] for f in document["fits"]] == [fit.k92.value for fit in fits]
    assert list(fits.to_frame()["trial"]) == ["virtual_v0.3_r1", "virtual_v0.7_r1"]
    assert list(gl.fit_a_theta(list(fits)).to_frame()["k92"]) == list(fits.to_frame()["k92"])
    assert len(fits[:1].to_frame()) == 1

    printed = told("wheel", "--slip", 0.2, "--sinkage", 12, "--k92", 0.4)
    wheel = gl.wheel(0.2, sinkage=0.012, k92=0.4)
    assert printed["points"] == [pytest.approx(row) for row in wheel.to_frame().to_dict("records")]
    assert printed["wheel"]["radius"] == 0.0965

    rows = told("params")["parameters"]
    assert list(gl.params().to_frame()["value"]) == [row["value"] for row in rows]


def test_options_count_and_those_that_do_not_fit_are_errors_of_their_kind() -> None:
    bare = gl.ingest(SAMPLE)[0].motion
    measured = gl.Estimate(bare.distance.value + 0.01, 1e-4)
    taped = gl.ingest(SAMPLE, rests=[(0.0, 1.0)], distance_measured=measured)[0].motion
    assert taped.distance.value == pytest.approx(measured.value, abs=1e-3)
    plain, with_effect = gl.simulate(0.5), gl.simulate(0.5, active={"drive_reaction": {}})
    assert "drive_reaction" in with_effect.effects
    assert with_effect.slip_ratio == pytest.approx(plain.slip_ratio, abs=1e-4)  # neutral values
    with pytest.raises(UsageError, match="one trial"):
        gl.ingest([SAMPLE, OTHER], imu=SAMPLE)
    with pytest.raises(UsageError, match="unknown effect 'drive_reactio'"):
        gl.simulate(0.5, active={"drive_reactio": {}})
    with pytest.raises(InputError, match="no recording in it"):
        gl.view(ROOT / "docs")


def test_ground_that_is_known_to_slip_little_narrows_an_estimate_without_standstill(tmp_path: Path) -> None:
    firm, log = tmp_path / "firm.toml", SAMPLES / "virtual_v0.3_r1.csv"
    sand = (ROOT / "granite_lab/catalogue/soils/dry_sand.toml").read_text(encoding="utf-8")
    stated = sand.replace('"dry_sand"', '"firm"') + "slip = 0.005\nslip_std = 0.02\n"
    firm.write_text(stated, encoding="utf-8")
    (any_slip,) = gl.ingest(log, window=(4.0, 7.0))
    (little,) = gl.ingest(log, window=(4.0, 7.0), soil=firm)
    assert np.median(little.motion.v_std) < 0.1 * np.median(any_slip.motion.v_std)
    assert little.motion.v.mean() > any_slip.motion.v.mean()
    assert any("± 2 %" in line for line in little.motion.warnings)


def test_a_table_is_stored_as_csv_or_parquet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = gl.simulate(0.3).to_frame()
    succeeded("simulate", "--variant", 0.3, "--out", tmp_path / "run.parquet")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "run.parquet"), run)
    succeeded("simulate", "--variant", 0.3, "--format", "parquet", "--out", tmp_path / "named")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "named"), run)
    assert not list(tmp_path.glob("*.part"))
    simulate = ("simulate", "--variant", 0.3, "--format")
    real = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "pyarrow" else real(name, *a)
    )
    done = lab(*simulate, "parquet", "--out", tmp_path / "not.parquet")
    refused(done, 1, "Parquet needs pyarrow, which is not installed", "pip install 'granite-lab[parquet]'")
    assert not (tmp_path / "not.parquet").exists()


@pytest.mark.usefixtures("one_picture")
def test_a_study_writes_only_where_it_is_told_and_keeps_failures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    broken = tmp_path / "broken.csv"
    broken.write_text("t_s,imu_ax_mps2\n0,1\n")
    result = gl.study([SAMPLE, broken], discover=False)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["broken.csv"]
    assert [failure.trial for failure in result.failures] == ["broken"]
    frame = result.to_frame()
    assert list(frame["trial"]) == ["virtual_v0.3_r1"]
    assert frame["k92"].iloc[0] == result.trials[0].fit.k92.value
    assert gl.report(result, tmp_path / "out").is_file()
    recordings = gl.record(result, tmp_path / "rec")
    assert [path.name for path in recordings] == ["virtual_v0.3_r1.rrd"]
    with pytest.raises((InputError, EstimateError)):
        gl.study([broken], discover=False)


def test_effects_and_answers_are_tables() -> None:
    effects = gl.list_effects().to_frame()
    shown = gl.show_effect("tyre_windup").to_frame()
    assert set(shown["parameter"]) == set(effects.loc[effects["effect"] == "tyre_windup", "parameter"])
    opened = gl.reveal(SAMPLES)
    assert set(opened.to_frame()["effect"]) == {"tyre_windup", "drive_reaction"}
    assert opened.warnings == ()


def test_discover_takes_the_command_s_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search itself is tested elsewhere; here, that both hand it the same."""
    calls = []

    def search(trials: Any, options: Any, **rest: Any) -> Finding:
        calls.append(([trial.name for trial in trials], options, len(rest["motions"])))
        raise EstimateError("enough")

    monkeypatch.setattr("granite_lab.api.trials.find_effect", search)
    with pytest.raises(EstimateError, match="enough"):
        gl.discover([SAMPLE, OTHER], robot="granite", tolerance=0.05, latency=0.03)
    names, options, motions = calls[0]
    assert (names, motions) == (["virtual_v0.3_r1", "virtual_v0.7_r1"], 2)
    assert (options.robot, options.tolerance, options.latency) == ("granite", 0.05, 0.03)


def test_a_file_that_was_edited_meanwhile_is_read_again(tmp_path: Path) -> None:
    """As one does in a long session at the keyboard."""
    own = tmp_path / "mine.toml"
    text = (ROOT / "granite_lab/catalogue/robots/granite.toml").read_text(encoding="utf-8")
    slips = []
    for mass in ("36.54", "60.0"):
        own.write_text(text.replace("body_mass_kg = 36.54", f"body_mass_kg = {mass}"), encoding="utf-8")
        slips.append(gl.simulate(0.3, robot=own).slip_ratio)
        frame = gl.params(own).to_frame()
        assert frame.loc[frame["key"] == "body_mass_kg", "value"].iloc[0] == float(mass)
    assert abs(slips[1] - slips[0]) > 1e-3


SCRIPT = str(ROOT / "examples" / "trial_to_report.py")
BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "api.md").read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")


@pytest.mark.usefixtures("elsewhere", "one_picture")
@pytest.mark.parametrize("block", BLOCKS)
def test_a_block_of_the_page_runs(block: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("data").symlink_to(ROOT / "data")
    exec(block, {"__name__": "__main__"})
    assert capsys.readouterr().out


@pytest.mark.usefixtures("elsewhere", "one_picture")
def test_the_example_script_goes_from_logs_to_a_report(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = [str(SAMPLES / f"virtual_{name}.csv") for name in ("v0.3_r1", "v0.7_r1")]
    monkeypatch.setattr("sys.argv", [SCRIPT, *logs])
    runpy.run_path(SCRIPT, run_name="__main__")
    said = capsys.readouterr()
    assert Path("reports/example/report/index.html").is_file()
    assert Path("reports/example/motion.csv").stat().st_size > 100_000
    assert "a_θ = " in said.out
    assert "virtual_v0.3_r1: slip ratio" in said.out
    assert said.err == ""
    made = runpy.run_path(SCRIPT)["virtual_trials"](Path())  # what it does without logs
    assert len(made) == 4
    assert len(gl.check(made[0])) == 1
    monkeypatch.setattr("sys.argv", [SCRIPT, "none.csv"])
    with pytest.raises(SystemExit, match=r"^error: [^\n]+\nhint: [^\n]+$"):
        runpy.run_path(SCRIPT, run_name="__main__")
