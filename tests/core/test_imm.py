"""The IMM against filterpy's, against closed forms, and against faults that a likelihood cannot be written down for."""

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from ftcore.estimation import imm, kalman

TRANSITION = imm.transition_matrix([[0.98, 0.02], [0.02, 0.98]])


def spd(rng, *shape):
    A = rng.normal(size=(*shape, shape[-1]))
    return A @ A.swapaxes(-1, -2) + np.eye(shape[-1])


def some_mixture(rng, runs, M, n):
    mu = rng.dirichlet(np.ones(M), size=runs)
    return imm.Mixture(rng.normal(size=(runs, M, n)), spd(rng, runs, M, n), np.log(mu))


class Cruise:
    """Position and velocity, seen by position; quiet (model 0) or shaken a hundred times more (model 1)."""

    Phi = np.array([[[1.0, 1.0], [0.0, 1.0]]])
    G = np.array([[0.25, 0.5], [0.5, 1.0]])
    H = np.array([[[1.0, 0.0]]])
    R = np.array([4.0])

    def __init__(self, q=0.01, ratio=100.0):
        self.Q = np.stack([q * self.G, ratio * q * self.G])[None]
        self.q, self.ratio = q, ratio

    def fly(self, rng, runs, modes):
        """Readings (epochs, runs, 1) and true states (epochs, runs, 2); modes (epochs, runs) of 0 and 1."""
        x = np.zeros((runs, 2))
        readings, states = [], []
        for mode in modes:
            shake = np.sqrt(self.q * np.where(mode == 1, self.ratio, 1.0))
            x = x @ self.Phi[0].T + (rng.normal(size=runs) * shake)[:, None] * np.array([0.5, 1.0])
            readings.append(x[:, :1] + rng.normal(size=(runs, 1)) * 2.0)
            states.append(x)
        return np.array(readings), np.array(states)

    def start(self, runs):
        return imm.start(np.zeros((runs, 2)), np.ones((runs, 1, 1)) * np.eye(2), [0.9, 0.1])

    def run(self, readings, mixture=None):
        mixture = self.start(readings.shape[1]) if mixture is None else mixture
        for y in readings:
            mixture, _ = imm.update(imm.predict(mixture, self.Phi, self.Q, TRANSITION), y, self.H, self.R)
            yield mixture


def test_given_three_models_then_it_is_filterpys_imm_to_1e9():
    """filterpy forms its mixing weights at the end of an update, we at the start of a prediction: the same order."""
    rng = np.random.default_rng(3)
    n, m, M = 4, 2, 3
    Phi = 0.6 * rng.normal(size=(M, n, n))
    Q, H, R = spd(rng, M, n), rng.normal(size=(m, n)), spd(rng, m)
    p = imm.transition_matrix([[0.9, 0.06, 0.04], [0.2, 0.7, 0.1], [0.05, 0.15, 0.8]])
    x0, P0, mu0 = rng.normal(size=n), spd(rng, n), [0.5, 0.3, 0.2]
    filters = []
    for j in range(M):
        f = KalmanFilter(dim_x=n, dim_z=m)
        f.x, f.P, f.F, f.Q, f.H, f.R = x0.copy(), P0.copy(), Phi[j], Q[j], H, R
        filters.append(f)
    theirs = IMMEstimator(filters, mu0, p)
    ours = imm.start(x0[None], P0[None], mu0)
    for _ in range(40):
        y = 3.0 * rng.normal(size=m)
        theirs.predict()
        theirs.update(y)
        ours, _ = imm.update(imm.predict(ours, Phi[None], Q[None], p), y[None], H[None], R[None])
        x, P = imm.combine(ours)
        np.testing.assert_allclose(ours.mu[0], theirs.mu, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(ours.x[0], [f.x for f in filters], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(ours.P[0], [f.P for f in filters], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(x[0], theirs.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(P[0], theirs.P, rtol=1e-9, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 6), st.integers(1, 3))
def test_interaction_leaves_the_combined_mean_and_covariance_alone(seed, M, n, runs):
    rng = np.random.default_rng(seed)
    mixture = some_mixture(rng, runs, M, n)
    p = imm.transition_matrix(rng.dirichlet(np.ones(M), size=M))
    mixed = imm.mix(mixture, p)
    np.testing.assert_allclose(mixed.mu, mixture.mu @ p, rtol=1e-12)
    for before, after in zip(imm.combine(mixture), imm.combine(mixed), strict=True):
        np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-9)


def test_given_models_that_never_change_then_each_goes_its_own_way():
    rng = np.random.default_rng(4)
    never = imm.mix(some_mixture(rng, 5, 3, 4), np.eye(3))
    again = imm.mix(never, np.eye(3))
    np.testing.assert_allclose(again.x, never.x, rtol=1e-14)
    np.testing.assert_allclose(again.P, never.P, rtol=1e-14)
    certain = imm.Mixture(never.x, never.P, np.array([0.0, -np.inf, -np.inf]) * np.ones((5, 1)))
    kept = imm.mix(certain, np.eye(3))
    np.testing.assert_array_equal(kept.x, certain.x)
    np.testing.assert_array_equal(imm.combine(kept)[0], certain.x[:, 0])


def test_the_global_prediction_takes_the_predicted_mode_probabilities():
    """With one transition for all models it is the prediction of the combination with Q = sum c_j Q_j."""
    rng = np.random.default_rng(5)
    mixture = some_mixture(rng, 6, 2, 3)
    Phi, Q = rng.normal(size=(1, 3, 3)), np.stack([spd(rng, 3), 100.0 * spd(rng, 3)])[None]
    x, P = imm.combine(imm.predict(mixture, Phi, Q, TRANSITION))
    c = mixture.mu @ TRANSITION
    x_1, P_1 = kalman.predict(*imm.combine(mixture), Phi, np.einsum("rj,jab->rab", c, Q[0]))
    np.testing.assert_allclose(x, x_1, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(P, P_1, rtol=1e-10, atol=1e-10)


def test_the_gain_of_every_model_is_its_posterior_times_h_over_r():
    rng = np.random.default_rng(6)
    prior, y = some_mixture(rng, 4, 2, 5), rng.normal(size=(4, 3))
    H, R = rng.normal(size=(4, 3, 5)), rng.uniform(0.5, 2.0, size=3)
    after, u = imm.update(prior, y, H, R)
    K = after.P @ H[:, None].swapaxes(-1, -2) / R
    np.testing.assert_allclose(u.gain, K, rtol=1e-9, atol=1e-12)
    of_the_prior = prior.P @ H[:, None].swapaxes(-1, -2) / R  # as printed
    assert np.abs(of_the_prior - u.gain).max() > 0.1


def test_a_bank_of_imms_is_each_of_them():
    rng = np.random.default_rng(7)
    runs, bank, M, n, m = 3, 4, 2, 5, 2
    x, P = rng.normal(size=(runs, bank, M, n)), spd(rng, runs, bank, M, n)
    log_mu = np.log(rng.dirichlet(np.ones(M), size=(runs, bank)))
    Phi, Q, H = rng.normal(size=(runs, 1, n, n)), spd(rng, 1, 1, M, n), rng.normal(size=(runs, 1, m, n))
    y, valid = rng.normal(size=(runs, bank, m)), rng.random((runs, bank, m)) < 0.7
    after, u = imm.update(imm.predict(imm.Mixture(x, P, log_mu), Phi, Q, TRANSITION), y, H, np.array([1.0, 2.0]), valid)
    assert u.statistic.shape == (runs, bank, M)
    for i in range(bank):
        one = imm.Mixture(x[:, i], P[:, i], log_mu[:, i])
        one, _ = imm.update(
            imm.predict(one, Phi[:, 0], Q[:, 0], TRANSITION), y[:, i], H[:, 0], np.array([1.0, 2.0]), valid[:, i]
        )
        for name in ("x", "P", "log_mu"):
            np.testing.assert_allclose(getattr(after, name)[:, i], getattr(one, name), rtol=1e-12, atol=1e-12)


def test_given_no_valid_row_then_nothing_changes():
    prior = some_mixture(np.random.default_rng(8), 3, 2, 4)
    nothing = np.full((3, 2), np.nan)
    after, _ = imm.update(prior, nothing, np.full((3, 2, 4), np.nan), np.ones(2), np.zeros((3, 2), dtype=bool))
    np.testing.assert_array_equal(after.x, prior.x)
    np.testing.assert_array_equal(after.P, prior.P)
    np.testing.assert_allclose(after.mu, prior.mu, rtol=1e-14)


@pytest.mark.parametrize("sigmas", [40.0, 1e3, 1e6])
def test_given_a_gross_fault_then_the_imm_is_not_blind_and_comes_back(sigmas):
    """A likelihood of exp(-sigmas^2 / 2) underflows beyond 38 sigma: floors make the models equally likely then."""
    cruise, rng = Cruise(), np.random.default_rng(9)
    readings, _ = cruise.fly(rng, 1, np.zeros((60, 1)))
    *_, before = cruise.run(readings)
    prior = imm.predict(before, cruise.Phi, cruise.Q, TRANSITION)
    y = np.matvec(cruise.H, imm.combine(prior)[0]) + sigmas * 2.0
    hit, _ = imm.update(prior, y, cruise.H, cruise.R)
    assert np.isfinite(hit.log_mu).all()
    assert np.isfinite(hit.P).all()
    assert hit.mu[0, 1] > 0.999, "the wider model explains it better, however badly both do"
    # The wider model's log-likelihood ratio, by its own formula, not a number near one half.
    S = 4.0 + prior.P[0, :, 0, 0]
    nu = (y - prior.x[0, :, :1].T)[0]
    ratio = -0.5 * (nu[0] ** 2 / S[0] - nu[1] ** 2 / S[1] + np.log(S[0] / S[1]))
    expected = prior.log_mu[0, 0] - prior.log_mu[0, 1] + ratio
    assert hit.log_mu[0, 0] - hit.log_mu[0, 1] == pytest.approx(expected, rel=1e-9)
    nxt = imm.predict(hit, cruise.Phi, cruise.Q, TRANSITION)
    assert nxt.mu[0, 0] == pytest.approx(0.02 + 0.96 * hit.mu[0, 0], rel=1e-9), "the transition matrix brings it back"
    quiet = imm.predict(imm.Mixture(prior.x, prior.P, hit.log_mu), cruise.Phi, cruise.Q, TRANSITION)
    for _ in range(100):  # with nothing more to learn from, the probabilities go to the matrix's own
        quiet = imm.predict(quiet, cruise.Phi, cruise.Q, TRANSITION)
    np.testing.assert_allclose(quiet.mu, 0.5, atol=0.02)


def test_given_quiet_flight_and_then_manoeuvre_then_the_probabilities_tell_which():
    cruise, rng = Cruise(q=0.02, ratio=400.0), np.random.default_rng(10)
    modes = np.repeat([0, 1, 0], 100)[:, None] * np.ones((1, 400), dtype=int)
    readings, _ = cruise.fly(rng, 400, modes)
    wide = np.array([m.mu[:, 1] for m in cruise.run(readings)]).mean(axis=1)
    assert wide[60:100].mean() < 0.15
    assert wide[110:200].mean() > 0.7
    assert wide[240:].mean() < 0.15


def test_given_a_matched_model_then_the_nees_is_in_band():
    """Modes drawn from the chain that the IMM assumes: mean 2.008 measured, its spread over 2000 runs 0.013.

    Six of these: 2e-9 outside, taking the IMM, which is not quite the optimal filter, for unbiased.
    """
    cruise, rng, runs = Cruise(q=0.02), np.random.default_rng(11), 2000
    modes = [rng.random(runs) < 0.1]
    for _ in range(119):
        modes.append(np.where(rng.random(runs) < 0.02, ~modes[-1], modes[-1]))
    readings, states = cruise.fly(rng, runs, np.array(modes).astype(int))
    first = imm.start(np.zeros((runs, 2)), np.ones((runs, 1, 1)) * 1e-6 * np.eye(2), [0.9, 0.1])
    ratio = []
    for mixture, x in zip(cruise.run(readings, first), states, strict=True):
        mean, P = imm.combine(mixture)
        ratio.append(kalman.nees(mean - x, P))
    of_runs = np.mean(ratio[20:], axis=0)
    spread = of_runs.std(ddof=1) / np.sqrt(runs)
    assert abs(of_runs.mean() - 2.0) < 6.0 * spread, (of_runs.mean(), spread)


def test_feedback_takes_the_same_from_every_model():
    mixture = some_mixture(np.random.default_rng(12), 3, 2, 4)
    x, P = imm.combine(mixture)
    after, P_after = imm.combine(imm.shift(mixture, x))
    np.testing.assert_allclose(after, 0.0, atol=1e-14)
    np.testing.assert_allclose(P_after, P, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("p", "said"),
    [
        ([[0.9, 0.1]], "square"),
        ([[0.9, 0.2], [0.1, 0.9]], "sums to 1"),
        ([[1.1, -0.1], [0.0, 1.0]], "between 0 and 1"),
        ([[0.0, 1.0], [1.0, 0.0]], "above 0 on the diagonal"),
        ([[np.nan, 1.0], [0.0, 1.0]], "between 0 and 1"),
    ],
)
def test_a_matrix_that_is_no_transition_is_refused(p, said):
    with pytest.raises(ValueError, match=said):
        imm.transition_matrix(p)


@pytest.mark.parametrize("mu", [[0.5, 0.6], [1.0, 0.0], [], [[0.5, 0.5]]])
def test_probabilities_that_are_none_are_refused(mu):
    with pytest.raises(ValueError, match="positive and sum to 1"):
        imm.start(np.zeros((1, 2)), np.eye(2)[None], mu)
