"""Records become bytes and come back the same, in memory or in a file; equal ones have equal hashes."""

import copy
import dataclasses
import errno
import os
import pickle
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from granite_lab.effects import library
from granite_lab.estimate import Estimate
from granite_lab.logs.trial import ImuStream, Trial, TrialInfo
from granite_lab.model.effect import activate
from granite_lab.options import Options
from granite_lab.running import Cache, Execution, each_trial
from granite_lab.running.codec import Arena, content, decode, encode
from tests.reporting.made_up import made_up_study

plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.lists(inner, max_size=3).map(tuple)
        | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=20,
)


@given(plain)
def test_any_plain_value_comes_back_with_its_types(value: object) -> None:
    assert repr(decode(encode(value))) == repr(value)


def test_equal_records_have_equal_hashes() -> None:
    options = Options(robot="granite", model=Path("m.toml"), info=TrialInfo(rests=((0.0, 1.5),)))
    assert content(options) == content(Options(**vars(options)))
    assert content(options) != content(Options(**vars(options) | {"rows": "x"}))
    assert content({"x": np.arange(5000)}) != content({"x": np.arange(5000) % 4000})
    assert decode(encode(options)) == options
    assert b"pathlib" not in encode(options)  # Python has moved its classes of paths


def test_an_effect_comes_back_as_the_one_of_the_library() -> None:
    effect = library()["tyre_windup"]
    active = activate(effect, {effect.parameters[0].name: effect.parameters[0].prior_high})
    assert decode(encode((active,)), library()) == (active,)
    with pytest.raises(KeyError):
        decode(encode(active), {})


@pytest.mark.parametrize("value", [object(), np.array([{}]).dtype, np.float64, len, {1}, b"x"])
def test_what_is_no_record_has_no_hash(value: object) -> None:
    with pytest.raises(TypeError):
        content((value,))


def test_what_occurs_again_is_stored_once_and_comes_back_as_one_object() -> None:
    array, record = np.arange(1000.0), Estimate(1.0, 2.0)
    data = encode([array, record, array, record])
    assert len(data) < 1.1 * array.nbytes
    back = decode(data)
    assert back[0] is back[2]
    assert back[1] is back[3]
    equal = [array, record, array.copy(), Estimate(1.0, 2.0)]
    assert content(equal) == content([array, record, array, record])


@pytest.mark.parametrize("shape", [(), (0,), (3, 0), (2, 3)])
@pytest.mark.parametrize("kind", ["<f8", "|b1", "<U3", "<i2"])
def test_arrays_of_any_shape_and_kind_come_back_as_they_were(shape: tuple[int, ...], kind: str) -> None:
    array = np.ones(shape, kind)
    back = decode(encode([array, array]))
    assert [(b.dtype, b.shape, b.tobytes()) for b in back] == 2 * [(array.dtype, shape, array.tobytes())]
    assert all(b.flags.aligned and b.flags.writeable for b in back)


@pytest.mark.parametrize("view", [np.s_[:, ::2], np.s_[::-1], np.s_[1:]])
@pytest.mark.parametrize("order", ["C", "F"])
def test_a_part_of_an_array_comes_back_without_the_rest(view: Any, order: Any) -> None:
    array = np.arange(24.0).reshape(4, 6).copy(order)[view]
    data = encode(array)
    back = decode(data)
    assert back.tolist() == array.tolist()
    assert len(data) <= 64 + len(encode(np.ascontiguousarray(array)))


def long_trial(name: str) -> Trial:
    """Return a trial of 1.12 MB, each number of which says whose it is."""
    start, samples = float(len(name)), 20_000
    t = np.linspace(start, start + 1, samples)
    imu = ImuStream(t, np.full((samples, 3), start), np.zeros((samples, 3)), False)
    return Trial(name, TrialInfo(), imu=imu)


def make(path: Path, options: Options) -> Trial:
    """Stand in for the chain."""
    return long_trial(path.stem)


@pytest.mark.parametrize("remembered", [True, False])
def test_many_results_take_little_memory(tmp_path: Path, remembered: bool) -> None:
    logs = [tmp_path / f"{'x' * k}.csv" for k in range(1, 41)]
    for log in logs:
        log.write_text("")
    how = Execution(1, cache=Cache(tmp_path / "cache") if remembered else None)
    each_trial(make, logs[:2], Options(), execution=how)
    tracemalloc.start()
    try:
        found = each_trial(make, logs, Options(), execution=how)
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 1_000_000  # of 45 MB
    found[0].imu.specific_force[:] = 99.0  # touches no other record
    assert [content(trial) for trial in found[1:]] == [content(long_trial(log.stem)) for log in logs[1:]]


def held(record: Any, folder: Path | None = None) -> Any:
    return decode(Arena(folder).hold(encode(record)))


def test_a_record_in_a_file_is_as_before() -> None:
    result = made_up_study(speeds=(0.5,), repetitions=1).trials[0]
    kept = held(result)
    changed = dataclasses.replace(kept.motion, v=2 * kept.motion.v)
    assert changed.v.tobytes() == (2 * result.motion.v).tobytes()
    assert kept.trial.info == result.trial.info
    for again in (kept, pickle.loads(pickle.dumps(kept)), copy.deepcopy(kept)):
        assert content(again) == content(result)


@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="counts open files in /dev/fd")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_the_file_has_no_name_and_is_closed_with_the_last_record(tmp_path: Path) -> None:
    before = len(list(Path("/dev/fd").iterdir()))
    kept = held(long_trial("xx"), tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert len(list(Path("/dev/fd").iterdir())) == before + 1
    reader = os.fork()
    if reader == 0:  # pragma: no cover, the child, which reads it, too
        os._exit(int(float(kept.imu.specific_force[0, 0])))
    assert os.waitstatus_to_exitcode(os.waitpid(reader, 0)[1]) == 2
    del kept
    assert len(list(Path("/dev/fd").iterdir())) == before


def test_a_full_disk_leaves_the_records_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr("tempfile.TemporaryFile", full)
    trial = long_trial("xx")
    assert content(held(trial)) == content(trial)
