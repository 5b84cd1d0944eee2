"""What is planned for a search: from its record over the file and the question to the table."""

import io
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from scipy.signal import lfilter

import granite_lab as gl
from granite_lab.discovery.finding import DESIGN, Finding, Residual
from granite_lab.effects import library
from granite_lab.errors import InputError
from granite_lab.inference.conditions import PLAIN, Conditions
from granite_lab.inference.noise import FLOOR
from granite_lab.inference.observation import CHANNELS
from granite_lab.logs.trial import Trial, TrialInfo
from granite_lab.model.command import duration, peak_velocity, phase_of
from granite_lab.parameters import Variant, load_robot, load_soil, load_variants, variant_of
from granite_lab.planning.design import (
    Design,
    Driven,
    NamedEffect,
    NamedNumber,
    Noise,
    commanded_share,
    load_design,
    save_design,
)
from granite_lab.planning.plan import candidate_trials, plan_next
from granite_lab.planning.stage import question, trial_model, whitener_of
from granite_lab.reporting.terminal import show_plan
from tests.corpus.cli import lab, refused, told
from tests.reporting.made_up_finding import made_up_finding
from tests.soak import sampled

ROBOT, SOIL = load_robot(), load_soil()
SLOW = Variant(velocity=0.2, acceleration=0.6, distance=0.6)
LEVEL = {"accel_x": 0.05, "accel_z": 0.07, "pitch_rate": 3e-3, "wheel": 1e-3, "wheel_split": 3e-4}


def driven_of(variant: Variant = SLOW, **told: Any) -> Driven:
    noise = tuple(Noise(channel=c, rest=LEVEL.get(c, 0.05)) for c in CHANNELS if c != "current_side")
    return Driven(**{"variant": variant, "noise": noise, **told})


def design_of(*driven: Driven, **told: Any) -> Design:
    fields = {"verdict": "none", "robot": ROBOT, "soil": SOIL, "share": 0.02, "driven": driven}
    return Design(**(fields | told))


def trials_of(finding: Finding) -> list[Trial]:
    """Logs that say what was commanded by their velocity, as in Table 2."""
    speeds = {r.trial: r.variant for r in finding.residuals}
    return [Trial(name, TrialInfo(v_desired=v)) for name, v in speeds.items()]


def commanded(trials: list[Trial]) -> list[tuple[Trial, Variant]]:
    return [(t, variant_of(t.info.v_desired or math.nan)) for t in trials]


def saved(finding: Finding, path: Path, trials: list[Trial] | None = None) -> Design:
    save_design(finding, commanded(trials_of(finding) if trials is None else trials), path)
    return load_design(path)


def test_what_a_search_found_survives_the_file(tmp_path: Path) -> None:
    finding = made_up_finding("named", twins=("com_offset",))
    design = saved(finding, tmp_path / DESIGN)
    assert design.verdict == "named"
    assert design.named == (
        NamedEffect(id="multi_pass", values=finding.active[0].values, twins=("com_offset",)),
    )
    assert design.robot == ROBOT
    assert design.soil == SOIL
    assert design.sand[0] == finding.sand["a_theta"].value
    assert design.latency == 0.004
    assert design.share == finding.tolerance > finding.discrepancy
    assert saved(replace(finding, discrepancy=0.07), tmp_path / "other.json").share == 0.07
    assert {s.name: s.value for s in design.scales} == finding.scales
    assert design.possible[0].name == "com_offset"
    assert {d.variant for d in design.driven} == set(load_variants())
    assert all(d.count == 3 for d in design.driven)
    assert design.driven[0].before == pytest.approx(0.49)
    assert design.driven[0].after == pytest.approx(1.5, abs=0.02)


def test_trials_of_one_command_under_other_conditions_are_another_command(tmp_path: Path) -> None:
    finding = made_up_finding("named", speeds=(0.5,), repetitions=2)
    first, second = trials_of(finding)
    turned = replace(second, info=replace(second.info, extra={"turned": "true"}))
    design = saved(finding, tmp_path / DESIGN, [first, turned])
    assert {d.conditions for d in design.driven} == {PLAIN, Conditions(turned=True)}


def test_without_a_command_nothing_is_written(tmp_path: Path) -> None:
    save_design(made_up_finding("named"), [], tmp_path / DESIGN)
    assert not (tmp_path / DESIGN).exists()


def shaken_finding(rng: np.random.Generator) -> tuple[Finding, Variant]:
    """Residuals of one command: white noise at rest, and a vibration while driving."""
    command = next(v for v in load_variants() if v.velocity == 0.5)
    t = np.arange(-0.49, duration(command) + 1.5, 0.02)
    share = commanded_share(t, command)
    rows = []
    for k in range(8):
        shaken = lfilter([0.1], [1.0, -0.7], rng.normal(size=t.size + 200))[200:]
        noise = 0.02 * rng.normal(size=t.size) + share * shaken
        zero = np.zeros(t.size)
        rows.append(
            Residual(f"r{k}", "accel_x", "m/s^2", 0.5, 0, t, 2.0, tuple(phase_of(t, command)),
                     noise, zero, zero, zero, zero, zero, 1.0)
        )  # fmt: skip
    return replace(made_up_finding("none"), residuals=tuple(rows)), command


def test_noise_of_a_trial_to_come_is_that_of_those_driven_and_grows_with_speed(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    finding, command = shaken_finding(rng)
    design = saved(finding, tmp_path / DESIGN)
    (noise,) = design.driven[0].noise
    assert noise.rest == pytest.approx(0.02, rel=0.15)
    for speed in (0.5, 0.25):
        faster = Variant(velocity=speed, acceleration=1.2, distance=2.5)
        observation = trial_model(0, faster, design.driven[0], design.robot, design.width).observation
        whiten = whitener_of(noise, observation, peak_velocity(command))
        share = commanded_share(observation.t, faster) * speed / 0.5
        n = observation.bins
        fresh = [
            0.02 * rng.normal(size=n) + share * lfilter([0.1], [1.0, -0.7], rng.normal(size=n + 200))[200:]
            for _ in range(40)
        ]
        white = np.array([whiten(f) for f in fresh])
        moving = share > 0.9 * share.max()
        assert np.std(white[:, :24]) == pytest.approx(1, abs=0.15)
        assert np.std(white[:, moving]) == pytest.approx(1, abs=0.15)
        slow = white[:, moving].sum(axis=1) / np.sqrt(moving.sum())
        assert 0.6 < np.std(slow) < 1.5


@pytest.mark.parametrize("repetitions", sampled([3, 1]))
def test_logs_that_begin_driving_and_end_soon_give_a_plan(tmp_path: Path, repetitions: int) -> None:
    """No standstill, 0.4 s after the stop, no currents, gaps."""
    whole = made_up_finding(
        "named", speeds=(0.2,), repetitions=repetitions, channels=("accel_x", "accel_z", "wheel")
    )
    end = duration(load_variants()[0]) + 0.4
    cut = []
    for r in whole.residuals:
        measured = np.where((r.t > 0.1) & (r.t < end), r.measured, np.nan)
        cut.append(replace(r, measured=measured))
    design = saved(replace(whole, residuals=tuple(cut)), tmp_path / DESIGN)
    (driven,) = design.driven
    assert driven.before < 0
    assert driven.after == pytest.approx(0.4, abs=0.03)
    assert all(np.isfinite(n.rest) and n.rest > 0 for n in driven.noise)
    plan = plan_next(design, library(), max_speed=0.21)
    assert plan.proposals
    assert all(np.isfinite(list(p.after.values())).all() for p in plan.proposals)


NAMED = NamedEffect(id="ground_slope", values=(0.7,), twins=("imu_tilt",))
ALONE = replace(NAMED, twins=())
SURE = NamedEffect(id="drive_reaction", values=(0.8,))
OTHERS = tuple(NamedNumber(name=n, value=v) for n, v in (("tyre_windup", 9.0), ("bulldozing", -1.0)))


@pytest.mark.parametrize(
    ("told", "kind", "rivals"),
    [
        ({"verdict": "named", "named": (SURE, NAMED)}, "apart", ("ground_slope", "imu_tilt")),
        ({"verdict": "named", "named": (SURE, ALONE)}, "sharpen", ()),
        ({"verdict": "named", "named": (SURE, ALONE), "provisional": ("one speed",)},
         "apart", ("ground_slope", "tyre_windup", "bulldozing")),
        ({"verdict": "unknown"}, "apart", ("tyre_windup", "bulldozing")),
        ({"verdict": "none", "provisional": ("one speed",)}, "show", ("bulldozing",)),
        ({"verdict": "none"}, "sharpen", ()),
    ],
)  # fmt: skip
def test_what_is_known_worst_is_asked_first(told: dict[str, Any], kind: str, rivals: tuple[str, ...]) -> None:
    found = question(design_of(driven_of(), possible=OTHERS, **told), library())
    assert found.kind == kind
    assert found.rivals == rivals


def test_an_effect_that_is_not_known_or_has_changed_is_refused() -> None:
    changed = design_of(driven_of(), verdict="named", named=(replace(SURE, values=(0.8, 1.0)),))
    with pytest.raises(InputError, match="another version"):
        question(changed, library())
    with pytest.raises(gl.LabError, match="mine"):
        question(design_of(driven_of(), named=(replace(SURE, id="mine"),)), library())


def test_the_strength_with_the_largest_relative_std_is_sharpened() -> None:
    weak, strong = (
        NamedEffect(id="drive_reaction", values=(0.05,)),
        NamedEffect(id="com_offset", values=(0.05,)),
    )
    plan = plan_next(design_of(driven_of(), verdict="named", named=(weak, strong)), library(), max_speed=0.2)
    assert list(plan.now) == ["drive_reaction.share"]


def test_proposals_stay_within_room_speed_and_what_the_robot_can_do() -> None:
    design = design_of(*(driven_of(v) for v in load_variants()))
    found = candidate_trials(design, ["ground_slope", "multi_pass"], room=2.0, max_speed=0.4)
    for o in found:
        assert o.variant.distance <= 2.0
        assert peak_velocity(o.variant) <= 0.4 * (1 + 1e-9)
        assert o.why
        assert o.how
    assert len({(o.variant, o.conditions) for o in found}) == len(found)
    assert {o.variant for o in found if o.repeats} == {v for v in load_variants() if v.velocity <= 0.3}
    drive = ROBOT.drive
    free = drive.voltage_max / (drive.emf_constant * drive.gear_ratio) * ROBOT.wheels.radius
    near = Variant(velocity=round(0.75 * free, 2), acceleration=2.4, distance=20.0)
    fastest = max(o.variant.velocity for o in candidate_trials(design_of(driven_of(near)), []))
    assert near.velocity < fastest <= 0.8 * free


def test_a_condition_that_was_driven_already_is_only_repeated() -> None:
    turned = Conditions(turned=True)
    both = design_of(driven_of(), driven_of(conditions=turned))
    assert [o.repeats for o in candidate_trials(both, ["ground_slope"]) if o.conditions == turned] == [True]
    assert not [o for o in candidate_trials(design_of(driven_of()), []) if o.conditions == turned]


def shown(design: Design, **told: Any) -> str:
    text = io.StringIO()
    show_plan(plan_next(design, library(), **told), Console(file=text, width=80))
    lines = text.getvalue().splitlines()
    assert max(len(line) for line in lines) <= 80
    return " ".join(text.getvalue().split())


def test_the_table_fits_80_columns_and_says_what_to_do_and_why() -> None:
    named, scales = (replace(NAMED, values=(1.5,)),), (NamedNumber(name="tilt", value=1e-3),)
    design = design_of(driven_of(count=3), verdict="named", named=named, scales=scales, virtual=True)
    words = shown(design)
    assert words.startswith("Which trial distinguishes ground slope and IMU tilt? (virtual data)")
    assert "the Bayes factor between two of them, over the 3 trials at hand" in words
    assert "slope with opposite sign" in words
    assert re.search(r"First choice, 0\.2 m/s, [^:]*: turn the robot round", words)
    assert "Write '# turned = true' into its log" in words


def test_where_much_is_known_no_trial_is_worth_it() -> None:
    many = tuple(driven_of(v, count=12) for v in load_variants()[:2])
    words = shown(design_of(*many, verdict="named", named=(SURE,)), max_speed=0.3)
    assert "No trial is recommended: none lowers the std by a fifth." in words
    assert "First choice" not in words


def test_the_document_and_the_table_carry_the_figures_of_the_folder(tmp_path: Path) -> None:
    """The folder holds what `discover` and `study` both write, and no log."""
    finding = made_up_finding("named", speeds=(0.2,), repetitions=2)
    save_design(finding, commanded(trials_of(finding)), tmp_path / DESIGN)
    document = told("plan-next", tmp_path, "--room", 1, "--max-speed", 0.2, "--jobs", 1)
    assert document["schema"] == "granite-lab/plan/2"
    assert document["measure"] == "relative standard deviation"
    ((name, now),) = document["now"].items()
    assert name.startswith("multi_pass.")
    assert all(p["after"][name] <= now * (1 + 1e-9) for p in document["proposals"])
    table = gl.plan_next(tmp_path, room=1.0, max_speed=0.2, jobs=1).to_frame()
    assert list(table["after"]) == [p["after"][name] for p in document["proposals"]]
    assert set(table["before"]) == {now}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "holds no search"),
        ("{", "not JSON"),
        ("[]", "expected schema"),
        ('{"schema": "granite-lab/design/2", "verdict": "none"}', "is missing"),
    ],
)
def test_a_folder_without_a_search_is_refused(tmp_path: Path, content: str | None, says: str) -> None:
    if content is not None:
        (tmp_path / DESIGN).write_text(content)
    refused(lab("plan-next", tmp_path), 3, says)


def test_a_channel_with_a_noise_of_nothing_has_the_floor_of_its_kind() -> None:
    design = design_of(driven_of())
    observation = trial_model(0, SLOW, design.driven[0], design.robot).observation
    white = whitener_of(Noise(channel="wheel", rest=0.0), observation, 0.2)
    assert white(np.ones(observation.bins)) == pytest.approx(1 / FLOOR["wheel"])
