"""The Kalman filter against filterpy, against closed forms, and against its own claims of consistency."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, multivariate_normal

from ftcore.estimation import kalman


def spd(rng, *shape):
    """Random well-conditioned covariances."""
    A = rng.normal(size=(*shape, shape[-1]))
    return A @ A.swapaxes(-1, -2) + np.eye(shape[-1])


def frozen(*arrays):
    """Arrays that refuse to be written to: what is published must not be changed."""
    for a in arrays:
        a.flags.writeable = False
    return arrays


def a_bank(seed, runs=2, bank=3, n=6, m=4):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(runs, bank, n))
    P = spd(rng, runs, bank, n)
    y = rng.normal(size=(runs, bank, m))
    H = rng.normal(size=(runs, bank, m, n))
    R = rng.uniform(0.5, 2.0, size=(runs, bank, m))
    return frozen(x, P, y, H, R)


def test_bank_of_filters_equals_filterpy_one_by_one():
    rng = np.random.default_rng(1)
    runs, bank, n, m = 2, 3, 6, 4
    Phi = np.eye(n) + 0.1 * rng.normal(size=(runs, 1, n, n))
    Q, R = spd(rng, runs, bank, n), spd(rng, runs, bank, m)
    H = rng.normal(size=(runs, bank, m, n))
    x, P = rng.normal(size=(runs, bank, n)), spd(rng, runs, bank, n)
    oracles = {}
    for i in np.ndindex(runs, bank):
        oracle = KalmanFilter(dim_x=n, dim_z=m)
        oracle.x, oracle.P, oracle.F = x[i].copy()[:, None], P[i].copy(), Phi[i[0], 0]
        oracle.Q, oracle.R, oracle.H = Q[i], R[i], H[i]
        oracles[i] = oracle
    frozen(Phi, Q, R, H)
    for _ in range(30):
        y = rng.normal(size=(runs, bank, m))
        x, P = kalman.predict(x, P, Phi, Q)
        u = kalman.update(x, P, y, H, R)
        x, P = u.x, u.P
        for i, oracle in oracles.items():
            oracle.predict()
            oracle.update(y[i][:, None])
            np.testing.assert_allclose(x[i], oracle.x[:, 0], rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(P[i], oracle.P, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(u.gain[i], oracle.K, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(u.covariance[i], oracle.S, rtol=1e-9)
            np.testing.assert_allclose(u.log_likelihood[i], oracle.log_likelihood, rtol=1e-9)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.booleans(), min_size=4, max_size=4), st.booleans(), st.integers(0, 1000))
def test_a_row_that_is_not_valid_is_a_row_deleted(keep, full, seed):
    x, P, y, H, R = a_bank(seed, runs=1, bank=1)
    keep = np.array(keep)
    R = spd(np.random.default_rng(seed), 1, 1, 4) if full else R
    y, H, R = y.copy(), H.copy(), R.copy()
    short = (
        y[..., keep],
        H[..., keep, :],
        R[..., keep, :][..., keep] if full else R[..., keep],
    )
    y[..., ~keep], H[..., ~keep, :] = np.nan, np.nan
    if full:
        R[..., ~keep, :], R[..., :, ~keep] = np.nan, np.nan
    else:
        R[..., ~keep] = np.nan
    u = kalman.update(x, P, y, H, R, np.broadcast_to(keep, y.shape))
    assert u.dof.item() == keep.sum()
    np.testing.assert_array_equal(u.innovation[..., ~keep], 0.0)
    np.testing.assert_array_equal(u.gain[..., ~keep], 0.0)
    if keep.any():
        v = kalman.update(x, P, *short)
        for a, b in ((u.x, v.x), (u.P, v.P), (u.gain[..., keep], v.gain), (u.statistic, v.statistic)):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(u.log_likelihood, v.log_likelihood, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(u.whitened[..., keep], v.whitened, rtol=1e-12, atol=1e-12)
    else:
        np.testing.assert_array_equal(u.x, x)
        np.testing.assert_array_equal(u.P, P)
        assert u.log_likelihood.item() == 0.0


def test_masks_may_differ_between_runs_and_filters():
    x, P, y, H, R = a_bank(3)
    valid = np.random.default_rng(3).random(y.shape) < 0.6
    u = kalman.update(x, P, y, H, R, valid)
    for i in np.ndindex(x.shape[:2]):
        alone = kalman.update(*(a[i][None] for a in (x, P, y, H, R, valid)))
        np.testing.assert_allclose(u.x[i], alone.x[0], rtol=1e-12)
        np.testing.assert_allclose(u.P[i], alone.P[0], rtol=1e-12, atol=1e-14)


def test_what_is_common_to_all_runs_is_computed_once_and_gives_the_same():
    x, P, y, H, R = a_bank(4, runs=5)
    common = kalman.update(x, P[:1], y, H[:1, :1], R[:1])
    assert common.P.shape[0] == 1
    assert common.x.shape == x.shape
    each = kalman.update(x, np.broadcast_to(P[:1], P.shape), y, np.broadcast_to(H[:1, :1], H.shape), R[:1])
    np.testing.assert_allclose(common.x, each.x, rtol=1e-13)
    np.testing.assert_allclose(np.broadcast_to(common.P, each.P.shape), each.P, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(common.statistic, each.statistic, rtol=1e-13)


def test_variances_and_their_diagonal_matrix_are_the_same_noise():
    x, P, y, H, R = a_bank(5)
    a, b = kalman.update(x, P, y, H, R), kalman.update(x, P, y, H, R[..., None] * np.eye(4))
    np.testing.assert_allclose(a.P, b.P, rtol=1e-13)
    np.testing.assert_allclose(a.x, b.x, rtol=1e-13)


def test_innovation_alone_is_that_of_the_update_and_gaussian():
    x, P, y, H, R = a_bank(6)
    u, alone = kalman.update(x, P, y, H, R), kalman.innovation(x, P, y, H, R)
    np.testing.assert_array_equal(u.whitened, alone.whitened)
    for i in np.ndindex(x.shape[:2]):
        nu, S = y[i] - H[i] @ x[i], H[i] @ P[i] @ H[i].T + np.diag(R[i])
        np.testing.assert_allclose(kalman.nis(alone)[i], nu @ np.linalg.solve(S, nu), rtol=1e-11)
        np.testing.assert_allclose(alone.log_likelihood[i], multivariate_normal(cov=S).logpdf(nu), rtol=1e-11)


def test_covariance_stays_symmetric_to_the_bit_and_positive_with_units_far_apart():
    rng = np.random.default_rng(7)
    n, m = 21, 12
    units = 10.0 ** rng.uniform(-7, 4, size=n)
    P = (units[:, None] * units * spd(rng, n))[None]
    x = np.zeros((1, n))
    Phi = (np.eye(n) + 0.02 * rng.normal(size=(n, n)) * units[:, None] / units)[None]
    Q = np.diag(1e-6 * units**2)[None]
    H = rng.normal(size=(1, m, n)) / units
    R = np.full((1, m), 1e-6)
    for _ in range(300):
        x, P = kalman.predict(x, P, Phi, Q)
        P = kalman.update(x, P, np.zeros((1, m)), H, R).P
        np.testing.assert_array_equal(P, P.swapaxes(-1, -2))
    assert np.linalg.eigvalsh(P / (units[:, None] * units)).min() > 0.0


def test_joseph_form_is_the_same_covariance_and_outlives_an_absurd_prior():
    x, P, y, H, R = a_bank(8)
    a, b = kalman.update(x, P, y, H, R), kalman.update(x, P, y, H, R, joseph=True)
    np.testing.assert_allclose(a.P, b.P, rtol=1e-11, atol=1e-12)
    P = 1e20 * spd(np.random.default_rng(8), 1, 1, 4)
    H, R = spd(np.random.default_rng(9), 1, 1, 4), np.ones((1, 1, 4))
    exact = np.linalg.inv(H.swapaxes(-1, -2) @ H)
    y, x = np.zeros((1, 1, 4)), np.zeros((1, 1, 4))
    np.testing.assert_allclose(kalman.update(x, P, y, H, R, joseph=True).P, exact, rtol=1e-6)
    assert np.abs(kalman.update(x, P, y, H, R).P - exact).max() > 1.0  # what the short form makes of it


@pytest.mark.parametrize("count", [1, 3000])
@pytest.mark.parametrize("m", [1, 2, 3, 7, 20])
def test_triangular_inverse_small_and_large_stack(count, m):
    L = np.linalg.cholesky(spd(np.random.default_rng(m), count, m))
    np.testing.assert_allclose(kalman.triangular_inverse(L) @ L, np.broadcast_to(np.eye(m), L.shape), atol=1e-10)
    np.testing.assert_allclose(
        kalman.spd_inverse(L @ L.swapaxes(-1, -2)), np.linalg.inv(L @ L.swapaxes(-1, -2)), rtol=1e-6, atol=1e-8
    )


def test_a_covariance_that_is_not_positive_names_its_place():
    x, P, y, H, R = a_bank(9)
    R = R.copy()
    R[1, 2] = -1e3
    with pytest.raises(np.linalg.LinAlgError, match=r"\[\[1, 2\]\].*positive variances"):
        kalman.update(x, P, y, H, R)


@pytest.mark.parametrize("seed", range(4))
def test_nees_and_nis_of_random_stable_systems_are_chi_square(seed):
    """Each band fails with probability 1e-6; there are 4 x 3 of them."""
    rng = np.random.default_rng(100 + seed)
    runs, epochs, n, m = 2000, 25, 5, 3
    Phi = rng.normal(size=(n, n))
    Phi *= 0.95 / np.abs(np.linalg.eigvals(Phi)).max()
    H, P = rng.normal(size=(1, m, n)), spd(rng, 1, n)
    Q, R = 0.1 * spd(rng, n), np.array([[0.3, 1.0, 2.0]])
    root_Q = np.linalg.cholesky(Q)
    x = np.zeros((runs, n))
    truth = rng.normal(size=(runs, n)) @ np.linalg.cholesky(P[0]).T
    nis = np.empty((epochs, runs))
    whitened = np.empty((epochs, runs, m))
    for k in range(epochs):
        truth = truth @ Phi.T + rng.normal(size=(runs, n)) @ root_Q.T
        y = truth @ H[0].T + rng.normal(size=(runs, m)) * np.sqrt(R)
        x, P = kalman.predict(x, P, Phi[None], Q[None])
        u = kalman.update(x, P, y, H, R)
        x, P, nis[k], whitened[k] = u.x, u.P, kalman.nis(u), u.whitened
    low, high = kalman.consistency_band(n, runs, 1.0 - 1e-6)
    assert low < kalman.nees(x - truth, P).mean() < high
    low, high = kalman.consistency_band(m, runs * epochs, 1.0 - 1e-6)
    assert low < nis.mean() < high
    # Innovations of the optimal filter are white: neighbours in time are uncorrelated (sum of products ~ N(0, count)).
    products = whitened[1:] * whitened[:-1]
    assert abs(products.sum()) < 4.9 * np.sqrt(products.size)


def test_consistency_band_is_the_chi_square_quantile_and_refuses_nonsense():
    low, high = kalman.consistency_band(3, 50, 0.95)
    assert chi2.cdf(high * 50, 150) - chi2.cdf(low * 50, 150) == pytest.approx(0.95)
    with pytest.raises(ValueError, match="between 0 and 1, not 95"):
        kalman.consistency_band(3, 50, 95)
    with pytest.raises(ValueError, match="at least one sample"):
        kalman.consistency_band(3, 0)


def test_nees_does_not_depend_on_units():
    rng = np.random.default_rng(11)
    P, e = spd(rng, 3, 21), rng.normal(size=(3, 21))
    units = 10.0 ** rng.uniform(-9, 9, size=21)
    np.testing.assert_allclose(kalman.nees(e * units, P * units[:, None] * units), kalman.nees(e, P), rtol=1e-9)
