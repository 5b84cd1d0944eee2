"""Large parts of fits wait in files: nothing changes by that, and memory does not grow with the fits."""

import pickle
import tempfile
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest

from granite_lab.discovery.models import Search
from granite_lab.discovery.search import search
from granite_lab.inference.constants import TOLERANCE
from granite_lab.inference.fit import Fit, fit
from granite_lab.inference.setup import baseline
from granite_lab.inference.spill import SPILL_CACHE, Spillable, SpillCache
from granite_lab.logs.trial import Array
from granite_lab.processes import forked_map
from tests.inference.stub import PLACE, measure, measured, problem_of
from tests.soak import SOAK

pytestmark = pytest.mark.usefixtures("one_blas_thread")


def arrays_of(value: Any) -> Iterator[Array]:
    """Yield the arrays of a record that are in memory."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, Spillable):
        yield from arrays_of(value.value) if value.in_memory else ()
    elif isinstance(value, dict):
        for part in (*value, *value.values()):
            yield from arrays_of(part)
    elif isinstance(value, (list, tuple, frozenset)):
        for part in value:
            yield from arrays_of(part)
    elif is_dataclass(value):
        for field in fields(value):
            yield from arrays_of(getattr(value, field.name))


def bytes_of(value: Any) -> int:
    """Return how many bytes the arrays of a record take in memory."""
    return sum({id(a): a.nbytes for a in arrays_of(value)}.values())


def same(first: Any, second: Any) -> bool:
    """Tell whether the arrays of two records are alike to the last bit."""
    pairs = zip(list(arrays_of(first)), list(arrays_of(second)), strict=True)
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def fitted() -> Fit:
    problem, start, _ = measured(0)
    return fit(problem, start)


def test_what_was_put_away_reads_back_to_the_last_bit() -> None:
    found = fitted()
    derivatives, normal = found.derivatives, found.normal
    found.spillable.spill()
    assert not found.spillable.in_memory
    assert bytes_of(found) < 0.2 * found.spillable.size
    assert same((found.derivatives, found.normal), (derivatives, normal))
    assert found.spillable.in_memory


def again(fits: list[Fit], k: int) -> Fit:
    fits[k].spillable.spill()
    return replace(fits[k], predicted_drop=float(fits[k].normal.size))


def test_processes_read_what_another_one_has_put_away_and_send_it_back() -> None:
    found = fitted()
    found.spillable.spill()
    for sent in forked_map(again, [found, found], 2, "read", jobs=2):
        assert sent.predicted_drop == found.normal.size
        assert same((sent.derivatives, sent.normal), (found.derivatives, found.normal))


def test_another_process_is_sent_what_was_put_away() -> None:
    found = fitted()
    found.spillable.spill()
    sent = pickle.loads(pickle.dumps(found))
    assert same((sent.derivatives, sent.normal), (found.derivatives, found.normal))


def test_where_no_file_can_be_made_nothing_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(**_: Any) -> None:
        raise OSError("no space left on device")

    one = Spillable(np.arange(9.0))
    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    one.spill()
    assert one.in_memory
    assert np.array_equal(one.value, np.arange(9.0))


def test_what_waited_longest_is_put_away_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("granite_lab.inference.spill.SPILL_CACHE", SpillCache(2.5 * 8 * 100))
    first, second = (Spillable(np.full(100, value)) for value in (1.0, 2.0))
    assert first.value[0] == 1.0  # asked for again
    third = Spillable(np.full(100, 3.0))
    assert [one.in_memory for one in (first, second, third)] == [True, False, True]
    assert second.value[0] == 2.0
    assert [one.in_memory for one in (first, second, third)] == [False, True, True]


def searched() -> Search:
    problem = problem_of((0, 0, 1, 1), tuple(PLACE) if SOAK else ("pitch_rate", "wheel", "current_f"))
    rng = np.random.default_rng(3)
    point = problem.with_effect(problem.neutral(), "push", [0.3])
    measure(problem, problem.with_effect(point, "pull", [0.2]), rng)
    return search(problem, baseline(problem), ("push", "pull", "lift"), TOLERANCE)


def test_memory_of_a_search_does_not_grow_with_the_sets_that_it_fits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    free = searched()
    largest = max(m.fit.spillable.size for m in free.models)
    assert len(free.models) > 4
    assert bytes_of(free.models) > 4 * largest
    monkeypatch.setattr(SPILL_CACHE, "most", 1.0)
    bound = searched()
    assert bytes_of(bound.models) < 2 * largest
    assert [m.effects for m in bound.models] == [m.effects for m in free.models]
    assert [m.log_posterior for m in bound.models] == [m.log_posterior for m in free.models]
    assert all(same(a.fit.point, b.fit.point) for a, b in zip(bound.models, free.models, strict=True))
