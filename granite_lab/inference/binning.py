"""From signals to bins, as sparse matrices: all that happens on the way is linear, so one serves many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from granite_lab.logs.trial import Array

KEPT = 8
"""Number of shifts for which the matrices are remembered: derivatives by the start and by the low-pass take
five, and a fit tries another one and may go back."""

WHEELS, IMU, CURRENTS = 0, 1, 2

SENSOR_OF = (IMU, IMU, IMU, WHEELS, WHEELS, CURRENTS, CURRENTS, WHEELS)
"""The sensor that shows each simulated signal, in the order of `pool.SIGNALS`."""


@dataclass(frozen=True, eq=False)
class Stream:
    """One channel as it was sampled.

    Attributes:
        t: (N,) stamps [s].
        value: (N,) in the unit of the channel.
        weights: (8,) how the channel is composed of the simulated signals.
        is_angle: read at the edges instead of averaged over the bins.
        window: time around each stamp over which the sensor averages, or its instant is not known [s].
    """

    t: Array
    value: Array
    weights: Array
    is_angle: bool
    window: float = 0.0

    @property
    def sensor(self) -> int:
        """Which sensor stamped it, as `SENSOR_OF`."""
        return SENSOR_OF[int(np.flatnonzero(self.weights)[0])]


def means(t: Array, start: Array, end: Array) -> Any:
    """Return the (n, N) matrix that takes N samples to means of the straight lines between them.

    Beyond the samples the outermost lines go on.

    Args:
        t: (N,) stamps, rising.
        start, end: (n,) between what each mean is taken; where they are equal, the value there.
    """
    first = np.clip(np.searchsorted(t, start, side="right") - 1, 0, t.size - 2)
    last = np.clip(np.searchsorted(t, end, side="left") - 1, first, t.size - 2)
    count = last - first + 1  # lines that a mean goes over
    ends = np.cumsum(count)
    k = np.arange(ends[-1] if ends.size else 0) + np.repeat(first - ends + count, count)
    low, high = t[k], t[k + 1]
    low[ends - count], high[ends - 1] = start, end
    whole = np.repeat(end - start, count)
    share = np.divide(high - low, whole, out=np.ones(k.size), where=whole > 0)
    later = ((low + high) / 2 - t[k]) / (t[k + 1] - t[k])
    columns = np.stack([k, k + 1], axis=-1)
    values = np.stack([share * (1 - later), share * later], axis=-1)
    rows = np.concatenate([[0], 2 * ends])
    return csr_array((values.ravel(), columns.ravel(), rows), shape=(start.size, t.size))


def values(t: Array, at: Array) -> Any:
    """Return the (n, N) matrix that takes N samples to the values of the straight lines between them.

    Args:
        t: (N,) stamps, rising.
        at: (n,) where.
    """
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, t.size - 2)
    later = (at - t[k]) / (t[k + 1] - t[k])
    columns, weights = np.stack([k, k + 1], axis=-1), np.stack([1 - later, later], axis=-1)
    rows = 2 * np.arange(at.size + 1)
    return csr_array((weights.ravel(), columns.ravel(), rows), shape=(at.size, t.size))


def at_edges_or_between(stream: Stream, edges: Array) -> Any:
    """Return the (n, N) matrix from samples to n bins: means, or angles at the later edge."""
    if stream.is_angle:
        return values(stream.t, np.clip(edges[1:], stream.t[0], stream.t[-1]))
    return means(stream.t, edges[:-1], edges[1:])


@dataclass(frozen=True, eq=False)
class _Group:
    """Channels that are sampled at the same stamps in the same way."""

    names: tuple[str, ...]
    weights: Array
    stamps: Array
    window: float
    sensor: int
    to_bins: Any

    def to_stamps(self, t: Array, shift: float, low_pass: float) -> Any:
        """Return the matrix from a simulation's grid to what the sensor shows at its stamps.

        A low-pass is a longer window of the same variance: of its response, mean and variance show in what is
        slower than its cut-off.
        """
        at, half = self.stamps - shift, float(np.sqrt(self.window**2 + 12 * low_pass)) / 2
        if not half:
            return values(t, np.clip(at, t[0], t[-1]))
        # accelerations and currents jump: what is shown of a corner depends on where the window lies
        inside = (at - half >= t[0]) & (at + half <= t[-1])
        at = np.clip(at, t[0], t[-1])
        return means(t, np.where(inside, at - half, at), np.where(inside, at + half, at))


class Binning:
    """Takes simulated signals to the bins of one trial.

    Args:
        streams: channel to its samples.
        edges: (n+1,) edges of the bins [s, the log's time].
        t_start: first estimate of the command's start [s, the log's time].
    """

    def __init__(self, streams: Mapping[str, Stream], edges: Array, t_start: float) -> None:
        alike: dict[tuple[bytes, bool, float], list[str]] = {}
        for name, s in streams.items():
            alike.setdefault((s.t.tobytes(), s.is_angle, s.window), []).append(name)
        self._groups = [self._group(names, streams, edges, t_start) for names in alike.values()]
        self._order = tuple(streams)
        self._matrices: dict[tuple[int, tuple[float, float], int], tuple[Any, Any]] = {}

    @staticmethod
    def _group(names: list[str], streams: Mapping[str, Stream], edges: Array, t_start: float) -> _Group:
        s = streams[names[0]]
        to_bins = at_edges_or_between(s, edges)
        used = np.unique(to_bins.indices)
        weights = np.stack([streams[name].weights for name in names])
        return _Group(tuple(names), weights, s.t[used] - t_start, s.window, s.sensor, to_bins[:, used])

    def __call__(
        self,
        t: Array,
        response: Array,
        start: float,
        late: Sequence[float] = (0.0, 0.0, 0.0),
        only: Sequence[str] = (),
        low_pass: float = 0.0,
    ) -> dict[str, Array]:
        """Return channel to its (n,) bins, or to the (n, k) bins of k responses.

        Args:
            t: (M,) time since the start of the command [s], the same for each response of that length.
            response: (8, M) or (8, M, k) simulated signals.
            start: by how much the command starts later than `t_start` [s].
            late: by how much the stamps of each sensor of `SENSOR_OF` are late [s].
            only: channels that are wanted; all by default.
            low_pass: variance of the impulse response of the IMU's low-pass [s^2].
        """
        wanted = only or self._order
        binned: dict[str, Array] = {}
        for number, group in enumerate(self._groups):
            members = [
                (name, w) for name, w in zip(group.names, group.weights, strict=True) if name in wanted
            ]
            if members:
                signals = [sum(w[k] * response[k] for k in np.flatnonzero(w)) for _, w in members]
                shift = start + late[group.sensor], low_pass if group.sensor == IMU else 0.0
                if response.ndim == 2:
                    bins = list(self._in_bins(number, t, shift, np.column_stack(signals), few=True).T)
                else:
                    bins = [self._in_bins(number, t, shift, signal, few=False) for signal in signals]
                binned.update(zip((name for name, _ in members), bins, strict=True))
        return {name: binned[name] for name in wanted}

    def _in_bins(
        self, number: int, t: Array, shift: tuple[float, float], signals: Array, *, few: bool
    ) -> Array:
        """Return the (n, k) bins of (M, k) signals; the matrices are multiplied first unless they are few."""
        group, key = self._groups[number], (number, shift, t.size)
        if key not in self._matrices:
            while len(self._matrices) >= KEPT * len(self._groups):
                del self._matrices[next(iter(self._matrices))]
            self._matrices[key] = group.to_stamps(t, *shift), None
        to_stamps, product = self._matrices[key]
        if few:
            return np.asarray(group.to_bins @ (to_stamps @ signals))
        if product is None:
            product = group.to_bins @ to_stamps
            self._matrices[key] = to_stamps, product
        return np.asarray(product @ signals)
