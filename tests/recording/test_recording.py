"""Recordings hold what they were made from and what a search found, read back with rerun's own reader."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest

from granite_lab.comparison.compare import Comparison
from granite_lab.discovery.finding import Finding
from granite_lab.errors import LabError
from granite_lab.logs.trial import Series
from granite_lab.parameters import WHEELS
from granite_lab.reporting.recording import record_trial
from granite_lab.reporting.recording import write as write_module
from granite_lab.reporting.recording.lines import MOST_ROWS, Line
from granite_lab.reporting.recording.scene import FORCE_SCALE
from granite_lab.reporting.recording.stream import drawable
from tests.recording.read_back import ReadBack, verify
from tests.reporting.made_up import ORIGIN, made_up_trial
from tests.reporting.made_up_finding import BUMP, CHANNELS, START, made_up_finding
from tests.soak import sampled

NANOSECOND = 0.6e-9
DEGREE = 180 / np.pi


def test_reruns_verifier_accepts_one_timeline_over_the_log(
    trial: Comparison, path: Path, back: ReadBack
) -> None:
    assert "1 file verified" in verify(path)
    assert [index.name for index in back.schema.index_columns()] == ["time"]
    assert back.fixed("/__properties", "RecordingInfo:name") == [trial.trial.name]
    t = np.concatenate([back.t(entity) for entity in back.batches])
    one = trial.trial
    logged = np.concatenate([s.t for s in (one.imu, one.wheels, one.currents)]) - ORIGIN
    assert (t.min(), t.max()) == pytest.approx((logged.min(), logged.max()), abs=1e-9)


def test_lines_and_bands_are_those_of_estimate_and_run(trial: Comparison, back: ReadBack) -> None:
    motion, run, c = trial.motion, trial.run, trial
    pairs = {k: np.column_stack([c.simulated[f"{k}_f"], c.simulated[f"{k}_r"]]) for k in ("torque", "slip")}
    torque = pairs["torque"] - np.column_stack([c.measured["torque_f"], c.measured["torque_r"]])
    for entity, clock, expected in (
        ("velocity/measured", c.t, motion.v),
        ("pitch/measured", c.t, DEGREE * c.measured["pitch"]),
        ("wheel_speed/measured_rl", c.t, motion.v_wheel[:, 2]),
        ("slip_of_each_wheel/measured", c.t, 100 * motion.slip),
        ("velocity/desired", run.t, run["v_desired_mps"]),
        ("velocity/from_model", c.t, c.simulated["velocity"]),
        ("pitch/from_model", c.t, DEGREE * c.simulated["pitch"]),
        ("torque/from_model", c.t, pairs["torque"]),
        ("slip/from_model", c.t, 100 * pairs["slip"]),
        (
            "difference_velocity/simulated_minus_measured",
            c.t,
            c.simulated["velocity"] - c.measured["velocity"],
        ),
        ("difference_torque/simulated_minus_measured", c.t, torque),
    ):
        t = back.t(f"/{entity}")
        assert np.diff(t).max() < 0.021
        rows = np.searchsorted(clock, t - 1e-6)
        np.testing.assert_allclose(clock[rows], t, atol=NANOSECOND)
        np.testing.assert_allclose(back.scalars(f"/{entity}"), expected[rows], rtol=1e-12, atol=1e-15)
    for entity, std in (("/velocity/measured", motion.v_std), ("/pitch/measured", DEGREE * motion.pitch_std)):
        variance = back.values(entity, "Measurements:variances")[:, 0].astype(float)
        np.testing.assert_allclose(np.sqrt(variance), std[::2])


def test_slip_has_gaps_at_rest_and_nothing_else_has(trial: Comparison, back: ReadBack) -> None:
    t, slip = back.t("/slip_of_each_wheel/measured"), back.scalars("/slip_of_each_wheel/measured")
    assert np.isfinite(slip[(t > 0.2) & (t < trial.run.steady[1])]).all()
    assert np.isnan(slip[t < 0]).all()
    for entity in back.batches:
        if "slip" in entity or "Measurements:values" not in back.batches[entity][0].schema.names:
            continue
        ends = slice(5, -5)  # where a mean over half of the width has no samples
        assert np.isfinite(back.scalars(entity)[ends]).all(), entity


def test_measured_lines_are_drawn_over_simulated_ones(back: ReadBack) -> None:
    """Rerun draws what is of one kind in the order of its entities."""
    plots: dict[str, list[str]] = {}
    for entity in back.static:
        if "Measurements:widths" in back.static[entity][0].schema.names:
            plots.setdefault(entity.split("/")[1], []).append(entity)
    both = [entities for entities in plots.values() if len(entities) > 1]
    assert len(both) >= 5
    for entities in both:
        ghosts = [entity for entity in entities if entity.endswith("/from_model")]
        measured = [entity for entity in entities if "/measured" in entity]
        assert max(ghosts) < min(measured)
        thickest = max(w for entity in measured for w in back.fixed(entity, "Measurements:widths"))
        assert min(w for entity in ghosts for w in back.fixed(entity, "Measurements:widths")) > thickest


def test_innovations_are_dots_in_units_of_their_std(trial: Comparison, back: ReadBack) -> None:
    health = trial.motion.health
    own = np.array(health.kind) == "zero_velocity"
    expected = (health.innovation / health.innovation_std)[own]
    every = round(0.04 * (own.sum() - 1) / np.ptp(health.t[own])) or 1
    np.testing.assert_array_equal(back.scalars("/innovation/zero_velocity"), expected[::every])
    assert back.fixed("/innovation/zero_velocity", "SeriesPoints:names") == ["zero velocity [σ]"]


def test_every_line_names_its_unit(back: ReadBack) -> None:
    lines = [e for e in back.static if "Measurements:units" in back.static[e][0].schema.names]
    units = {e: back.fixed(e, "Measurements:units") for e in lines}
    assert len(lines) > 20
    for entity, own in units.items():
        assert len(own) == len(back.fixed(entity, "Measurements:names"))
        assert set(own) <= {"m/s", "%", "N m", "°", "°/s", "m/s²", "A"}, entity
    assert units["/slip/measured_front"] == ["%"]
    assert units["/pitch/measured"] == ["°"]
    assert units["/pitch_rate/measured"] == ["°/s"]


def test_the_measured_robot_and_its_wheels_are_as_estimated(trial: Comparison, back: ReadBack) -> None:
    c = trial
    t = back.t("/scene/measured")
    x, y, z = back.values("/scene/measured", "Transform3D:translation")[:, 0].T
    start = np.interp(0.0, c.t, c.motion.x)
    np.testing.assert_allclose(x, np.interp(t, c.t, c.motion.x) - start, atol=1e-6)
    assert (y == 0).all()
    sinkage = np.interp(t, c.run.t, (c.run["sinkage_f_m"] + c.run["sinkage_r_m"]) / 2)
    np.testing.assert_allclose(0.0965 - z, sinkage, atol=1e-6)
    qx, qy, qz, qw = back.values("/scene/measured", "Transform3D:quaternion")[:, 0].T
    np.testing.assert_allclose(2 * np.arctan2(qy, qw), np.interp(t, c.t, c.motion.pitch), atol=1e-6)
    assert not qx.any()
    assert not qz.any()
    _, qy, _, qw = back.values("/scene/measured/rl/tyre", "Transform3D:quaternion")[:, 0].T
    angle = np.unwrap(2 * np.arctan2(qy, qw))
    travelled = np.trapezoid(c.motion.v_wheel[:, WHEELS.index("rl")], c.t)
    assert angle[-1] - angle[0] == pytest.approx(travelled / 0.0965, abs=5e-3)


def test_the_ghost_is_where_the_simulation_says(trial: Comparison, back: ReadBack) -> None:
    run = trial.run
    t = back.t("/scene/simulated")
    inside = (t > run.t[0]) & (t < run.t[-1])
    x = back.values("/scene/simulated", "Transform3D:translation")[:, 0, 0]
    start = np.interp(0.0, run.t, run["x_m"])
    np.testing.assert_allclose(x[inside], np.interp(t[inside], run.t, run["x_m"]) - start, atol=1e-6)
    outline, solid = (back.fixed(f"/scene/{k}/body", "Boxes3D:fill_mode") for k in ("simulated", "measured"))
    assert outline != solid  # an outline hides nothing
    assert "Cylinders3D:radii" not in back.static["/scene/simulated/fr/tyre"][0].schema.names


def test_ground_forces_are_the_simulations_at_the_near_wheels(trial: Comparison, back: ReadBack) -> None:
    run = trial.run
    entity = "/scene/force_ground_reaction"
    t = back.t(entity)
    k = int(np.argmin(np.abs(t - 3.0)))
    vectors = back.values(entity, "Arrows3D:vectors")[k] / FORCE_SCALE
    for row, axle in enumerate("fr"):
        expected = [np.interp(t[k], run.t, run[f"force_{i}_{axle}_N"]) for i in "xz"]
        np.testing.assert_allclose(vectors[row][[0, 2]], expected, atol=1e-3)
    origins = back.values(entity, "Arrows3D:origins")[k]
    assert (origins[:, 1] < -(0.59 + 0.128) / 2).all()  # in front of the right wheels
    assert origins[0, 0] - origins[1, 0] == pytest.approx(0.425, abs=1e-3)
    sinkage = [np.interp(t[k], run.t, run[f"sinkage_{axle}_m"]) for axle in "fr"]
    np.testing.assert_allclose(-origins[:, 2], sinkage, atol=3e-3)


def test_the_wheel_is_as_large_as_its_parameters_say(back: ReadBack) -> None:
    tyre = "/scene/measured/fr/tyre"
    assert max(back.fixed(tyre, "Cylinders3D:radii")) == pytest.approx(0.0965, rel=0.02)
    assert back.fixed(tyre, "Cylinders3D:lengths")[0] == pytest.approx(0.128)
    reach = np.array(back.fixed(tyre, "Boxes3D:centers"))
    half = np.array(back.fixed(tyre, "Boxes3D:half_sizes"))
    assert (np.linalg.norm(reach, axis=1) + half[:, 2]).max() == pytest.approx(0.0965)
    ring = np.array(back.fixed("/scene/simulated/fr/tyre", "LineStrips3D:strips")[0])
    np.testing.assert_allclose(np.linalg.norm(ring[:, [0, 2]], axis=1), 0.0965, rtol=1e-6)


def _sand(back: ReadBack) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest corner of the sand."""
    middle, half = (np.array(back.fixed("/scene/sand", f"Boxes3D:{k}")) for k in ("centers", "half_sizes"))
    return (middle - half).min(axis=0), (middle + half).max(axis=0)


def test_the_sand_is_cut_away_behind_the_near_wheels(back: ReadBack) -> None:
    low, high = _sand(back)
    inner_face, outer_face = -(0.59 - 0.128) / 2, (0.59 + 0.128) / 2
    assert inner_face < low[1] < inner_face + 0.02  # shows the near wheels whole
    assert high[1] > outer_face  # carries the far ones
    assert high[2] == pytest.approx(0.0, abs=1e-6)
    assert low[2] < -0.03


def test_there_is_sand_under_a_robot_that_drives_backward_or_far(trial: Comparison, tmp_path: Path) -> None:
    c = trial
    for factor in (-1.0, 300.0):
        x = factor * c.motion.x
        moved = dataclasses.replace(c, motion=dataclasses.replace(c.motion, x=x))
        back = ReadBack(record_trial(moved, tmp_path / "a.rrd"))
        low, high = _sand(back)
        robot = back.values("/scene/measured", "Transform3D:translation")[:, 0, 0]
        assert low[0] < robot.min() - 0.425 / 2
        assert high[0] > robot.max() + 0.425 / 2
        assert 2 < len(back.fixed("/scene/sand/distance", "LineStrips3D:strips")) < 120


def test_nothing_in_the_scene_is_not_a_number(back: ReadBack) -> None:
    batches = [b for entity in back.batches if "/scene" in entity for b in back.batches[entity]]
    assert batches
    for batch in batches:
        for name in (name for name in batch.schema.names if ":" in name):
            values = json.dumps(batch.column(name).to_pylist())
            assert not {"NaN", "Infinity", "-Infinity"} & set(re.findall(r"-?[A-Z]\w+", values)), name


def test_phases_are_the_motions(trial: Comparison, back: ReadBack) -> None:
    states = back.texts("/phase", "StateChange:state")
    assert states == ["rest", "accelerate", "steady", "brake", "rest"]
    motion = trial.motion
    changes = [0, *(i for i in range(1, len(motion.t)) if motion.phase[i] != motion.phase[i - 1])]
    np.testing.assert_allclose(back.t("/phase"), motion.t[changes] - ORIGIN, atol=NANOSECOND)


def test_the_log_tells_what_the_filter_did(trial: Comparison, back: ReadBack) -> None:
    t, lines = back.t("/events"), back.texts("/events", "TextLog:text")
    levels = dict(zip(lines, back.texts("/events", "TextLog:level"), strict=True))
    assert (np.diff(t) >= 0).all()
    text = "\n".join(lines)
    assert "virtual trial" in text
    assert text.count("zero-velocity updates") == text.count("zero-rate updates") == 2
    assert [levels[line] for line in lines if "duplicate stamps" in line] == ["WARN"]
    health = trial.motion.health
    first = sum(
        k == "zero_velocity" and t <= health.rests[0][1] for k, t in zip(health.kind, health.t, strict=True)
    )
    assert f"zero-velocity updates: {first}, until -0.0" in text


def test_updates_far_outside_their_std_are_named(trial: Comparison, tmp_path: Path) -> None:
    health = trial.motion.health
    innovation = health.innovation.copy()
    innovation[10] = 7.0 * health.innovation_std[10]
    motion = dataclasses.replace(trial.motion, health=dataclasses.replace(health, innovation=innovation))
    comparison = dataclasses.replace(trial, motion=motion)
    back = ReadBack(record_trial(comparison, tmp_path / "a.rrd"))
    bad = [line for line in back.texts("/events", "TextLog:text") if "times its std off" in line]
    assert len(bad) == 1
    assert "7.0 times" in bad[0]


@pytest.mark.parametrize("virtual", [True, False])
def test_the_key_stands_beside_the_robot_and_says_what_is_virtual(tmp_path: Path, virtual: bool) -> None:
    result = made_up_trial(0.7, virtual=virtual)
    back = ReadBack(record_trial(result, tmp_path / "a.rrd"))
    (text,) = back.fixed("/key", "TextDocument:text")
    assert text.startswith("**Virtual data**") == virtual
    for word in ("orange outline", "magenta arrow", "22 mm for 10 N", "0 s"):
        assert word in text


def test_it_opens_paused_on_its_timeline_with_a_layout(path: Path) -> None:
    reader = ReadBack(path).reader
    (store,) = reader.blueprints()
    found: dict[str, object] = {}
    views = 0
    for chunk in reader.stream(store=store):
        batch = chunk.to_record_batch()
        if str(chunk.entity_path) == "/time_panel":
            found |= {n: batch.column(n).to_pylist()[0] for n in batch.schema.names if "TimePanel" in n}
        views += "ViewBlueprint:class_identifier" in batch.schema.names
    assert found["TimePanelBlueprint:timeline"] == ["time"]
    assert found["TimePanelBlueprint:play_state"] == [1]  # paused
    assert views > 15


def test_a_trial_without_imu_and_with_one_encoder_can_be_recorded(trial: Comparison, tmp_path: Path) -> None:
    c = trial
    v_wheel = c.motion.v_wheel.copy()
    v_wheel[:, 1:] = np.nan
    motion = dataclasses.replace(c.motion, v_wheel=v_wheel, pitch=np.full_like(c.t, np.nan))
    bare = dataclasses.replace(trial.trial, imu=None, currents=None, command=None)
    measured = c.measured | dict.fromkeys(("pitch", "torque_f", "torque_r"), np.full_like(c.t, np.nan))
    one = dataclasses.replace(c, trial=bare, motion=motion, measured=measured)
    path = record_trial(one, tmp_path / "a.rrd")
    back = ReadBack(path)
    np.testing.assert_array_equal(back.scalars("/velocity/wheels"), v_wheel[::2, 0])
    assert "/pitch/measured" not in back.entities()
    torque = {e for e in back.entities() if e.startswith(("/torque", "/motor_current", "/difference_torque"))}
    assert torque == {"/torque/from_model"}
    assert np.isfinite(back.values("/scene/measured", "Transform3D:quaternion")).all()
    assert "1 file verified" in verify(path)


HOSTILE = ("../../etc", "a/b\\c", "grüße ∂x", "__properties", " ", "[x]|`*`", "a" * 300, "tab\tand\nnewline")


def test_a_hostile_name_stays_a_name(tmp_path: Path) -> None:
    names, paths = sampled(HOSTILE, 3), []
    for k, name in enumerate(names):
        one = made_up_trial(0.7, name=name)
        paths.append(record_trial(one, tmp_path / f"{k}.rrd"))
        back = ReadBack(paths[-1])
        assert back.fixed("/__properties", "RecordingInfo:name") == [drawable(name)]
        np.testing.assert_array_equal(back.scalars("/velocity/measured"), one.motion.v[::2])
    assert f"{len(names)} files verified" in verify(*paths)


def test_a_line_without_samples_is_left_out(trial: Comparison, tmp_path: Path) -> None:
    """A reference may end before the part of the log that is used begins."""
    nothing = np.zeros(0)
    currents = dataclasses.replace(trial.trial.currents, t=nothing, current=np.zeros((0, 4)))
    bare = dataclasses.replace(trial.trial, reference_v=Series(nothing, nothing), currents=currents)
    back = ReadBack(record_trial(dataclasses.replace(trial, trial=bare), tmp_path / "trial.rrd"))
    assert "/velocity/measured" in back.entities()
    assert not {"/velocity/reference", "/motor_current/measured"} & back.entities()


def test_a_recording_that_fails_leaves_the_old_file_and_nothing_else(
    trial: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.rrd"
    path.write_bytes(b"old")
    with pytest.raises(LabError, match=re.escape(str(path / "b.rrd"))):
        record_trial(trial, path / "b.rrd")

    def fail(*_: object) -> None:
        raise RuntimeError("half way")

    monkeypatch.setattr(write_module, "write_scene", fail)
    with pytest.raises(RuntimeError, match="half way"):
        record_trial(trial, path)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.rrd"]


def test_an_hour_is_thinned_so_that_it_still_opens() -> None:
    t = np.arange(0, 3600, 0.005)
    line = Line("velocity/measured", ("measured",), "m/s", t, np.sin(t), ((0, 0, 0),)).shown()
    assert len(line.t) <= MOST_ROWS
    np.testing.assert_array_equal(line.value, np.sin(line.t))
    assert line.t[-1] > 3590


LATE = START - 102.0
"""The search starts the command so much later than the comparison [s]."""


def test_disagreements_are_bars_on_the_trials_own_clock(trial: Comparison, searched: ReadBack) -> None:
    lane = "/simulation_differs/pitch_rate"
    assert searched.texts(lane, "StateChange:state") == ["none", "35", "none"]
    np.testing.assert_allclose(
        searched.t(lane), [trial.t[0], BUMP[0] + LATE, BUMP[1] + LATE], atol=NANOSECOND
    )
    colours = searched.fixed(lane, "StateConfiguration:colors")
    assert colours[0] != colours[1]
    # at another speed the currents differ, too
    assert not [e for e in searched.entities() if "motor" in e and "simulation_differs" in e]


def test_bars_that_overlap_become_one_and_stay_in_the_log(
    trial: Comparison, finding: Finding, tmp_path: Path
) -> None:
    one = next(d for d in finding.where if d.variant == 0.3)
    where = [
        dataclasses.replace(one, start=start - LATE, end=end - LATE, share=share)
        for start, end, share in ((2.0, 4.0, 0.2), (3.0, 5.0, 0.4), (50.0, 60.0, 0.6))
    ]
    found = dataclasses.replace(finding, where=tuple(where))
    path = record_trial(trial, tmp_path / "a.rrd", finding=found)
    back, lane = ReadBack(path), "/simulation_differs/pitch_rate"
    assert back.texts(lane, "StateChange:state") == ["none", "40", "none"]
    np.testing.assert_allclose(back.t(lane), [trial.t[0], 2.0, 5.0], atol=NANOSECOND)
    values, visible = (back.fixed(lane, f"StateConfiguration:{k}") for k in ("values", "visible"))
    assert dict(zip(values, visible, strict=True)) == {"none": False, "40": True}


def test_simulations_before_and_after_stand_beside_what_was_measured(
    trial: Comparison, finding: Finding, searched: ReadBack
) -> None:
    own = {r.channel: r for r in finding.residuals if r.trial == trial.trial.name}
    assert set(own) == set(CHANNELS)
    r = own["pitch_rate"]
    np.testing.assert_allclose(searched.scalars("/fitted_pitch_rate/measured"), DEGREE * r.measured)
    model = searched.scalars("/fitted_pitch_rate/from_model")
    np.testing.assert_allclose(model, DEGREE * np.column_stack([r.before, r.after]))
    np.testing.assert_allclose(searched.t("/fitted_pitch_rate/from_model"), r.t + LATE, atol=NANOSECOND)
    names = searched.fixed("/fitted_pitch_rate/from_model", "Measurements:names")
    assert names == ["without the effect", "with the effect"]
    assert np.isnan(searched.scalars("/fitted_forward_acceleration/measured")[42])  # a gap in the log
    assert np.isfinite(searched.scalars("/fitted_forward_acceleration/from_model")[42]).all()
    r = own["wheel"]
    np.testing.assert_allclose(
        searched.scalars("/fitted_mean_wheel_angle/from_model"),
        DEGREE * np.column_stack([r.measured - r.before, r.measured - r.after]),
    )


def test_log_lines_name_what_is_missing_and_where(searched: ReadBack) -> None:
    lines = searched.texts("/events", "TextLog:text")
    (missing,) = [line for line in lines if "missing from the model" in line]
    assert "ear wheels in the compacted rut (pressure 0.300 ± 0.004" in missing
    (where,) = [line for line in lines if "% of its rms" in line]
    assert (
        "simulated pitch rate differs from the measured one by up to 35 % of its rms, 0.53 s to 1.53 s"
        in where
    )
    assert [line for line in lines if "IMU stamps 4.0 ± 1.0\u00a0ms behind those of wheels" in line]
    levels = dict(zip(lines, searched.texts("/events", "TextLog:level"), strict=True))
    assert levels[missing] == "WARN"
    assert levels[where] == "WARN"


def test_nothing_found_and_not_searched_are_said(trial: Comparison, tmp_path: Path) -> None:
    path = record_trial(trial, tmp_path / "a.rrd", finding=made_up_finding("none"))
    back = ReadBack(path)
    assert not [e for e in back.entities() if "simulation_differs" in e]
    assert "Nothing that these trials show" in "\n".join(back.texts("/events", "TextLog:text"))
    assert back.scalars("/fitted_pitch_rate/from_model").ndim == 1
    assert back.fixed("/fitted_pitch_rate/from_model", "Measurements:names") == ["simulated"]
    # a trial that was left out of the search
    left_out = ((trial.trial.name, "no model fits it"),)
    others = dataclasses.replace(made_up_finding(names="another_{speed}_{repetition}"), dropped=left_out)
    back = ReadBack(record_trial(trial, tmp_path / "b.rrd", finding=others))
    assert not [e for e in back.entities() if "fitted_" in e or "simulation_differs" in e]
    said = "\n".join(back.texts("/events", "TextLog:text"))
    assert "left out of the search: no model fits it" in said


def test_the_recording_of_the_longest_trial_takes_less_than_two_megabytes(
    finding: Finding, tmp_path: Path
) -> None:
    result = made_up_trial(0.3)  # the longest of Table 2
    path = record_trial(result, tmp_path / "a.rrd", finding=finding)
    assert path.stat().st_size <= 2_000_000
