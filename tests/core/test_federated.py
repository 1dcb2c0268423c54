"""The federation against the centralised filter, against the bound it rests on, and against its own promises."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.optimize import minimize_scalar

from ftcore.estimation import federated, kalman
from ftcore.estimation.federated import Estimate, Sharing

POSITIVE_SHARES = st.lists(st.floats(0.02, 1.0), min_size=2, max_size=5)


def spd(rng, *shape):
    A = rng.normal(size=(*shape, shape[-1]))
    return A @ A.swapaxes(-1, -2) + np.eye(shape[-1])


@dataclass(frozen=True)
class World:
    """A linear system seen by N sensors, with units as far apart as metres and radians."""

    Phi: np.ndarray
    Q: np.ndarray
    H: np.ndarray  # (N, m, n)
    R: np.ndarray  # (N, m)
    P0: np.ndarray

    @property
    def N(self):
        return len(self.H)

    @property
    def n(self):
        return self.Phi.shape[-1]

    def simulate(self, rng, epochs, runs=1):
        x = rng.normal(size=(runs, self.n)) @ np.linalg.cholesky(self.P0[0]).T
        root = np.linalg.cholesky(self.Q[0] + 1e-300 * np.eye(self.n)) if self.Q.any() else np.zeros_like(self.Q[0])
        for _ in range(epochs):
            x = x @ self.Phi[0].T + rng.normal(size=x.shape) @ root.T
            noise = rng.normal(size=(runs, *self.R.shape)) * np.sqrt(self.R)
            yield x, np.matvec(self.H, x[:, None]) + noise

    def centralised(self, readings, sensors=None):
        sensors = range(self.N) if sensors is None else sensors
        H = np.concatenate([self.H[i] for i in sensors])[None]
        R = np.concatenate([self.R[i] for i in sensors])[None]
        x, P = np.zeros((readings[0].shape[0], self.n)), self.P0
        for y in readings:
            x, P = kalman.predict(x, P, self.Phi, self.Q)
            u = kalman.update(x, P, np.concatenate([y[:, i] for i in sensors], axis=-1), H, R)
            x, P = u.x, u.P
        return x, P


def a_world(seed, N=3, n=6, m=2, noise=0.05):
    rng = np.random.default_rng(seed)
    units = 10.0 ** rng.uniform(-3, 3, size=n)
    Phi = np.eye(n) + 0.1 * rng.normal(size=(n, n))
    return World(
        (units[:, None] * Phi / units)[None],
        noise * (units[:, None] * spd(rng, n) * units)[None],
        rng.normal(size=(N, m, n)) / units,
        rng.uniform(0.5, 2.0, size=(N, m)),
        (units[:, None] * spd(rng, n) * units)[None],
    )


def fly(world, readings, sharing, used=None, readmitted=None, members=None):
    """Run a federation; used, members and readmitted are functions of the epoch. Returns bank and last estimate."""
    runs = readings[0].shape[0]
    everyone = np.ones((runs, world.N), dtype=bool)
    bank = federated.start(np.zeros((runs, world.n)), np.repeat(world.P0, runs, axis=0), sharing)
    for k, y in enumerate(readings):
        use = everyone if used is None else used(k)
        bank = federated.predict(bank, world.Phi, world.Q, sharing, everyone if members is None else members(k))
        u = kalman.update(*bank.locals, y, world.H[None], world.R[None])
        fused = federated.master_estimate(bank, u.x, u.P, use, sharing)
        back = None if readmitted is None else readmitted(k)
        bank = federated.after_fusion(bank, u.x, u.P, fused, use, sharing, back)
    return bank, fused


def assert_same(world, estimate, x, P, tolerance):
    sigma = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    np.testing.assert_allclose((estimate.x - x) / sigma, 0.0, atol=tolerance)
    np.testing.assert_allclose((estimate.P - P) / (sigma[..., :, None] * sigma[..., None, :]), 0.0, atol=tolerance)


# Shares and the bound


@settings(max_examples=60, deadline=None)
@given(POSITIVE_SHARES, st.integers(1, 5), st.integers(0, 1000))
def test_bound_27_holds_for_all_shares_that_are_allowed(raw, n, seed):
    shares = np.array(raw) / max(1.0, sum(raw))
    r = federated.inflation_factors(shares)
    Q = spd(np.random.default_rng(seed), n)
    bound = block_diag(*federated.inflate(Q[None], r)[0])
    gap = np.linalg.eigvalsh(bound - np.kron(np.ones((len(r), len(r))), Q))
    assert gap.min() > -1e-9 * np.abs(bound).max()


def test_bound_27_fails_as_soon_as_shares_sum_to_more_than_one():
    Q = np.eye(2)
    gap = np.linalg.eigvalsh(block_diag(Q / 0.55, Q / 0.5) - np.kron(np.ones((2, 2)), Q))
    assert gap.min() < 0.0


@pytest.mark.parametrize(
    ("shares", "message"),
    [
        ([0.0, 1.0], "infinite process noise"),
        ([-0.2, 0.5], "must be positive"),
        ([0.7, 0.7], "sum to 1.4"),
        ([np.nan, 0.5], "must be positive"),
        ([], "at least one"),
    ],
)
def test_shares_that_break_the_bound_are_refused(shares, message):
    with pytest.raises(ValueError, match=message):
        federated.inflation_factors(shares)


def test_sharing_explains_what_is_wrong():
    with pytest.raises(ValueError, match="unknown; choose one of no-reset"):
        Sharing("reset", (0.5, 0.5))
    with pytest.raises(ValueError, match="only in rescale mode"):
        Sharing("fusion-reset", (0.5, 0.25), 0.25)
    with pytest.raises(ValueError, match="between 0 and 1, not 0"):
        Sharing("rescale", (0.5, 0.5))
    with pytest.raises(ValueError, match=r"sum to 1\.2"):
        Sharing("rescale", (0.5, 0.5), 0.2)


@settings(max_examples=60, deadline=None)
@given(POSITIVE_SHARES, st.data())
def test_redistributed_shares_sum_to_one_over_the_used(raw, data):
    shares = np.array(raw) / max(1.0, sum(raw))
    used = np.array(data.draw(st.lists(st.booleans(), min_size=len(raw), max_size=len(raw))))[None]
    r = federated.redistribute(shares, used)
    assert np.isfinite(r).all()
    if used.any():
        assert (1.0 / r[used]).sum() == pytest.approx(1.0)
        ratio = 1.0 / r[used] / shares[used[0]]
        np.testing.assert_allclose(ratio, ratio[0])
    np.testing.assert_allclose(r[~used], 1.0 / shares[~used[0]])


def test_process_noise_is_shared_among_the_members_as_the_mode_has_it():
    members = np.array([[True, True, True], [True, False, True]])
    no_reset = federated.noise_factors(Sharing("no-reset", (0.5, 0.3, 0.2)), members)
    np.testing.assert_allclose(no_reset, [[2, 10 / 3, 5, 1], [1.4, 10 / 3, 3.5, 1]])
    reset = federated.noise_factors(Sharing("fusion-reset", (0.5, 0.3, 0.2)), members)
    np.testing.assert_allclose(
        np.broadcast_to(reset, (2, 4)), [[2, 10 / 3, 5, 1]] * 2
    )  # who is out still holds a share
    np.testing.assert_array_equal(federated.noise_factors(Sharing.equal("zero-reset", 3), members), 1.0)
    rescale = federated.noise_factors(Sharing("rescale", (0.5, 0.2, 0.2), 0.1), members)
    np.testing.assert_allclose(rescale, [[2, 5, 5, 10], [1.6, 5, 4, 8]])
    np.testing.assert_allclose((1 / rescale)[[[0], [1]], [[0, 2, 3], [0, 2, 3]]].sum(axis=1), [0.8, 1.0])


# The master


def test_fusion_is_the_sum_of_information_and_ignores_what_is_not_used():
    rng = np.random.default_rng(2)
    x, P = rng.normal(size=(2, 3, 4)), spd(rng, 2, 3, 4)
    x[1, 2], P[1, 2] = np.nan, np.nan
    used = np.array([[True, True, True], [True, True, False]])
    fused = federated.fuse(x, P, used)
    for run, members in ((0, [0, 1, 2]), (1, [0, 1])):
        information = [np.linalg.inv(P[run, i]) for i in members]
        P_g = np.linalg.inv(sum(information))
        np.testing.assert_allclose(fused.P[run], P_g, rtol=1e-10, atol=1e-12)
        z = sum(L @ x[run, i] for L, i in zip(information, members, strict=True))
        np.testing.assert_allclose(fused.x[run], P_g @ z, rtol=1e-10, atol=1e-12)


def test_fusion_survives_units_far_apart():
    rng = np.random.default_rng(3)
    units = np.array([1e3, 1e3, 1.0, 1e-4, 1e-7, 1e-9])
    x, P = rng.normal(size=(4, 2, 6)), spd(rng, 4, 2, 6)
    used = np.ones((4, 2), dtype=bool)
    plain = federated.fuse(x, P, used)
    scaled = federated.fuse(x * units, P * (units[:, None] * units), used)
    np.testing.assert_allclose(scaled.x / units, plain.x, rtol=1e-10)
    np.testing.assert_allclose(scaled.P / (units[:, None] * units), plain.P, rtol=1e-10, atol=1e-12)


def test_a_run_with_nothing_used_returns_the_fallback_and_asks_for_one():
    rng = np.random.default_rng(4)
    x, P = rng.normal(size=(2, 2, 3)), spd(rng, 2, 2, 3)
    used = np.array([[True, True], [False, False]])
    fallback = Estimate(np.full((2, 3), 7.0), np.broadcast_to(9.0 * np.eye(3), (2, 3, 3)))
    fused = federated.fuse(x, P, used, fallback)
    np.testing.assert_array_equal(fused.x[1], 7.0)
    np.testing.assert_array_equal(fused.P[1], 9.0 * np.eye(3))
    np.testing.assert_allclose(fused.x[0], federated.fuse(x[:1], P[:1], used[:1]).x[0], rtol=1e-12)
    with pytest.raises(ValueError, match=r"runs \[1\]"):
        federated.fuse(x, P, used)


def test_a_state_without_variance_cannot_be_fused_and_is_named():
    P = np.broadcast_to(np.diag([1.0, 0.0, 1.0]), (1, 2, 3, 3))
    with pytest.raises(ValueError, match=r"states \[1\]"):
        federated.fuse(np.zeros((1, 2, 3)), P, np.ones((1, 2), dtype=bool))


def test_output_of_a_failed_sensor_is_estimated_from_the_others():
    world = a_world(5)
    rng = np.random.default_rng(5)
    flown = list(world.simulate(rng, 20, runs=2000))
    readings = [y for _, y in flown]
    sharing = Sharing.equal("fusion-reset", 3)
    healthy = np.broadcast_to([True, False, True], (2000, 3))
    _, fused = fly(world, readings, sharing, used=lambda k: healthy)
    y_hat, Y = federated.failed_output(fused, world.H[1:2])
    error = y_hat - np.matvec(world.H[1], flown[-1][0])
    low, high = kalman.consistency_band(2, 2000, 1.0 - 1e-6)  # false failure 1e-6
    assert low < kalman.nees(error, Y).mean() < high


# Corollary 1, and the modes that equal the centralised filter


@pytest.mark.parametrize("seed", range(3))
def test_corollary_1_without_process_noise_no_reset_is_the_centralised_filter(seed):
    world = a_world(seed, noise=0.0)
    readings = [y for _, y in world.simulate(np.random.default_rng(seed), 25, runs=2)]
    _, fused = fly(world, readings, Sharing("no-reset", (0.5, 0.3, 0.2)))
    assert_same(world, fused, *world.centralised(readings), 1e-8)


@pytest.mark.parametrize("mode", ["fusion-reset", "zero-reset"])
@pytest.mark.parametrize("seed", range(3))
def test_with_process_noise_reset_modes_are_the_centralised_filter(mode, seed):
    world = a_world(10 + seed)
    readings = [y for _, y in world.simulate(np.random.default_rng(seed), 25, runs=2)]
    sharing = Sharing(mode, (0.6, 0.3, 0.1))
    bank, fused = fly(world, readings, sharing)
    x, P = world.centralised(readings)
    assert_same(world, fused, x, P, 1e-8)
    if mode == "fusion-reset":
        for i, r in enumerate(federated.inflation_factors(sharing.shares)):
            np.testing.assert_allclose(bank.x[:, i], fused.x)
            np.testing.assert_allclose(bank.P[:, i], r * fused.P)


@pytest.mark.parametrize("mode", ["fusion-reset", "zero-reset"])
def test_withholding_a_sensor_from_the_start_is_the_centralised_filter_without_it(mode):
    world = a_world(20)
    readings = [y for _, y in world.simulate(np.random.default_rng(20), 25, runs=2)]
    without = np.broadcast_to([True, False, True], (2, 3))
    _, fused = fly(world, readings, Sharing(mode, (0.6, 0.3, 0.1)), used=lambda k: without)
    x, P = world.centralised(readings, sensors=[0, 2])
    assert_same(world, fused, x, np.broadcast_to(P, fused.P.shape), 1e-8)


@pytest.mark.parametrize("mode", ["fusion-reset", "zero-reset"])
def test_with_every_measurement_withheld_only_time_goes_on(mode):
    world = a_world(21)
    readings = [y for _, y in world.simulate(np.random.default_rng(21), 10)]
    _, fused = fly(world, readings, Sharing.equal(mode, 3), used=lambda k: np.zeros((1, 3), dtype=bool))
    x, P = np.zeros((1, world.n)), world.P0
    for _ in readings:
        x, P = kalman.predict(x, P, world.Phi, world.Q)
    assert_same(world, fused, x, P, 1e-8)


def test_no_reset_exclusion_contributes_nothing():
    """(11)-(12): whatever the excluded filter holds, the estimate is the merge of the others."""
    world = a_world(22)
    readings = [y for _, y in world.simulate(np.random.default_rng(22), 10)]
    broken = [y + np.array([0.0, 1e6, 0.0])[:, None] for y in readings]
    sharing = Sharing("no-reset", (0.4, 0.3, 0.3))
    without = np.array([[True, False, True]])
    _, a = fly(world, readings, sharing, used=lambda k: without)
    bank, b = fly(world, broken, sharing, used=lambda k: without)
    np.testing.assert_array_equal(a.x, b.x)
    np.testing.assert_array_equal(a.P, b.P)
    alone = federated.fuse(bank.x[:, [0, 2]], bank.P[:, [0, 2]], np.ones((1, 2), dtype=bool))
    np.testing.assert_allclose(b.x, alone.x, rtol=1e-9)


@pytest.mark.parametrize("mode", federated.MODES)
def test_reset_modes_forget_a_withheld_fault_and_the_others_readmit_by_reset(mode):
    """Given a sensor broken in epochs 5-14 and withheld; when it is back at epoch 20, then nothing remains of it."""
    world = a_world(23)
    readings = [y for _, y in world.simulate(np.random.default_rng(23), 26)]
    broken = [y + (1e6 if 5 <= k < 15 else 0.0) * np.array([0.0, 1.0, 0.0])[:, None] for k, y in enumerate(readings)]
    out = np.array([[True, False, True]])
    back = ~out

    def members(k):
        return out if 6 <= k <= 20 else ~(out & back)

    def used(k):
        return out if 5 <= k < 20 else ~(out & back)

    def fly_with(data):
        return fly(
            world,
            data,
            Sharing.equal(mode, 3),
            used=lambda k: out if k == 20 else used(k),
            members=members,
            readmitted=lambda k: back if k == 20 else ~(out | back),
        )

    (clean_bank, clean), (bank, fused) = fly_with(readings), fly_with(broken)
    np.testing.assert_allclose(fused.x, clean.x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(bank.x, clean_bank.x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(bank.P, clean_bank.P, rtol=1e-9)


@pytest.mark.parametrize("mode", ["no-reset", "rescale"])
def test_readmission_resets_all_who_are_used_and_only_in_its_own_run(mode):
    world = a_world(24)
    readings = [y for _, y in world.simulate(np.random.default_rng(24), 8, runs=2)]
    sharing = Sharing.equal(mode, 3)
    before = np.array([[True, False, True], [True, False, True]])
    back = np.array([[False, True, False], [False, False, False]])
    bank, fused = fly(
        world,
        readings,
        sharing,
        used=lambda k: before,
        readmitted=lambda k: back & (k == 7),
    )
    information = np.linalg.inv(bank.P[0, : 4 if mode == "rescale" else 3]).sum(axis=0)
    sigma = np.sqrt(np.diagonal(fused.P[0]))
    unit = sigma[:, None] * sigma
    np.testing.assert_allclose(information * unit, np.linalg.inv(fused.P[0]) * unit, atol=1e-7)
    np.testing.assert_allclose(bank.x[0], np.broadcast_to(fused.x[0], bank.x[0].shape))
    assert not np.allclose(bank.x[1, 1], fused.x[1], rtol=1e-6)


def test_no_reset_with_nothing_used_coasts_on_the_masters_prediction():
    world = a_world(25)
    readings = [y for _, y in world.simulate(np.random.default_rng(25), 6)]
    _, before = fly(world, readings[:3], Sharing.equal("no-reset", 3))
    _, fused = fly(world, readings, Sharing.equal("no-reset", 3), used=lambda k: np.full((1, 3), k < 3))
    x, P = before.x, before.P
    for _ in range(3):
        x, P = kalman.predict(x, P, world.Phi, world.Q)
    assert_same(world, fused, x, P, 1e-9)


def test_a_local_that_is_not_used_gives_nothing_to_the_master_in_rescale():
    world = a_world(26)
    y = next(y for _, y in world.simulate(np.random.default_rng(26), 1))
    sharing = Sharing.equal("rescale", 3)
    used, members = np.array([[True, False, True]]), np.ones((1, 3), dtype=bool)
    prior = federated.predict(
        federated.start(np.zeros((1, world.n)), world.P0, sharing), world.Phi, world.Q, sharing, members
    )
    u = kalman.update(*prior.locals, y, world.H[None], world.R[None])
    fused = federated.master_estimate(prior, u.x, u.P, used, sharing)
    bank = federated.after_fusion(prior, u.x, u.P, fused, used, sharing)
    np.testing.assert_allclose(bank.P[:, 1], u.P[:, 1], rtol=1e-12)
    np.testing.assert_array_equal(bank.x[:, :3], u.x)
    assert (np.diagonal(bank.P[0, 0]) > np.diagonal(u.P[0, 0])).any()
    assert_same(world, federated.fuse(bank.x, bank.P, np.array([[True, False, True, True]])), fused.x, fused.P, 1e-9)


# Conservatism: the true joint covariance of the local errors stays below the block diagonal the filters believe in


@settings(max_examples=15, deadline=None)
@given(POSITIVE_SHARES, st.integers(0, 1000))
def test_the_joint_covariance_of_no_reset_filters_is_bounded_29_to_31(raw, seed):
    N, n = len(raw), 3
    world = a_world(seed, N=N, n=n, m=1, noise=0.5)
    shares = np.array(raw) / max(1.0, sum(raw))
    sharing = Sharing("no-reset", tuple(shares))
    bank = federated.start(np.zeros((1, n)), world.P0, sharing)
    J = np.kron(np.ones((N, N)), world.P0[0])
    everyone = np.ones((1, N), dtype=bool)
    for _ in range(15):
        bank = federated.predict(bank, world.Phi, world.Q, sharing, everyone)
        u = kalman.update(*bank.locals, np.zeros((1, N, 1)), world.H[None], world.R[None])
        bank = replace(bank, x=bank.x, P=np.concatenate([u.P, bank.P[:, -1:]], axis=1))
        Phi = np.kron(np.eye(N), world.Phi[0])
        A = block_diag(*(np.eye(n) - u.gain[0, i] @ world.H[i] for i in range(N)))
        B = block_diag(*u.gain[0])
        J = A @ (Phi @ J @ Phi.T + np.kron(np.ones((N, N)), world.Q[0])) @ A.T + B @ np.diag(world.R.ravel()) @ B.T
        believed = block_diag(*u.P[0])
        unit = np.sqrt(np.diagonal(believed))
        assert np.linalg.eigvalsh((believed - J) / (unit[:, None] * unit)).min() > -1e-9


@pytest.mark.parametrize("mode", federated.MODES)
def test_no_mode_ever_believes_more_than_is_true(mode):
    """Mean NEES of the fused estimate lies on (exact modes) or below (bounds) n; each check fails with 1e-6."""
    world, runs = a_world(30, noise=0.3), 3000
    flown = list(world.simulate(np.random.default_rng(30), 25, runs=runs))
    pattern = np.array([[True, True, True], [True, False, True], [True, True, False]])
    used = np.repeat(pattern, runs // 3, axis=0)

    def use(k):
        return used if 8 <= k < 12 else np.ones_like(used)

    bank, fused = fly(world, [y for _, y in flown], Sharing.equal(mode, 3), used=use)
    if mode in ("fusion-reset", "rescale"):
        # All errors of the bank together, each whitened by what its filter believes: no direction exceeds 1. With 3000
        # samples in 24 dimensions the largest eigenvalue of a unit covariance is 1.19 on average, above 1.3 in < 1e-6.
        L = np.linalg.cholesky(bank.P[:, : 3 if mode == "fusion-reset" else 4])
        error = np.linalg.solve(L, (bank.x - flown[-1][0][:, None])[:, : L.shape[1], :, None])
        error = error.reshape(runs, -1)
        assert np.linalg.eigvalsh(error.T @ error / runs).max() < 1.3
    mean = kalman.nees(fused.x - flown[-1][0], fused.P).mean()
    low, high = kalman.consistency_band(world.n, runs, 1.0 - 2e-6)
    assert mean < high
    if mode in ("fusion-reset", "zero-reset"):
        assert mean > low
    else:
        assert mean > 0.2 * world.n  # a bound, but not an empty one


def test_rescale_conserves_information_and_keeps_the_locals_from_starving():
    world = a_world(31, noise=0.3)
    world = replace(world, Phi=world.Phi / np.abs(np.linalg.eigvals(world.Phi)).max())  # 200 epochs: no explosion
    readings = [y for _, y in world.simulate(np.random.default_rng(31), 200)]
    bank, fused = fly(world, readings, Sharing.equal("rescale", 3))
    sigma = np.sqrt(np.diagonal(fused.P[0]))
    unit = sigma[:, None] * sigma
    np.testing.assert_allclose(np.linalg.inv(bank.P[0] / unit).sum(axis=0), np.linalg.inv(fused.P[0] / unit), atol=1e-6)
    merged = federated.fuse(bank.x, bank.P, np.ones((1, 4), dtype=bool))
    np.testing.assert_allclose((merged.x - fused.x) / sigma, 0.0, atol=1e-8)
    to_unit = np.linalg.inv(np.linalg.cholesky(fused.P[0]))
    mu = np.linalg.eigvalsh(to_unit @ bank.P[0] @ to_unit.T)
    assert (mu[:3] > 4.0 - 1e-6).all()  # no local holds more than its quarter in any direction
    assert (mu[3] < 4.0 + 1e-6).all()  # and the master never less


# Covariance intersection


@pytest.mark.parametrize("criterion", ["trace", "determinant"])
def test_two_filter_intersection_finds_the_best_weight(criterion):
    rng = np.random.default_rng(40)
    P = spd(rng, 50, 2, 4)
    P[:5, 1] = 100.0 * P[:5, 0]  # one filter dominates: all weight is its own
    w = federated.intersection_weights(P, np.ones((50, 2), dtype=bool), criterion)
    np.testing.assert_allclose(w.sum(axis=1), 1.0)
    scale = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1).min(axis=1))
    for i in range(50):
        A, B = (np.linalg.inv(P[i, k] / (scale[i][:, None] * scale[i])) for k in range(2))

        def cost(v, A=A, B=B):
            fused = np.linalg.inv(v * A + (1.0 - v) * B)
            return np.trace(fused) if criterion == "trace" else np.linalg.slogdet(fused)[1]

        best = minimize_scalar(cost, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-10})
        assert cost(w[i, 0]) <= best.fun + 1e-9 * abs(best.fun) + 1e-12
    np.testing.assert_allclose(w[:5, 0], 1.0, atol=1e-6)


@pytest.mark.parametrize("criterion", ["trace", "determinant"])
@pytest.mark.parametrize("N", [2, 4])
def test_intersection_is_consistent_whatever_the_correlation(criterion, N):
    """For any joint covariance with these blocks, the covariance of the fused error is at most the one claimed."""
    rng = np.random.default_rng(41)
    n = 3
    for _ in range(30):
        J = spd(rng, N * n)
        P = np.stack([J[i * n : i * n + n, i * n : i * n + n] for i in range(N)])[None]
        used = np.ones((1, N), dtype=bool)
        w = federated.intersection_weights(P, used, criterion)
        fused = federated.covariance_intersection(np.zeros((1, N, n)), P, used, criterion)
        gains = np.concatenate([fused.P[0] @ (w[0, i] * np.linalg.inv(P[0, i])) for i in range(N)], axis=1)
        assert np.linalg.eigvalsh(fused.P[0] - gains @ J @ gains.T).min() > -1e-10


@pytest.mark.parametrize("criterion", ["trace", "determinant"])
@pytest.mark.parametrize("N", [2, 3])
def test_intersection_of_one_used_filter_is_that_filter(criterion, N):
    rng = np.random.default_rng(42)
    x, P = rng.normal(size=(N + 1, N, 3)), spd(rng, N + 1, N, 3)
    used = np.concatenate([np.eye(N, dtype=bool), np.zeros((1, N), dtype=bool)])
    fallback = Estimate(np.zeros((N + 1, 3)), np.broadcast_to(np.eye(3), (N + 1, 3, 3)))
    fused = federated.covariance_intersection(x, P, used, criterion, fallback)
    for i in range(N):
        np.testing.assert_allclose(fused.x[i], x[i, i], rtol=1e-9)
        np.testing.assert_allclose(fused.P[i], P[i, i], rtol=1e-9)
    np.testing.assert_array_equal(fused.x[N], 0.0)
    with pytest.raises(ValueError, match="not 'volume'"):
        federated.covariance_intersection(x, P, used, "volume", fallback)
