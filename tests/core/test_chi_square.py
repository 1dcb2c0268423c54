"""Chi-square tests against scipy's distributions, the joint recursion of two estimates, and each other."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import binom, chi2, kstest, ncx2

from ftcore.detection import chi_square
from ftcore.detection.chi_square import (
    alternate,
    propagate,
    residual_test,
    residual_tests,
    start_propagators,
    state_chi_square,
    threshold,
    two_propagator_test,
)
from ftcore.detection.result import TestResult
from ftcore.estimation import kalman

FALSE_FAILURE = 1e-6
"""Two-sided probability that a statistical assertion here fails on right code (seeds are fixed all the same)."""


def assert_rate(alarms, p):
    """The number of alarms lies in the exact binomial band of independent trials with probability p."""
    low, high = binom.ppf([FALSE_FAILURE / 2, 1 - FALSE_FAILURE / 2], alarms.size, p)
    assert low <= np.count_nonzero(alarms) <= high, f"{alarms.mean():.5f}, expected {p:.5f}"


def spd(rng, *shape):
    A = rng.normal(size=(*shape, shape[-1]))
    return A @ A.swapaxes(-1, -2) + np.eye(shape[-1])


class Linear:
    """A stable system, one filter and one propagator of it, simulated in many runs."""

    def __init__(self, seed, n=6, m=2, runs=4000):
        self.rng = rng = np.random.default_rng(seed)
        self.runs, self.n, self.m = runs, n, m
        self.units = 10.0 ** rng.uniform(-4, 4, size=n)
        Phi = rng.normal(size=(n, n))
        Phi *= 0.98 / np.abs(np.linalg.eigvals(Phi)).max()
        self.Phi = (self.units[:, None] * Phi / self.units)[None]
        self.Q = (0.02 * self.units[:, None] * spd(rng, n) * self.units)[None]
        self.H = (rng.normal(size=(m, n)) / self.units)[None]
        self.R = rng.uniform(0.5, 2.0, size=(1, m))
        self.P0 = (self.units[:, None] * spd(rng, n) * self.units)[None]
        self.x = self.rng.normal(size=(runs, n)) @ np.linalg.cholesky(self.P0[0]).T

    def measure(self, bias=0.0):
        noise = self.rng.normal(size=(self.runs, self.n)) @ np.linalg.cholesky(self.Q[0]).T
        self.x = self.x @ self.Phi[0].T + noise
        return self.x @ self.H[0].T + self.rng.normal(size=(self.runs, self.m)) * np.sqrt(self.R) + bias

    def start(self):
        return np.zeros((self.runs, self.n)), self.P0


def test_thresholds_are_the_chi_square_quantiles():
    dof = np.arange(1, 300).reshape(13, 23)
    for p in (0.1, 1e-3, 1e-9):
        np.testing.assert_allclose(threshold(p, dof), chi2.isf(p, dof), rtol=1e-12)
        np.testing.assert_allclose(threshold(p, dof + 2000), chi2.isf(p, dof + 2000), rtol=1e-12)
    assert threshold(1e-3, 4) == pytest.approx(18.47, abs=5e-3)  # the papers' printed values
    assert 1e-4 * threshold(1e-3, 3) == pytest.approx(0.00163, abs=5e-6)
    assert threshold(0.10, 3) == pytest.approx(6.25, abs=5e-3)
    assert threshold(1e-3, 0) == 0.0


@pytest.mark.parametrize("p", [0.0, 1.0, -1e-3, 5.0])
def test_a_probability_that_is_none_is_refused(p):
    with pytest.raises(ValueError, match=f"between 0 and 1, not {p}"):
        threshold(p, 3)


def test_negative_degrees_of_freedom_are_refused():
    with pytest.raises(ValueError, match="cannot be negative; got -1"):
        threshold(1e-3, np.array([3, -1]))


def test_residual_test_keeps_its_false_alarm_rate_with_rows_missing():
    system = Linear(1, m=3)
    x, P = system.start()
    P = np.broadcast_to(P, (system.runs, *P.shape[1:]))
    alarms = []
    for _ in range(10):
        valid = system.rng.random((system.runs, 3)) < 0.7
        x, P = kalman.predict(x, P, system.Phi, system.Q)
        u = kalman.update(x, P, system.measure(), system.H, system.R, valid)
        x, P = u.x, u.P
        result = residual_test(u, 0.01, "gps")
        np.testing.assert_array_equal(result.dof, valid.sum(axis=1))
        assert not result.alarm[~valid.any(axis=1)].any()
        alarms.append(result.alarm[valid.any(axis=1)])
    assert_rate(np.concatenate(alarms), 0.01)


@pytest.mark.parametrize("size", [1.0, 2.5, 4.0])
def test_residual_test_detects_with_the_noncentral_probability(size):
    system = Linear(2)
    x, P = system.start()
    for k in range(8):
        bias = size * np.array([1.0, 0.0]) * (k == 7)
        x, P = kalman.predict(x, P, system.Phi, system.Q)
        u = kalman.update(x, P, system.measure(bias), system.H, system.R)
        x, P = u.x, u.P
    result = residual_test(u, 1e-3, "gps")
    noncentrality = bias @ np.linalg.solve(u.covariance[0], bias)
    assert_rate(result.alarm, ncx2.sf(threshold(1e-3, 2), 2, noncentrality))


def test_a_bank_is_tested_at_once_as_one_by_one():
    rng = np.random.default_rng(3)
    args = (rng.normal(size=(5, 3, 4)), spd(rng, 5, 3, 4), rng.normal(size=(5, 3, 2)), rng.normal(size=(5, 3, 2, 4)))
    R, valid = np.ones((5, 3, 2)), rng.random((5, 3, 2)) < 0.7
    results = residual_tests(kalman.innovation(*args, R, valid), 0.3, ("a", "b", "c"))
    for i, result in enumerate(results):
        alone = residual_test(kalman.innovation(*(a[:, i] for a in (*args, R, valid))), 0.3, "abc"[i])
        assert (result.name, result.subject) == ("residual", "abc"[i])
        for field in ("statistic", "dof", "threshold", "alarm", "innovation", "covariance"):
            np.testing.assert_allclose(getattr(result, field), getattr(alone, field), rtol=1e-12)
    with pytest.raises(ValueError, match="3 filters in the bank, but 2 subjects"):
        residual_tests(kalman.innovation(*args, R), 0.3, ("a", "b"))


def test_difference_of_covariances_is_the_covariance_of_the_difference():
    """(44) = (50): the joint recursion of (e1, e2) gives W = P2 - P1 to 1e-12 of the scale."""
    system = Linear(4, n=5, m=2)
    (_, P1), (_, P2) = system.start(), system.start()
    n, unit = 5, np.outer(system.units, system.units)
    J = np.kron(np.ones((2, 2)), system.P0[0])
    for _ in range(40):
        Phi, Q = system.Phi[0], np.kron(np.ones((2, 2)), system.Q[0])
        _, P1 = kalman.predict(np.zeros((1, n)), P1, system.Phi, system.Q)
        _, P2 = kalman.predict(np.zeros((1, n)), P2, system.Phi, system.Q)
        u = kalman.update(np.zeros((1, n)), P1, np.zeros((1, 2)), system.H, system.R)
        K = u.gain[0]
        A = block_diag((np.eye(n) - K @ system.H[0]) @ Phi, Phi)
        B = block_diag(np.eye(n) - K @ system.H[0], np.eye(n))
        J = A @ J @ A.T + B @ Q @ B.T
        J[:n, :n] += K @ np.diag(system.R[0]) @ K.T
        P1 = u.P
        joint = J[:n, :n] + J[n:, n:] - J[:n, n:] - J[n:, :n]
        assert np.abs((P2 - P1)[0] / unit - joint / unit).max() < 1e-12 * np.abs(P2[0] / unit).max()


def test_state_test_is_chi_square_on_the_rank_it_states():
    """One scalar measurement per epoch: the rank grows by one each epoch, and the law follows it."""
    system = Linear(5, n=6, m=1)
    (x1, P1), (x2, P2) = system.start(), system.start()
    result = state_chi_square(x1, P1, x2, P2, 0.02, "gps")
    assert not result.dof.any()
    assert not result.alarm.any()
    for k in range(1, 5):
        x1, P1 = kalman.predict(x1, P1, system.Phi, system.Q)
        x2, P2 = kalman.predict(x2, P2, system.Phi, system.Q)
        u = kalman.update(x1, P1, system.measure(), system.H, system.R)
        x1, P1 = u.x, u.P
        result = state_chi_square(x1, P1, x2, P2, 0.02, "gps")
        assert (result.dof <= k).all()
        if k == 1:
            assert (result.dof == 1).all()
        # Leaving directions out keeps the others exactly chi-square (they are uncorrelated): Kolmogorov-Smirnov.
        assert kstest(result.statistic, chi2(result.dof[0]).cdf).pvalue > FALSE_FAILURE
        assert_rate(result.alarm, 0.02)
    assert result.dof[0] > 1


def test_state_test_detects_with_the_noncentral_probability():
    system = Linear(6, n=4, m=2)
    (x1, P1), (x2, P2) = system.start(), system.start()
    bias_effect = np.zeros(4)
    for k in range(12):
        bias = np.array([1.5, 0.0]) * (k >= 6)
        x1, P1 = kalman.predict(x1, P1, system.Phi, system.Q)
        x2, P2 = kalman.predict(x2, P2, system.Phi, system.Q)
        u = kalman.update(x1, P1, system.measure(bias), system.H, system.R)
        x1, P1 = u.x, u.P
        K = u.gain[0]
        bias_effect = (np.eye(4) - K @ system.H[0]) @ system.Phi[0] @ bias_effect + K @ bias
    result = state_chi_square(x1, P1, x2, P2, 1e-2, "gps")
    assert (result.dof == 4).all()
    noncentrality = bias_effect @ np.linalg.solve(result.covariance[0], bias_effect)
    assert_rate(result.alarm, ncx2.sf(threshold(1e-2, 4), 4, noncentrality))


def test_state_test_does_not_depend_on_units():
    rng = np.random.default_rng(7)
    x1, x2, P1 = rng.normal(size=(3, 6)), rng.normal(size=(3, 6)), spd(rng, 3, 6)
    P2 = P1 + spd(rng, 3, 6)
    u = 10.0 ** rng.uniform(-8, 8, size=6)
    a = state_chi_square(x1, P1, x2, P2, 1e-3, "a")
    b = state_chi_square(x1 * u, P1 * np.outer(u, u), x2 * u, P2 * np.outer(u, u), 1e-3, "a")
    np.testing.assert_allclose(a.statistic, b.statistic, rtol=1e-8)
    np.testing.assert_array_equal(a.dof, b.dof)


def test_state_test_of_inflated_filters_is_conservative():
    """With Q and P(0) doubled, W overstates: alarms fall far below the nominal rate (binomial, one sided)."""
    system = Linear(8)
    x1, P1 = system.start()
    x1, x2, P1, P2 = x1, x1, 2 * P1, 2 * P1
    for _ in range(10):
        x1, P1 = kalman.predict(x1, P1, system.Phi, 2 * system.Q)
        x2, P2 = kalman.predict(x2, P2, system.Phi, 2 * system.Q)
        u = kalman.update(x1, P1, system.measure(), system.H, system.R)
        x1, P1 = u.x, u.P
    alarms = state_chi_square(x1, P1, x2, P2, 0.05, "gps").alarm
    assert np.count_nonzero(alarms) < binom.ppf(FALSE_FAILURE, alarms.size, 0.05)


def test_both_forms_of_the_propagator_test_agree_when_the_update_starts_from_the_propagator():
    system = Linear(9, n=15, m=3, runs=50)
    pair = propagate(start_propagators(*system.start()), system.Phi, system.Q)
    y = system.measure()
    innovation = two_propagator_test(pair, y, system.H, system.R, 1e-3, "gps")
    x_S, P_S = pair.estimate()
    u = kalman.update(x_S, P_S, y, system.H, system.R)
    state = state_chi_square(u.x, u.P, x_S, P_S, 1e-3, "gps", name="two-propagator")
    assert (innovation.dof == 3).all()
    assert (state.dof == 3).all()
    np.testing.assert_allclose(innovation.statistic, state.statistic, rtol=1e-8)
    assert innovation.name == state.name == "two-propagator"


def test_propagator_test_keeps_its_false_alarm_rate_at_any_age():
    """Runs are independent; epochs are not, so each is judged alone (10 assertions)."""
    system = Linear(10)
    x, P = system.start()
    pair = start_propagators(x, P)
    for k in range(1, 11):
        x, P = kalman.predict(x, P, system.Phi, system.Q)
        pair = propagate(pair, system.Phi, system.Q)
        y = system.measure()
        assert_rate(two_propagator_test(pair, y, system.H, system.R, 0.01, "gps").alarm, 0.01)
        u = kalman.update(x, P, y, system.H, system.R)
        x, P = u.x, u.P
        assert_rate(state_chi_square(x, P, *pair.estimate(), 0.01, "gps").alarm, 0.01)
        if k % 3 == 0:
            pair = alternate(pair, x, P)


def test_the_reference_is_the_older_one_and_never_one_just_reset():
    """First run: reset in every period. Second run: under suspicion in periods 2 and 3, so nothing changes there."""
    n = 2
    pair = start_propagators(np.zeros((2, n)), np.ones((2, 1, 1)) * np.eye(n))
    reference = []
    for k in range(1, 7):
        trusted = np.array([True, k not in (2, 3)])
        pair = alternate(pair, np.full((2, n), float(k)), k * np.ones((2, 1, 1)) * np.eye(n), where=trusted)
        x, P = pair.estimate()
        np.testing.assert_array_equal(P, np.maximum(x[:, :1, None], 1.0) * np.eye(n))
        reference.append(x[:, 0].tolist())
    assert reference == [[0, 0], [1, 0], [2, 0], [3, 1], [4, 4], [5, 5]]


def test_a_test_result_is_a_value_and_not_a_pytest_class():
    assert TestResult.__test__ is False
    result = residual_test(
        kalman.innovation(np.zeros((1, 2)), np.eye(2)[None], np.ones((1, 1)), np.ones((1, 1, 2)), np.ones((1, 1))),
        1e-3,
        "gps",
    )
    with pytest.raises(AttributeError):
        result.alarm = np.array([True])
    assert chi_square.RANK_TOLERANCE == 1e-4
