"""Calibration of the parity vector in flight: closed forms, exact false-alarm rates, and what a fault may teach it."""

import numpy as np
from scipy.stats import binom, chi2

from ftcore.detection import parity, parity_calibration
from ftcore.detection.geometry import three_two_dof
from ftcore.detection.parity_space import uncalibrated

CLUSTER = three_two_dof()
UNIT = uncalibrated(CLUSTER, 1.0, 0.0)
SCALE = 3e-4
SWING = 5e4
"""A rate that a scale factor of 1-sigma turns into 15 sigmas of noise."""


def started(rng, rows, bias=5.0, scale=SCALE):
    """Clusters of drawn biases and scale factors, and what a calibration at rest says of them."""
    b, s = bias * rng.standard_normal((rows, 6)), scale * rng.standard_normal((rows, 6))
    sigmas = np.full(rows, scale)
    rest = b + 0.1 * rng.standard_normal((rows, 6))
    known = parity_calibration.start(CLUSTER, rest, np.zeros((rows, 3)), np.full(rows, bias), 0.1, sigmas)
    return b, s, sigmas, known


def flown(known, sigmas, b, s, rates, rng, fault=None):
    """Statistic of every epoch, and what is known at the end."""
    q, rows = [], len(b)
    everybody, nobody = np.ones(rows, bool), np.zeros(rows, bool)
    for t, x in enumerate(rates):
        m = (CLUSTER.H @ x) * (1.0 + s) + b + rng.standard_normal((rows, 6))
        if fault is not None:
            m = m + fault(t)
        measured = np.matvec(CLUSTER.gains[-1], m)
        expected = parity_calibration.expected(known, CLUSTER, measured, sigmas)
        sight = parity.look(parity_calibration.reference(UNIT, expected), m, 0.01)
        q.append(sight.FD)
        p = np.matvec(CLUSTER.V, m)
        known = parity_calibration.learn(known, expected, p, everybody, nobody)
    return np.array(q), known


def manoeuvre(epochs):
    """Rates that come and go about all axes."""
    t = np.arange(epochs)[:, None]
    return SWING * np.maximum(np.sin(0.2 * t + np.array([0.0, 2.0, 4.0])), 0.0)


def test_given_no_motion_then_the_mean_is_that_of_all_readings():
    """Known oracle: of a constant in white noise a Kalman filter makes the weighted mean; the wander adds 1e-3."""
    rng = np.random.default_rng(1)
    b, _, sigmas, known = started(rng, 50)
    readings = b + rng.standard_normal((20, 50, 6))
    for m in readings:
        expected = parity_calibration.expected(known, CLUSTER, np.zeros((50, 3)), sigmas)
        known = parity_calibration.learn(known, expected, m @ CLUSTER.V.T, np.ones(50, bool), np.zeros(50, bool))
    rng = np.random.default_rng(1)
    b, _, _, at_rest = started(rng, 50)
    prior, weight = at_rest.now.x[:, :3], 1.0 / at_rest.now.P[0, 0, 0]
    mean = (weight * prior + (readings @ CLUSTER.V.T).sum(axis=0)) / (weight + 20.0)
    np.testing.assert_allclose(known.now.x[:, :3], mean, atol=5e-3)
    np.testing.assert_allclose(known.now.P[:, 0, 0], 1.0 / (weight + 20.0), rtol=0.1)


def test_given_a_healthy_cluster_manoeuvres_then_the_statistic_is_chi_square_3_and_white():
    """Innovations are white, so epochs are trials: exact binomial bands, false failure 1e-6 each. The wander, which is
    not in what is flown, makes S 1 % too large in places; the bands are widened by a twentieth for that."""
    rng = np.random.default_rng(2)
    b, s, sigmas, known = started(rng, 250)
    q, _ = flown(known, sigmas, b, s, manoeuvre(60), rng)
    for level in (0.1, 0.01, 1e-3):
        low, high = binom.ppf([5e-7, 1 - 5e-7], q.size, level)
        assert 0.95 * low <= (q > chi2.isf(level, 3)).sum() <= 1.05 * high, level
    neighbours = np.mean((q[1:] - 3.0) * (q[:-1] - 3.0)) / q.var()
    assert abs(neighbours) < 5.0 / np.sqrt(q[1:].size)


def test_given_scale_factors_are_flown_then_they_are_known_where_parity_can_see_them():
    rng = np.random.default_rng(3)
    b, s, sigmas, known = started(rng, 100)
    _, known = flown(known, sigmas, b, s, manoeuvre(60), rng)
    x = np.tile([SWING, 0.0, -SWING], (100, 1))
    expected = parity_calibration.expected(known, CLUSTER, x, sigmas)
    true = ((CLUSTER.H @ x[0]) * s + b) @ CLUSTER.V.T
    error = expected.mean - true
    assert np.sqrt(np.mean(true**2)) > 8.0
    assert np.sqrt(np.mean(error**2)) < 1.5
    within = np.vecdot(error, np.linalg.solve(expected.spread, error[..., None])[..., 0])
    assert within.sum() < chi2.isf(1e-6, 300), "the wander makes it more careful than need be, never less"


def test_given_an_instrument_steps_then_it_is_seen_for_ever_and_nothing_is_learned_of_it():
    rng = np.random.default_rng(4)
    b, s, sigmas, known = started(rng, 50)
    _, before = flown(known, sigmas, b, s, manoeuvre(40), rng)
    step = np.array([12.0, 0, 0, 0, 0, 0])
    q, after = flown(before, sigmas, b, s, np.zeros((100, 3)), rng, lambda t: step)
    assert (q > chi2.isf(0.01, 3)).mean() > 0.999
    assert np.abs(after.now.x[:, :3] - before.now.x[:, :3]).max() < 0.5


def test_given_a_fault_is_found_then_what_was_learned_of_its_onset_is_forgotten():
    rng = np.random.default_rng(5)
    b, s, sigmas, known = started(rng, 4)
    _, known = flown(known, sigmas, b, s, np.zeros((40, 3)), rng)
    before = known.now.x[:, :3].copy()
    slope = np.array([0.15, 0, 0, 0, 0, 0])
    _, ramped = flown(known, sigmas, b, s, np.zeros((15, 3)), rng, lambda t: slope * t)
    expected = parity_calibration.expected(ramped, CLUSTER, np.zeros((4, 3)), sigmas)
    nobody, guilty = np.zeros(4, bool), np.array([True, True, False, False])
    back = parity_calibration.learn(ramped, expected, np.zeros((4, 3)), nobody, guilty)
    moved = np.linalg.norm(ramped.now.x[:, :3] - before, axis=-1)
    left = np.linalg.norm(back.now.x[:, :3] - before, axis=-1)
    assert (left[:2] < 0.5 * moved[:2]).all()
    np.testing.assert_array_equal(back.now.x[2:], ramped.now.x[2:])


def test_given_no_noise_at_all_then_huge_rates_and_biases_leave_numbers():
    sigmas = np.full(2, 0.1)
    rest = np.full((2, 6), 1e5)
    known = parity_calibration.start(CLUSTER, rest, np.full((2, 3), 1e12), np.full(2, 1e5), 0.01, sigmas)
    for x in (np.full((2, 3), 1e12), np.full((2, 3), -1e3), np.zeros((2, 3))):
        expected = parity_calibration.expected(known, CLUSTER, x, sigmas)
        sight = parity.look(parity_calibration.reference(UNIT, expected), np.matvec(CLUSTER.H, x), 0.01)
        assert np.isfinite(sight.FD).all()
        known = parity_calibration.learn(
            known, expected, np.matvec(CLUSTER.V, np.matvec(CLUSTER.H, x)), np.ones(2, bool), np.zeros(2, bool)
        )
        assert np.isfinite(known.now.P).all()
