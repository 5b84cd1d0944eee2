"""Filter and smoother against a batch solution, and against what must not matter."""

import dataclasses
from functools import cache
from unittest import mock

import numpy as np
import pytest

from granite_lab.errors import EstimateError
from granite_lab.estimation import Motion, smoother
from granite_lab.estimation.error_model import BA, SIZE, TH, TINY, D, G, P, S, Updates, V, X
from granite_lab.estimation.nodes import Nodes
from granite_lab.parameters import load_robot
from tests.soak import sampled
from tests.truth import faults
from tests.truth.motion import estimate
from tests.truth.trials import TruthTrial, generate


@cache
def truth() -> TruthTrial:
    return generate(61, velocity=0.3, duration=3.0, still=(0.8, 0.8), grade="industrial", clock_offset=0.01)


@cache
def plain() -> Motion:
    return estimate(truth().trial, load_robot("granite", "industrial"))


@cache
def captured() -> Nodes:
    """Nodes of a real trial, as the estimation lays them out, cut to the onset of motion."""
    with mock.patch.object(smoother, "forward", wraps=smoother.forward) as spy:
        estimate(truth().trial, load_robot("granite", "industrial"))
    nodes: Nodes = spy.call_args.args[0]
    first = int(np.argmax(nodes.moving)) - 5
    part, updates = slice(first, first + 45), nodes.updates
    own = (updates.node >= first) & (updates.node < first + 45)
    kept = {name: getattr(updates, name)[own] for name in ("kind", "z", "H", "R")}
    F, Q = nodes.F[part].copy(), nodes.Q[part].copy()
    F[0], Q[0] = np.eye(SIZE), 0.0
    return dataclasses.replace(
        nodes,
        **{name: getattr(nodes, name)[part] for name in ("index", "t", "moving", "lost", "mean_slip", "w")},
        F=F, Q=Q, updates=Updates(node=updates.node[own] - first, **kept),
    )  # fmt: skip


def batch(nodes: Nodes) -> tuple[np.ndarray, np.ndarray]:
    """Weighted least squares over all states at once, by a QR decomposition of the whitened problem.

    Unknowns are all states of all nodes, each in units of a typical std, so that the equations are
    well conditioned: prior of the first node, one set of equations a step, one a measurement.
    """
    n = nodes.t.size
    scale = np.maximum(np.sqrt(nodes.P0.diagonal()), 1e-6)
    rows: list[np.ndarray] = []
    right: list[np.ndarray] = []

    def add(node: int, block: np.ndarray, value: np.ndarray | float) -> None:
        """Add equations of a node and perhaps its next."""
        rows.append(np.zeros((block.shape[0], n * SIZE)))
        rows[-1][:, node * SIZE : node * SIZE + block.shape[1]] = block
        right.append(np.broadcast_to(value, block.shape[0]))

    root = np.linalg.cholesky(nodes.P0)
    add(0, np.linalg.solve(root, np.eye(SIZE)), np.linalg.solve(root, nodes.x0[:, 0]))
    for k in range(n):
        if k:
            # an eigenvalue root takes covariances that are almost singular
            size = np.sqrt(nodes.Q[k].diagonal())
            values, vectors = np.linalg.eigh(nodes.Q[k] / np.outer(size, size))
            white = (vectors / np.sqrt(values)).T / size
            add(k - 1, np.hstack([-white @ nodes.F[k], white]), 0.0)
    taken = nodes.updates
    for k, z, H, R in zip(taken.node, taken.z, taken.H, taken.R, strict=True):
        add(k, H[None] / np.sqrt(R), z / np.sqrt(R))
    A = np.vstack(rows) * np.tile(scale, n)
    q, r = np.linalg.qr(A)
    solution = np.linalg.solve(r, q.T @ np.concatenate(right))
    inverse = np.linalg.solve(r, np.eye(n * SIZE))
    std = np.linalg.norm(inverse, axis=1)
    return (solution * np.tile(scale, n)).reshape(n, SIZE), (std * np.tile(scale, n)).reshape(n, SIZE)


def run(nodes: Nodes) -> smoother.Smoothed:
    innovations = smoother.forward(nodes).innovations
    return smoother.backward(nodes, smoother.filtered(nodes, innovations))


def test_covariances_stay_symmetric() -> None:
    """Asymmetry would grow with each node: after half an hour without a stop one was indefinite."""
    covariances = smoother.forward(captured()).P
    assert np.array_equal(covariances, covariances.transpose(0, 2, 1))


def test_a_velocity_that_is_no_number_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    original = smoother.backward

    def broken(nodes: Nodes, filtered: smoother.Filtered) -> smoother.Smoothed:
        found = original(nodes, filtered)
        return dataclasses.replace(found, x=np.where(np.arange(SIZE) == V, np.nan, found.x))

    monkeypatch.setattr(smoother, "backward", broken)
    with pytest.raises(EstimateError, match="numerically unstable"):
        estimate(truth().trial, load_robot("granite", "industrial"))


def test_smoother_agrees_with_batch_least_squares() -> None:
    nodes = captured()
    assert nodes.updates.z.size > 25
    assert nodes.moving.any()
    assert not nodes.moving.all()
    found = run(nodes)
    x, std = batch(nodes)
    alone = smoother.smoothed_states(nodes, smoother.forward(nodes))
    for state in (X, V, TH, BA, D, S, G, P):
        own = np.sqrt(found.P[:, state, state])
        large = std[:, state] > 3.0 * TINY[state]
        assert large.any()
        assert np.abs(found.x[:, state] - x[:, state]).max() < 1e-3 * std[:, state].max()
        assert np.abs(alone[:, state] - x[:, state]).max() < 1e-3 * std[:, state].max()
        assert own[large] == pytest.approx(std[large, state], rel=1e-3)


def wanderer(steps: np.ndarray, seed: int) -> Nodes:
    """A random walk of V over uneven steps, read with noise: a case with a plain answer."""
    rng = np.random.default_rng(seed)
    n = steps.size
    F, Q = np.tile(np.eye(SIZE), (n, 1, 1)), np.tile(np.diag(TINY**2), (n, 1, 1))
    F[:, X, V] = steps
    Q[1:, V, V] += 0.04 * steps[1:]
    true = np.cumsum(rng.normal(0, 0.2 * np.sqrt(steps)))
    read, H = true + rng.normal(0, 0.1, n), np.tile(np.eye(SIZE)[V], (n, 1))
    updates = Updates(np.arange(n), np.full(n, "wheel"), read, H, np.full(n, 0.01))
    P0 = np.diag(np.full(SIZE, 1e-6))
    P0[V, V] = 1.0
    still = np.zeros(n)
    return Nodes(
        index=np.arange(n), t=np.cumsum(steps), moving=np.ones(n, dtype=bool), lost=still, mean_slip=still,
        w=still, F=F, Q=Q, updates=updates, x0=np.zeros((SIZE, 1)), P0=P0,
    )  # fmt: skip


STEPS = np.array([0.0, 0.1, 0.5, 0.02, 0.9, 0.1, 0.3, 0.05, 1.2, 0.1])


def test_blocks_of_nodes_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run(wanderer(STEPS, 0))
    monkeypatch.setattr(smoother, "BLOCK", 4)
    parts = run(wanderer(STEPS, 0))
    assert parts.x == pytest.approx(whole.x, abs=1e-12)
    assert pytest.approx(whole.P, rel=1e-9) == parts.P


def test_the_fast_filter_finds_what_filterpy_finds() -> None:
    nodes = captured()
    fast = smoother.forward(nodes)
    slow = smoother.filtered(nodes, fast.innovations)
    std = np.sqrt(np.diagonal(slow.P, axis1=1, axis2=2))
    assert np.abs(fast.x - slow.x).max() < 1e-6 * std.max()
    assert np.abs((fast.P - slow.P) / (std[:, :, None] * std[:, None, :])).max() < 1e-6
    # the innovation of each measurement, by the states that filterpy finds without those of its node after it
    first = np.flatnonzero(np.diff(nodes.updates.node, prepend=-1) > 0)
    first = first[nodes.updates.node[first] > 0]
    H, node = nodes.updates.H[first], nodes.updates.node[first]
    ahead = nodes.F[node] @ slow.P[node - 1] @ nodes.F[node].transpose(0, 2, 1) + nodes.Q[node]
    expected = np.einsum("ki,kij,kj->k", H, ahead, H) + nodes.updates.R[first]
    mean = np.einsum("ki,kij,kj->k", H, nodes.F[node], slow.x[node - 1])
    assert fast.innovations.variance[first] == pytest.approx(expected, rel=1e-6)
    missed = fast.innovations.value[first] - (nodes.updates.z[first] - mean)
    assert np.abs(missed / np.sqrt(expected)).max() < 1e-6


def test_covariance_between_instants_is_that_of_a_sampled_posterior() -> None:
    nodes = wanderer(STEPS, 3)
    found = run(nodes)
    n = nodes.t.size
    # information matrix of V alone, for X does not feed back
    info = np.diag(np.full(n, 1 / 0.01))
    info[0, 0] += 1.0
    for k in range(1, n):
        q = 1.0 / (0.04 * STEPS[k] + TINY[V] ** 2)
        info[k - 1 : k + 1, k - 1 : k + 1] += q * np.array([[1, -1], [-1, 1]])
    posterior = np.linalg.inv(info)
    for i, j in ((0, 1), (2, 7), (4, 9)):
        assert found.cross(i, j)[V, V] == pytest.approx(posterior[i, j], rel=1e-4)


@pytest.mark.parametrize("origin", sampled([1.7e9, 3.0e4, -50.0]))
def test_origin_of_time_does_not_matter(origin: float) -> None:
    trial = faults.shifted_time(truth().trial, origin)
    motion = estimate(trial, load_robot("granite", "industrial"))
    # a double holds an epoch stamp to 0.2 microseconds
    assert motion.v == pytest.approx(plain().v, abs=2e-4 if origin > 1e8 else 1e-5)
    assert motion.slip_ratio.value == pytest.approx(plain().slip_ratio.value, abs=3e-4)
    assert motion.t_start.value - origin == pytest.approx(plain().t_start.value, abs=1e-3)
    assert motion.clock_offset.value == pytest.approx(plain().clock_offset.value, abs=1e-3)


@pytest.mark.parametrize("radius", sampled([0.8, 1.25, 2.0]))
def test_wheel_radius_scales_the_wheels_and_not_the_body(radius: float) -> None:
    one = load_robot("granite", "industrial")
    other = dataclasses.replace(
        one, wheels=dataclasses.replace(one.wheels, radius=one.wheels.radius * radius)
    )
    motion = estimate(truth().trial, other)
    rolled = motion.distance_wheels.value / plain().distance_wheels.value
    assert rolled == pytest.approx(radius, rel=0.003)
    # the wheels slip by more, or are slower than the body: no matter to the body's velocity
    moving = plain().v > 0.1
    error = (motion.v - truth().at(motion.t, "v"))[moving]
    assert np.sqrt(np.mean(error**2)) < 0.006
    ratio = 1 - (1 - plain().slip_ratio.value) / radius
    assert motion.slip_ratio.value == pytest.approx(ratio, abs=0.02)
