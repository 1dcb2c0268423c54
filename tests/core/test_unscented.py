"""The unscented filter: the same as filterpy's on the F-16, as the Kalman filter where all is linear, consistent."""

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from ftcore.estimation import kalman, unscented
from ftcore.estimation.unscented import Rule
from ftcore.world.aircraft import S, f16, step, trim

STATES = [S.SPEED, S.ALPHA, S.BETA, S.ROLL, S.PITCH, S.P, S.Q, S.R, S.UP]
L = len(STATES)
SEEN = [0, 1, 2, 5, 7, 8]
R = np.diag([1.0, 1e-5, 1e-5, 1e-4, 1e-4, 4.0])
Q = np.diag([1e-3, 1e-7, 1e-7, 1e-8, 1e-8, 1e-5, 1e-5, 1e-5, 1e-4])
P0 = np.diag([1.0, 1e-5, 1e-5, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 4.0])
DT = 0.02
START = trim(f16(), 153.0, 1000.0, 36.6)


def fly(points):
    """Short flight of any points with the trim's controls."""
    x = np.zeros((*points.shape[:-1], 13))
    x[..., STATES] = points
    x[..., S.POWER] = START.x[S.POWER]
    return step(f16(), x, START.u, DT)[..., STATES]


def look(points):
    """Airspeed as a pressure, so that h bends too; the others as they are."""
    seen = points[..., SEEN].copy()
    seen[..., 0] = 1e-2 * seen[..., 0] ** 2
    return seen


def readings(rng, count):
    x = START.x[STATES] + np.linalg.cholesky(P0) @ rng.normal(size=L)
    for _ in range(count):
        x = fly(x[None])[0]
        yield look(x) + np.sqrt(np.diag(R)) * rng.normal(size=len(SEEN))


@pytest.mark.parametrize(
    "rule", [Rule(), Rule(redraw=False), Rule(0.3, 2.0, 0.0), Rule(1.0, 0.0, 1.0)], ids=["", "printed", "close", "wide"]
)
def test_equal_to_filterpys_on_the_f16(rule):
    points = MerweScaledSigmaPoints(L, rule.alpha, rule.beta, rule.kappa)
    peer = UnscentedKalmanFilter(L, len(SEEN), DT, lambda x: look(x), lambda x, dt: fly(x[None])[0], points)
    peer.x, peer.P, peer.Q, peer.R = START.x[STATES].copy(), P0.copy(), Q, R
    x, P = START.x[STATES], P0
    for y in readings(np.random.default_rng(1), 8):
        predicted = unscented.predict(x, P, fly, Q, rule)
        ours = unscented.update(predicted, y, look, R, rule)
        if rule.redraw:
            peer.predict()
        else:
            peer.compute_process_sigmas(DT)
            moved = peer.sigmas_f.copy()
            peer.predict()
            peer.sigmas_f = moved
        np.testing.assert_allclose(predicted.x, peer.x_prior, rtol=1e-9, atol=1e-12)
        peer.update(y)
        x, P = ours.x, ours.P
        np.testing.assert_allclose(x, peer.x, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(P, peer.P, rtol=1e-9, atol=1e-14)
        np.testing.assert_allclose(ours.gain, peer.K, rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(ours.covariance, peer.S, rtol=1e-9, atol=1e-14)
        assert ours.statistic == pytest.approx(peer.mahalanobis**2, rel=1e-6)


def test_linear_models_give_the_kalman_filter():
    rng = np.random.default_rng(2)
    Phi, H = np.eye(4) + 0.1 * rng.normal(size=(4, 4)), rng.normal(size=(2, 4))
    noise, white = np.diag([0.1, 0.2, 0.3, 0.4]), np.array([0.5, 0.6])
    x, P = rng.normal(size=(3, 5, 4)), np.broadcast_to(np.eye(4), (3, 5, 4, 4))
    y = rng.normal(size=(3, 5, 2))
    valid = rng.random((3, 5, 2)) < 0.7
    predicted = unscented.predict(x, P, lambda X: X @ Phi.T, noise, Rule())
    ours = unscented.update(predicted, y, lambda X: X @ H.T, white, Rule(), valid)
    theirs = kalman.update(*kalman.predict(x, P, Phi, noise), y, H, white, valid)
    for name in ("x", "P", "innovation", "covariance", "gain", "statistic", "dof"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-12, err_msg=name)


def test_many_filters_at_once_are_each_what_they_are_alone():
    rng = np.random.default_rng(3)
    x = START.x[STATES] + rng.normal(size=(4, 2, L)) * np.sqrt(np.diag(P0))
    y = look(x) + rng.normal(size=(4, 2, len(SEEN))) * np.sqrt(np.diag(R))
    valid = rng.random((4, 2, len(SEEN))) < 0.8
    whole = unscented.update(unscented.predict(x, P0, fly, Q, Rule()), y, look, R[None, None], Rule(), valid)
    alone = unscented.update(unscented.predict(x[2, 1], P0, fly, Q, Rule()), y[2, 1], look, R, Rule(), valid[2, 1])
    np.testing.assert_allclose(whole.x[2, 1], alone.x, rtol=1e-12)
    np.testing.assert_allclose(whole.P[2, 1], alone.P, rtol=1e-9, atol=1e-15)
    deleted = np.flatnonzero(valid[2, 1])
    fewer = unscented.update(
        unscented.predict(x[2, 1], P0, fly, Q, Rule()),
        y[2, 1, deleted],
        lambda X: look(X)[..., deleted],
        R[np.ix_(deleted, deleted)],
        Rule(),
    )
    np.testing.assert_allclose(alone.x, fewer.x, rtol=1e-12)
    assert alone.dof == len(deleted)


def test_nothing_read_leaves_the_prediction():
    predicted = unscented.predict(START.x[STATES], P0, fly, Q, Rule())
    y = np.full(len(SEEN), np.nan)
    after = unscented.update(predicted, y, look, R, Rule(), np.zeros(len(SEEN), bool))
    np.testing.assert_array_equal(after.x, predicted.x)
    np.testing.assert_array_equal(after.P, predicted.P)
    assert after.statistic == 0.0
    assert after.dof == 0


def test_error_and_innovation_are_as_large_as_the_filter_says():
    rng = np.random.default_rng(4)
    runs, steps = 80, 20
    state = START.x[STATES] + rng.normal(size=(runs, L)) * np.sqrt(np.diag(P0))
    x, P = np.broadcast_to(START.x[STATES], (runs, L)), np.broadcast_to(P0, (runs, L, L))
    nis = 0.0
    for _ in range(steps):
        state = fly(state) + rng.normal(size=(runs, L)) * np.sqrt(np.diag(Q))
        y = look(state) + rng.normal(size=(runs, len(SEEN))) * np.sqrt(np.diag(R))
        done = unscented.update(unscented.predict(x, P, fly, Q, Rule()), y, look, R[None], Rule())
        x, P, nis = done.x, done.P, nis + done.statistic.mean() / steps
    low, high = kalman.consistency_band(L, runs, 1.0 - 1e-6)
    assert low < kalman.nees(x - state, P).mean() < high
    low, high = kalman.consistency_band(len(SEEN), runs * steps, 1.0 - 1e-6)
    assert low < nis < high


def test_as_printed_the_innovation_lacks_the_share_of_the_process_noise():
    P, Q, R = np.array([[2.0]]), np.array([[3.0]]), np.array([0.5])
    for redraw, expected in ((True, 2.0 + 3.0 + 0.5), (False, 2.0 + 0.5)):
        rule = Rule(redraw=redraw)
        predicted = unscented.predict(np.zeros(1), P, lambda X: X, Q, rule)
        np.testing.assert_allclose(predicted.P, 5.0)
        done = unscented.update(predicted, np.ones(1), lambda X: X, R, rule)
        np.testing.assert_allclose(done.covariance, expected)


def test_points_that_do_not_spread_are_refused():
    with pytest.raises(ValueError, match="do not spread"):
        Rule(kappa=-L).weights(L)
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        unscented.sigma_points(np.zeros(2), np.diag([1.0, -1.0]), Rule())
