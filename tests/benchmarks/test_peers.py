"""Peers on residuals that are known: what they learn, what they have not seen, and how the page counts."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import granite_lab
from benchmarks.peers import one
from benchmarks.peers_learn import NAMES, Table, process, simulated, sparse, spread
from benchmarks.peers_page import best, page
from granite_lab.inference.fit import fit
from tests.inference.stub import drawn, measure, problem_of

pytestmark = pytest.mark.usefixtures("one_blas_thread")


def line(**changed: Any) -> dict[str, Any]:
    return {
        "key": "o03", "of": "outside", "hidden": "drive_reaction", "status": "compared", "verdict": "named",
        "named": ["drive_reaction"], "seconds": 20.0, "code": "new", "commit": "abc",
        "peer_seconds": {"STLSQ, command": 9.0, "GP, command": 30.0},
        "closed": {
            "this": {"trials": (0.98, 0.01), "speeds": (0.5, 0.02)},
            "STLSQ, command": {"trials": (0.7, 0.1), "speeds": (-0.4, 0.2)},
            "GP, command": {"trials": (0.9, 0.1), "speeds": (0.6, 0.1)},
        },
    } | changed  # fmt: skip


def test_the_page_shows_where_a_peer_is_best_and_leaves_other_code_out() -> None:
    null = line(key="o01", hidden="none", status="no gap", named=[], verdict="none")
    lost = {"key": "seed 7", "of": "blind", "status": "crashed", "code": "new", "commit": "abc"}
    text = page([line(code="old", key="o99"), null, lost, line()], of=5)
    assert "o99" not in text
    assert "seen 3 of 5 sets: 1 are compared, 1 have no gap, 1 were refused or crashed (seed 7)." in text
    assert "| o03 | drive_reaction | drive_reaction | **98** / 50 | 70 / -40 | 90 / **60** |" in text
    assert "| simulator in C (`outside/`) | speeds | 50 | -40 | 60 | 0 of 1 |" in text
    assert best(line(), ["this", "STLSQ, command", "GP, command"], "trials") == "this"


def test_a_set_that_cannot_be_read_is_a_line_of_its_own(tmp_path: Path) -> None:
    found = one(str(tmp_path / "outside" / "o98"))
    assert (found["key"], found["of"], found["status"]) == ("o98", "outside", "crashed")
    assert "1 were refused or crashed (o98)" in page([found | {"code": "new", "commit": "abc"}], of=1)


def test_the_package_imports_no_peer() -> None:
    package = Path(granite_lab.__file__).parent
    found = [path for path in package.rglob("*.py") if re.search("pysindy|sklearn", path.read_text("utf-8"))]
    assert found == []


@pytest.mark.parametrize("peer", [sparse, process])
def test_a_peer_finds_a_law_of_its_inputs_at_a_speed_that_it_has_not_seen(peer: Any) -> None:
    pytest.importorskip("pysindy" if peer is sparse else "sklearn")
    rng = np.random.default_rng(1)
    problem = problem_of((0, 1, 1, 2))
    measure(problem, drawn(problem, rng), rng)
    base = fit(problem, problem.neutral())
    inputs = [rng.normal(size=(r.shape[1], len(NAMES))) for r in base.residuals]
    for residual, x in zip(base.residuals, inputs, strict=True):
        residual[:] = 0.3 * x[:, 1] * x[:, 2] - x[:, 0] + 0.01 * rng.normal(size=residual.shape)
        residual[0, 3] = np.nan
    learn = peer(Table(problem, base, inputs))
    for out in (problem.commands[1], (0,)):
        found = learn(out)
        for i in out:
            left = base.residuals[i] - found[i]
            assert np.nanstd(left) < 0.1 * np.nanstd(base.residuals[i])


def test_inputs_of_a_trial_follow_its_command() -> None:
    problem = problem_of((0, 1))
    rng = np.random.default_rng(1)
    measure(problem, drawn(problem, rng), rng)
    rows = simulated(problem, fit(problem, problem.neutral()))
    assert [r.shape for r in rows] == [(t.observation.bins, len(NAMES)) for t in problem.trials]
    assert all(np.isfinite(r).all() for r in rows)


def test_points_cover_the_inputs_and_do_not_crowd_where_most_bins_are() -> None:
    x = np.concatenate([np.zeros((500, 1)), np.linspace(0, 1, 11)[:, None]])
    chosen = spread(x, 11)
    assert sorted(x[chosen, 0]) == pytest.approx(np.linspace(0, 1, 11))
    assert len(spread(x[:3], 11)) == 3
