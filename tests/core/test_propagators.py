"""Every subsystem against the reference: the law of q without and with a fault, both forms, and what is carried."""

import numpy as np
import pytest
from scipy.stats import binom, chi2, kstest, ncx2

from ftcore.detection import propagators as pg
from ftcore.detection.chi_square import (
    Propagators,
    alternate,
    start_propagators,
    state_chi_square,
    two_propagator_test,
)
from ftcore.estimation import imm, kalman
from ftcore.estimation import tolerant_fusion as tf
from ftcore.estimation.tolerant_fusion import Layout

FALSE_FAILURE = 1e-6
"""Two-sided probability that a statistical assertion here fails on right code (seeds are fixed all the same)."""

LAYOUT = Layout(("gps", "bd2", "cns"), (3, 3, 3))
TRANSITION = imm.transition_matrix([[0.98, 0.02], [0.02, 0.98]])


def assert_rate(alarms, p):
    """The number of alarms lies in the exact binomial band of independent trials with probability p."""
    low, high = binom.ppf([FALSE_FAILURE / 2, 1 - FALSE_FAILURE / 2], alarms.size, p)
    assert low <= np.count_nonzero(alarms) <= high, f"{alarms.mean():.5f}, expected {p:.5f}"


class Flight:
    """Position, velocity and attitude of a toy INS, three states each, tilt making velocity: seen as GPS, BD2, CNS."""

    Phi = np.eye(9)[None]
    Phi = Phi + np.kron(np.array([[0, 1, 0], [0, 0, 9.8], [0, 0, 0]]), np.eye(3)) * 1.0
    Q = np.diag([1e-2] * 3 + [1e-3] * 3 + [1e-9] * 3)[None]
    H = np.zeros((1, 9, 9))
    H[0, 0:3, 0:3] = H[0, 3:6, 0:3] = H[0, 6:9, 6:9] = np.eye(3)
    R = np.array([9.0] * 3 + [7.0] * 3 + [2e-8] * 3)
    P0 = np.diag([25.0] * 3 + [0.04] * 3 + [1e-6] * 3)[None]

    def __init__(self, seed, runs, ratio=100.0):
        self.rng, self.runs = np.random.default_rng(seed), runs
        self.Q_models = np.stack([self.Q[0], ratio * self.Q[0]])[None]
        self.x = self.rng.normal(size=(runs, 9)) * np.sqrt(np.diagonal(self.P0[0]))

    def step(self, model=0):
        """One epoch on; readings of all three, (runs, 9), relative to an INS that is not corrected."""
        noise = self.rng.normal(size=self.x.shape) * np.sqrt(np.diagonal(self.Q_models[0, model]))
        self.x = self.x @ self.Phi[0].T + noise
        return self.x @ self.H[0].T + self.rng.normal(size=(self.runs, 9)) * np.sqrt(self.R)

    def start(self):
        return np.zeros((self.runs, 9)), np.broadcast_to(self.P0, (self.runs, 9, 9))


def test_a_propagator_carried_on_is_the_combined_prediction_of_a_whole_imm():
    flight = Flight(1, 4)
    whole = imm.start(*flight.start(), [0.9, 0.1])
    pair = start_propagators(*flight.start())
    for _ in range(40):
        whole = imm.predict(whole, flight.Phi, flight.Q_models, TRANSITION)
        pair = pg.carry(pair, flight.Phi, flight.Q_models, whole.mu)
    x, P = imm.combine(whole)
    np.testing.assert_allclose(pair.estimate()[0], x, rtol=1e-10)
    np.testing.assert_allclose(pair.estimate()[1], P, rtol=1e-10, atol=1e-15)
    assert whole.mu[0, 1] == pytest.approx(0.5 - 0.4 * 0.96**40), "left alone, the probabilities go to one half"


def test_each_propagator_may_have_mode_probabilities_of_its_own():
    flight = Flight(2, 3)
    pair = start_propagators(*flight.start())
    mu = np.array([[[1.0, 0.0], [0.25, 0.75]]]) * np.ones((3, 1, 1))
    pair = pg.carry(pair, flight.Phi, flight.Q_models, mu)
    for i, factor in enumerate((1.0, 0.25 + 75.0)):
        _, P = kalman.predict(*flight.start(), flight.Phi, factor * flight.Q)
        np.testing.assert_allclose(pair.P[:, i], P, rtol=1e-12)


@pytest.mark.parametrize("age", [1, 30, 60])
def test_without_a_fault_every_q_is_chi_square_on_three(age):
    flight = Flight(age, 5_000)
    pair = start_propagators(*flight.start())
    for _ in range(age):
        y = flight.step()
        pair = pg.carry(pair, flight.Phi, flight.Q_models, np.array([[1.0, 0.0]]))
    tests = pg.innovation_tests(pair, y, flight.H, flight.R, LAYOUT)
    assert (tests.dof == 3).all()
    assert_rate(tests.q[:, 2] > tests.reject[:, 2], 0.01)
    for i in range(3):
        assert_rate(tests.alarm[:, i], 0.01)
        assert_rate(tests.beta[:, i] < 1.0, 0.10)
        assert kstest(tests.q[:, i], chi2(3).cdf).pvalue > FALSE_FAILURE


def test_with_a_fault_the_power_is_that_of_the_noncentral_chi_square():
    flight = Flight(5, 8_000)
    pair = start_propagators(*flight.start())
    for _ in range(30):
        y = flight.step()
        pair = pg.carry(pair, flight.Phi, flight.Q_models, np.array([[1.0, 0.0]]))
    _, P_S = pair.estimate()
    S = (flight.H @ P_S @ flight.H.swapaxes(-1, -2))[0] + np.diag(flight.R)
    for size in (4.0, 12.0, 30.0):
        fault = np.array([size, -size, size])
        tests = pg.innovation_tests(pair, y + np.r_[fault, np.zeros(6)], flight.H, flight.R, LAYOUT)
        noncentrality = fault @ np.linalg.solve(S[:3, :3], fault)
        assert_rate(tests.alarm[:, 0], ncx2.sf(tests.reject[0, 0], 3, noncentrality))
        assert_rate(tests.alarm[:, 1], 0.01)


def test_the_innovation_form_is_12_when_the_update_starts_from_the_reference():
    """q of (12) with x_KF the update of x_S by one subsystem, in all states by its rank and on its own components."""
    flight = Flight(6, 50)
    pair = start_propagators(*flight.start())
    for _ in range(20):
        y = flight.step()
        pair = pg.carry(pair, flight.Phi, flight.Q_models, np.array([[0.7, 0.3]]))
    tests = pg.innovation_tests(pair, y, flight.H, flight.R, LAYOUT)
    x_S, P_S = pair.estimate()
    prior = imm.Mixture(x_S[:, None], P_S[:, None], np.zeros((50, 1)))
    own = pg.state_tests(pair, tf.subset_updates(prior, y, flight.H, flight.R, LAYOUT))
    for i, rows in enumerate(LAYOUT.slices):
        u = kalman.update(x_S, P_S, y[:, rows], flight.H[:, rows], flight.R[rows])
        W = P_S - u.P
        scale = np.sqrt(np.diagonal(P_S, axis1=-2, axis2=-1))
        inverse = np.linalg.pinv(W / (scale[:, :, None] * scale[:, None, :]), rcond=1e-6, hermitian=True)
        d = (u.x - x_S) / scale
        printed = np.einsum("ri,rij,rj->r", d, inverse, d)
        np.testing.assert_allclose(tests.q[:, i], printed, rtol=1e-5)
        np.testing.assert_allclose(tests.q[:, i], own.q[:, i], rtol=1e-9)
        alone = two_propagator_test(pair, y[:, rows], flight.H[:, rows], flight.R[rows], 0.01, "gps")
        np.testing.assert_allclose(tests.q[:, i], alone.statistic, rtol=1e-12)
        in_all_states = state_chi_square(u.x, u.P, x_S, P_S, 0.01, "gps")
        np.testing.assert_array_equal(in_all_states.dof, 3)
    np.testing.assert_array_equal(own.dof, 3)


def test_the_state_form_sees_a_step_later_than_the_innovation_form():
    """GPS is off by 9 m on three axes and believed all the while: the gain lets it into x_KF little by little."""
    flight = Flight(7, 100, ratio=4.0)
    whole = imm.start(*flight.start(), [0.9, 0.1])
    pair = start_propagators(*flight.start())
    first = {"innovation": np.full(100, np.inf), "state": np.full(100, np.inf)}
    for epoch in range(240):
        y = flight.step()
        if epoch >= 150:
            y[:, :3] += 9.0
        prior = imm.predict(whole, flight.Phi, flight.Q_models, TRANSITION)
        pair = pg.carry(pair, flight.Phi, flight.Q_models, prior.mu)
        updates = tf.subset_updates(prior, y, flight.H, flight.R, LAYOUT)
        both = {
            "innovation": pg.innovation_tests(pair, y, flight.H, flight.R, LAYOUT),
            "state": pg.state_tests(pair, updates),
        }
        if epoch >= 150:
            for form, tests in both.items():
                first[form] = np.where(tests.alarm[:, 0], np.minimum(first[form], epoch - 150), first[form])
        fused = tf.fuse(updates, np.ones((100, 3)), both["innovation"].q)
        whole = fused.mixture
        if epoch % 10 == 9:
            pair = alternate(pair, fused.x, fused.P)
    assert np.median(first["innovation"]) <= 1
    assert np.median(first["state"]) > np.median(first["innovation"]) + 2


def test_the_state_form_keeps_its_false_alarm_rate_on_a_matched_filter():
    """One model, true noise: W = P_S - P_KF is exact, so q is chi-square on its three rows; runs are independent."""
    flight = Flight(8, 1_500)
    whole = imm.start(*flight.start(), [1.0])
    pair = start_propagators(*flight.start())
    one = flight.Q_models[:, :1]
    for epoch in range(45):
        y = flight.step()
        prior = imm.predict(whole, flight.Phi, one, np.eye(1))
        pair = pg.carry(pair, flight.Phi, one, prior.mu)
        updates = tf.subset_updates(prior, y, flight.H, flight.R, LAYOUT)
        whole = tf.fuse(updates, np.ones((flight.runs, 3)), np.zeros((flight.runs, 3))).mixture
        if epoch == 20:
            pair = alternate(pair, *imm.combine(whole))
    tests = pg.state_tests(pair, updates)
    assert (tests.dof == 3).all()
    for i in range(3):
        assert_rate(tests.alarm[:, i], 0.01)


def test_the_state_form_believes_where_there_is_nothing_to_hold_against():
    """Right after a start x_KF and x_S are one estimate in what the subsystem has not measured yet."""
    flight = Flight(9, 2)
    exact = imm.Mixture(np.zeros((2, 1, 9)), 1e-12 * np.ones((2, 1, 1, 1)) * np.eye(9), np.zeros((2, 1)))
    pair = start_propagators(exact.x[:, 0], exact.P[:, 0])
    tests = pg.state_tests(pair, tf.subset_updates(exact, flight.step(), flight.H, flight.R, LAYOUT))
    assert (tests.dof[:, :2] == 0).all()
    assert (tests.beta[:, :2] == 1.0).all()
    assert not tests.alarm[:, :2].any()


def test_the_state_form_of_subsystems_of_unlike_size_is_that_of_each_alone():
    """GPS with six rows beside CNS with three: what one says does not depend on how large the other is."""
    flight = Flight(13, 40)
    pair = start_propagators(*flight.start())
    for _ in range(20):
        y = flight.step()
        pair = pg.carry(pair, flight.Phi, flight.Q_models, np.array([[0.7, 0.3]]))
    prior = imm.start(*(0.5 * part for part in pair.estimate()), [0.9, 0.1])
    both = pg.state_tests(pair, tf.subset_updates(prior, y, flight.H, flight.R, Layout(("gnss", "cns"), (6, 3))))
    for i, rows in enumerate((slice(0, 6), slice(6, 9))):
        size = rows.stop - rows.start
        alone = tf.subset_updates(prior, y[:, rows], flight.H[:, rows], flight.R[rows], Layout(("x",), (size,)))
        one = pg.state_tests(pair, alone)
        np.testing.assert_array_equal(both.dof[:, i], one.dof[:, 0])
        np.testing.assert_allclose(both.q[:, i], one.q[:, 0], rtol=1e-9)
    assert (both.dof == 3).all(), "two fixes of one position know three directions"


def test_validity_falls_from_one_to_nothing_between_the_thresholds():
    """(15), whose printed form -q / 5.1 + 11.35 / 5.1 is (11.35 - q) / (11.35 - 6.25)."""
    q = np.array([0.0, 6.25, 6.26, 8.8, 11.34, 11.35, 1e12])
    low, high = np.array(6.25), np.array(11.35)
    expected = np.array([1.0, 1.0, -6.26 / 5.1 + 11.35 / 5.1, 0.5, -11.34 / 5.1 + 11.35 / 5.1, 0.0, 0.0])
    np.testing.assert_allclose(pg.validity(q, low, high), expected, atol=1e-12)
    tests = pg.innovation_tests(start_propagators(*Flight(1, 1).start()), np.zeros((1, 9)), Flight.H, Flight.R, LAYOUT)
    np.testing.assert_allclose(tests.suspect, 6.25, atol=0.005)
    np.testing.assert_allclose(tests.reject, 11.35, atol=0.006)


@pytest.mark.parametrize("form", ["innovation", "state"])
def test_a_missing_subsystem_is_not_judged_and_not_believed(form):
    flight = Flight(10, 3)
    pair = start_propagators(*flight.start())
    y, valid = flight.step(), np.ones((3, 9), dtype=bool)
    y[:, 3:6], valid[:, 3:6], valid[:, 0] = np.nan, False, False
    if form == "innovation":
        tests = pg.innovation_tests(pair, y, flight.H, flight.R, LAYOUT, valid)
    else:
        prior = imm.start(*flight.start(), [0.9, 0.1])
        tests = pg.state_tests(pair, tf.subset_updates(prior, y, flight.H, flight.R, LAYOUT, valid))
    np.testing.assert_array_equal(tests.dof, [[2, 0, 3]] * 3)
    np.testing.assert_array_equal(tests.present, [[True, False, True]] * 3)
    np.testing.assert_allclose(tests.reject, np.where(tests.dof > 0, chi2.isf(0.01, np.maximum(tests.dof, 1)), 0.0))
    for numbers in (tests.q, tests.beta):
        assert np.isfinite(numbers).all()
        assert (numbers[:, 1] == 0.0).all()
    assert not tests.alarm[:, 1].any()


def test_results_are_one_a_subsystem_with_what_led_to_them():
    flight = Flight(11, 4)
    pair = start_propagators(*flight.start())
    tests = pg.innovation_tests(pair, flight.step() + 40.0, flight.H, flight.R, LAYOUT)
    results = tests.results()
    assert [r.subject for r in results] == ["gps", "bd2", "cns"]
    for i, r in enumerate(results):
        np.testing.assert_array_equal(r.alarm, tests.alarm[:, i])
        np.testing.assert_array_equal(r.extra["beta"], tests.beta[:, i])
        np.testing.assert_allclose(
            r.statistic, np.einsum("ri,rij,rj->r", r.innovation, np.linalg.inv(r.covariance), r.innovation)
        )


def test_feedback_and_renewal_touch_what_they_should():
    flight = Flight(12, 3)
    pair = pg.carry(start_propagators(*flight.start()), flight.Phi, flight.Q_models, np.array([[0.5, 0.5]]))
    dx = flight.rng.normal(size=(3, 9))
    np.testing.assert_allclose(pg.feed_back(pair, dx).x, pair.x - dx[:, None])
    P = 4.0 * np.broadcast_to(np.eye(9), (3, 9, 9))
    where = np.array([True, False, True])
    anew = pg.renew(pair, dx, P, where)
    assert isinstance(anew, Propagators)
    for i in range(2):
        np.testing.assert_array_equal(anew.x[where, i], dx[where])
        np.testing.assert_array_equal(anew.P[where, i], P[where])
        np.testing.assert_array_equal(anew.x[~where, i], pair.x[~where, i])
    np.testing.assert_array_equal(anew.reference, pair.reference)
    assert pg.renew(pair, dx, P, ~np.ones(3, dtype=bool)) is pair


def test_thresholds_in_the_wrong_order_are_refused():
    pair = start_propagators(*Flight(1, 1).start())
    with pytest.raises(ValueError, match=r"suspected before it is rejected: 0\.01 is not above 0\.1"):
        pg.innovation_tests(pair, np.zeros((1, 9)), Flight.H, Flight.R, LAYOUT, p_suspect=0.01, p_reject=0.1)
