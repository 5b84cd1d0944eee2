"""Whatever happens to a log: a trial of finite numbers comes out, or one clear line, never a traceback."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from granite_lab.errors import LabError
from granite_lab.logs import inspect_logs, read_trial
from tests.logs import make
from tests.soak import SOAK

EXAMPLES = 3000 if SOAK else 150
GOOD = make.text(duration=3.0).encode()
LINES = GOOD.split(b"\n")

CELLS = [
    *(b"", b"nan", b"inf", b"-", b"1e400", b"1e-320", b"1,5", b"0x10", b"=1+1", b"true", b"9" * 400, b"t_s"),
    *(b"'", b'"', b'""', b"#", b",", b";", b"\t", b"\r", b"\n", b"\x00", b"\xff\xfe", b"# a = 1"),
]
cells = st.sampled_from(CELLS)
damage = st.one_of(
    st.tuples(st.just("cell"), st.integers(0, len(LINES) - 1), st.integers(0, 10), cells),
    st.tuples(st.just("bytes"), st.integers(0, len(GOOD)), st.just(0), st.binary(max_size=20)),
    st.tuples(st.just("cut"), st.integers(0, len(GOOD)), st.integers(0, len(GOOD)), st.just(b"")),
    st.tuples(st.just("swap"), st.integers(0, len(LINES) - 1), st.integers(0, len(LINES) - 1), st.just(b"")),
    st.tuples(st.just("line"), st.integers(0, len(LINES) - 1), st.just(0), st.binary(max_size=40)),
)


def damaged(steps: list[tuple[str, int, int, bytes]]) -> bytes:
    """Apply some damage to the good log."""
    content = GOOD
    for kind, a, b, text in steps:
        if kind == "bytes":
            content = content[:a] + text + content[a:]
        elif kind == "cut":
            content = content[: min(a, b)] + content[max(a, b) :]
        else:
            lines = content.split(b"\n")
            if a < len(lines) and kind == "line":
                lines.insert(a, text)
            elif max(a, b) < len(lines) and kind == "swap":
                lines[a], lines[b] = lines[b], lines[a]
            elif a < len(lines) and kind == "cell":
                row = lines[a].split(b",")
                row[min(b, len(row) - 1)] = text
                lines[a] = b",".join(row)
            content = b"\n".join(lines)
    return content


def check(path: Path) -> bool:
    """Read a log and hold what comes out to its promises; return whether it was refused."""
    refused: LabError | None = None
    try:
        trial = read_trial(path)
    except LabError as error:
        refused = error
    else:
        if trial.imu is not None:
            assert np.isfinite(trial.imu.t).all()
            assert (np.diff(trial.imu.t) > 0).all()
            for values in (trial.imu.specific_force, trial.imu.angular_rate):
                assert (np.isfinite(values).all(axis=0) | np.isnan(values).all(axis=0)).all()
        if trial.wheels is not None:
            assert (np.diff(trial.wheels.t) > 0).all()
            assert not np.isinf(trial.wheels.angle).any()
        assert all("\n" not in line for line in trial.warnings)
    if refused:
        assert refused.message.startswith(str(path)), refused.message
        assert "\n" not in refused.message
        assert refused.hint
        assert refused.exit_code == 3
    inspect_logs([path]).as_json()
    return refused is not None


many = settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))
numbers = st.floats(allow_nan=True, width=32) | st.none()


@given(steps=st.lists(damage, min_size=1, max_size=4))
@many
def test_a_damaged_log(steps: list[tuple[str, int, int, bytes]], tmp_path: Path) -> None:
    check(make.written(tmp_path, damaged(steps)))


@given(content=st.binary(max_size=300))
@many
def test_any_bytes(content: bytes, tmp_path: Path) -> None:
    check(make.written(tmp_path, content))


@given(rows=st.lists(st.lists(numbers, min_size=11, max_size=11), max_size=12))
@example(rows=[[0.0] * 11, [2.0**-9, *[0.0] * 9, 1.0]])  # a wheel whose only step no wheel can make
@many
def test_any_numbers(rows: list[list[float | None]], tmp_path: Path) -> None:
    table = [",".join("" if x is None else repr(x) for x in row) for row in rows]
    check(make.written(tmp_path, "\n".join([make.HEADER, *table])))
