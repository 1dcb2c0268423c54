"""All subsets at once against one Kalman update a subset, (35)-(36) written out, and what a lost subsystem may cost."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from ftcore.estimation import imm, kalman
from ftcore.estimation import tolerant_fusion as tf
from ftcore.estimation.tolerant_fusion import Layout

THREE = Layout(("gps", "bd2", "cns"), (3, 3, 3))
UNLIKE = Layout(("gps", "doppler"), (16, 3))


def spd(rng, *shape):
    A = rng.normal(size=(*shape, shape[-1]))
    return A @ A.swapaxes(-1, -2) + np.eye(shape[-1])


class Case:
    """A prior of M models and one measurement of all subsystems, states in units from metres to microradians."""

    def __init__(self, seed, layout, runs=3, M=2, n=15):
        rng = np.random.default_rng(seed)
        units = 10.0 ** rng.uniform(-6, 2, size=n)
        m = layout.rows
        self.layout = layout
        self.prior = imm.Mixture(
            rng.normal(size=(runs, M, n)) * units,
            spd(rng, runs, M, n) * (units[:, None] * units),
            np.log(rng.dirichlet(np.ones(M), size=runs)),
        )
        self.H = rng.normal(size=(runs, m, n)) / units
        self.R = rng.uniform(0.5, 2.0, size=m)
        self.y = 4.0 * rng.normal(size=(runs, m))
        self.beta = rng.random((runs, len(layout.sizes)))
        self.beta[0] = rng.integers(0, 2, len(layout.sizes))
        self.q = rng.chisquare(3, size=self.beta.shape)
        self.units = units

    def updates(self, valid=None):
        return tf.subset_updates(self.prior, self.y, self.H, self.R, self.layout, valid)

    def by_kalman(self, subset, valid=None):
        """The update of every model with the rows of one subset, by deleting the others."""
        rows = np.concatenate([np.r_[s] for s, inside in zip(self.layout.slices, subset, strict=True) if inside])
        seen = None if valid is None else valid[:, None, rows]
        return kalman.update(
            self.prior.x, self.prior.P, self.y[:, None, rows], self.H[:, None, rows], self.R[rows], seen
        )


@pytest.mark.parametrize("layout", [THREE, UNLIKE, Layout(("one",), (2,)), Layout(tuple("abcd"), (1, 2, 1, 3))])
def test_every_subset_is_the_kalman_update_with_its_measurements(layout):
    case = Case(1, layout)
    updates = case.updates()
    x, P = updates.x(), updates.P()
    subsets = tf.members(len(layout.sizes))
    np.testing.assert_array_equal(x[:, :, 0], case.prior.x)
    np.testing.assert_array_equal(P[:, :, 0], case.prior.P)
    unit = case.units[:, None] * case.units
    for A in range(1, len(subsets)):
        u = case.by_kalman(subsets[A])
        np.testing.assert_allclose(x[:, :, A] / case.units, u.x / case.units, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(P[:, :, A] / unit, u.P / unit, rtol=1e-9, atol=1e-9)


def test_every_gain_is_the_posterior_times_h_over_r():
    """(20), (24), (28), (32)-(34), and information that adds up, (19), (23), (27), (31), in states of one unit."""
    case = Case(2, THREE)
    case.prior = imm.Mixture(case.prior.x / case.units, spd(np.random.default_rng(2), 3, 2, 15), case.prior.log_mu)
    case.H = case.H * case.units
    updates = case.updates()
    x, P, nu = updates.x(), updates.P(), case.y[:, None] - np.matvec(case.H[:, None], case.prior.x)
    for A, subset in enumerate(tf.members(3)):
        inside = subset @ THREE.membership
        weight = inside / case.R
        K = P[:, :, A] @ case.H[:, None].swapaxes(-1, -2) * weight
        np.testing.assert_allclose(x[:, :, A], case.prior.x + np.matvec(K, nu), rtol=1e-8, atol=1e-8)
        information = np.linalg.inv(case.prior.P) + (case.H.swapaxes(-1, -2) * weight @ case.H)[:, None]
        np.testing.assert_allclose(np.linalg.inv(P[:, :, A]), information, rtol=1e-7, atol=1e-7)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=5))
def test_the_weights_are_probabilities_of_who_is_valid(beta):
    alpha = tf.subset_weights(np.array([beta]))[0]
    assert alpha.sum() == pytest.approx(1.0, abs=1e-12)
    assert (alpha >= 0.0).all()
    for A, subset in enumerate(tf.members(len(beta))):
        assert alpha[A] == pytest.approx(np.prod([b if i else 1 - b for b, i in zip(beta, subset, strict=True)]))


def test_the_weights_of_three_are_those_of_the_paper_by_inclusion_and_exclusion():
    """(17) as printed, but for SINS alone, whose products of two have the wrong sign there."""
    b, g, c = beta = np.array([0.3, 0.8, 0.6])
    alpha = dict(zip(tf.subset_names(("bd2", "gps", "cns")), tf.subset_weights(beta[None])[0], strict=True))
    assert alpha["bd2"] == pytest.approx(b - b * g - b * c + b * g * c)
    assert alpha["gps"] == pytest.approx(g - b * g - g * c + b * g * c)
    assert alpha["cns"] == pytest.approx(c - b * c - g * c + b * g * c)
    assert alpha["bd2+gps"] == pytest.approx(b * g - b * g * c)
    assert alpha["bd2+cns"] == pytest.approx(b * c - b * g * c)
    assert alpha["gps+cns"] == pytest.approx(g * c - b * g * c)
    assert alpha["bd2+gps+cns"] == pytest.approx(b * g * c)
    assert alpha["sins"] == pytest.approx(1 - b - g - c + b * g + b * c + g * c - b * g * c)


@pytest.mark.parametrize("layout", [THREE, UNLIKE])
def test_fusion_is_35_and_36_written_out_for_every_model(layout):
    case = Case(3, layout)
    updates = case.updates()
    fused = tf.fuse(updates, case.beta, case.q)
    alpha = tf.subset_weights(case.beta)
    np.testing.assert_array_equal(fused.alpha, alpha)
    x_A, P_A = updates.x(), updates.P()
    unit = case.units[:, None] * case.units
    x = np.einsum("rs,rmsn->rmn", alpha, x_A)
    d = x_A - x[:, :, None]
    P = np.einsum("rs,rmsab->rmab", alpha, P_A + d[..., :, None] * d[..., None, :])
    np.testing.assert_allclose(fused.mixture.x / case.units, x / case.units, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(fused.mixture.P / unit, P / unit, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(fused.mixture.P, fused.mixture.P.swapaxes(-1, -2))


def test_fusing_every_model_and_then_combining_is_combining_every_subset_and_then_fusing():
    """A mixture over models and subsets has one mean and covariance, whichever is summed first."""
    case = Case(4, THREE)
    updates = case.updates()
    fused = tf.fuse(updates, case.beta, case.q)
    x_A, P_A = updates.x(), updates.P()
    by_subset = [imm.combine(imm.Mixture(x_A[:, :, A], P_A[:, :, A], fused.mixture.log_mu)) for A in range(8)]
    x, P = (np.stack([estimate[part] for estimate in by_subset], axis=1) for part in (0, 1))
    with np.errstate(divide="ignore"):
        x, P = imm.combine(imm.Mixture(x, P, np.log(fused.alpha)))
    unit = case.units[:, None] * case.units
    np.testing.assert_allclose(fused.x / case.units, x / case.units, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(fused.P / unit, P / unit, rtol=1e-8, atol=1e-8)


def test_given_all_valid_then_it_is_the_plain_update_and_given_none_the_prediction():
    case = Case(5, THREE)
    ones = np.ones_like(case.beta)
    everyone, nobody = tf.fuse(case.updates(), ones, case.q), tf.fuse(case.updates(), 0.0 * ones, case.q, "accepted")
    plain = case.by_kalman([True] * 3)
    unit = case.units[:, None] * case.units
    np.testing.assert_allclose(everyone.mixture.x / case.units, plain.x / case.units, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(everyone.mixture.P / unit, plain.P / unit, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(nobody.mixture.x, case.prior.x)
    np.testing.assert_allclose(nobody.mixture.P / unit, case.prior.P / unit, rtol=1e-14)
    np.testing.assert_allclose(nobody.mixture.mu, case.prior.mu, rtol=1e-12)
    assert (nobody.driver == -1).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_fused_covariance_is_positive_and_no_less_than_that_with_all_of_them(seed):
    case = Case(seed, THREE, runs=2, n=9)
    fused = tf.fuse(case.updates(), case.beta, case.q)
    scale = np.sqrt(np.einsum("rmaa->rma", case.prior.P))
    least = case.by_kalman([True] * 3).P
    excess = (fused.mixture.P - least) / (scale[..., :, None] * scale[..., None, :])
    assert np.linalg.eigvalsh(excess).min() > -1e-10


@pytest.mark.parametrize("drives", tf.DRIVES)
def test_a_missing_subsystem_is_as_if_it_had_never_been(drives):
    """Switched off or without a reading: NaN in its rows reaches nothing, and its beta does not count."""
    case = Case(6, THREE)
    valid = np.ones((3, 9), dtype=bool)
    valid[:, 3:6] = False
    case.y[:, 3:6], case.H[:, 3:6] = np.nan, np.nan
    fused = tf.fuse(case.updates(valid), np.ones_like(case.beta), np.zeros_like(case.q), drives)
    two = Case(6, THREE)
    two.layout = Layout(("gps", "cns"), (3, 3))
    keep = np.r_[0:3, 6:9]
    two.y, two.H, two.R = two.y[:, keep], two.H[:, keep], two.R[keep]
    expected = tf.fuse(two.updates(), np.ones((3, 2)), np.zeros((3, 2)), drives)
    np.testing.assert_allclose(fused.x, expected.x, rtol=1e-10)
    np.testing.assert_allclose(fused.mixture.log_mu, expected.mixture.log_mu, rtol=1e-10)
    names = tf.subset_names(THREE.names)
    assert fused.alpha[0, names.index("gps+cns")] == 1.0
    assert (fused.alpha[:, ["bd2" in name for name in names]] == 0.0).all()


def test_given_half_of_the_satellites_then_only_their_rows_count():
    case = Case(7, UNLIKE)
    valid = np.random.default_rng(7).random((3, 19)) < 0.6
    case.y = np.where(valid, case.y, np.nan)
    updates = case.updates(valid)
    np.testing.assert_array_equal(updates.dof, [[v[:16].sum(), v[16:].sum()] for v in valid])
    for A, subset in enumerate(tf.members(2)[1:], start=1):
        u = case.by_kalman(subset, valid)
        np.testing.assert_allclose(updates.x()[:, :, A] / case.units, u.x / case.units, rtol=1e-9, atol=1e-9)
    gps = case.by_kalman([True, False], valid)
    np.testing.assert_allclose(updates.log_likelihood[:, :, 0], gps.log_likelihood, rtol=1e-9)


def test_the_mode_probabilities_follow_the_subsystem_with_the_smallest_q():
    case = Case(8, THREE, runs=200)
    updates = case.updates()
    fused = tf.fuse(updates, np.ones_like(case.beta), case.q)
    np.testing.assert_array_equal(fused.driver, case.q.argmin(axis=1))
    for i, rows in enumerate(THREE.slices):
        inn = kalman.innovation(case.prior.x, case.prior.P, case.y[:, None, rows], case.H[:, None, rows], case.R[rows])
        np.testing.assert_allclose(updates.log_likelihood[:, :, i], inn.log_likelihood, rtol=1e-9)
        mine = fused.driver == i
        expected = imm.reweigh(case.prior.log_mu, inn.log_likelihood)
        np.testing.assert_allclose(fused.mixture.log_mu[mine], expected[mine], rtol=1e-8, atol=1e-10)


def test_given_all_rejected_then_the_smallest_q_still_drives_unless_only_accepted_ones_may():
    case = Case(9, THREE)
    nothing, q = np.zeros_like(case.beta), 20.0 + case.q
    as_printed = tf.fuse(case.updates(), nothing, q)
    np.testing.assert_array_equal(as_printed.driver, q.argmin(axis=1))
    assert (tf.fuse(case.updates(), nothing, q, "accepted").driver == -1).all()
    some = nothing.copy()
    some[:, 2] = 0.1
    assert (tf.fuse(case.updates(), some, q, "accepted").driver == 2).all()


def test_subsystems_of_unlike_size_are_compared_by_their_tail_probability():
    rng = np.random.default_rng(10)
    dof = np.array([[16, 3]]) * np.ones((4000, 1), dtype=int)
    q = rng.chisquare(dof)
    smallest = chi2.sf(q, dof).argmax(axis=1)
    assert np.mean(tf.driver(q, dof, dof > 0) == smallest) > 0.99
    assert 0.45 < np.mean(tf.driver(q, dof, dof > 0) == 0) < 0.55, "nobody is favoured for having fewer rows"


@pytest.mark.parametrize("sigmas", [1e3, 1e6])
def test_given_a_gross_fault_on_all_then_every_number_stays_finite(sigmas):
    case = Case(11, THREE)
    case.y = case.y + sigmas
    fused = tf.fuse(case.updates(), np.zeros_like(case.beta), np.full_like(case.q, sigmas**2))
    for numbers in (fused.mixture.log_mu, fused.x, fused.P):
        assert np.isfinite(numbers).all()
    np.testing.assert_allclose(np.exp(fused.mixture.log_mu).sum(axis=1), 1.0)


def test_run_k_of_a_batch_is_run_k_alone():
    case = Case(12, THREE, runs=40)
    together = tf.fuse(case.updates(), case.beta, case.q)
    for k in (0, 17, 39):
        one = slice(k, k + 1)
        prior = imm.Mixture(case.prior.x[one], case.prior.P[one], case.prior.log_mu[one])
        updates = tf.subset_updates(prior, case.y[one], case.H[one], case.R, THREE)
        alone = tf.fuse(updates, case.beta[one], case.q[one])
        np.testing.assert_allclose(together.x[one], alone.x, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(together.P[one], alone.P, rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("full", [False, True])
def test_measurement_noise_may_be_variances_or_blocks(full):
    case = Case(13, THREE)
    by_run = np.repeat(case.R[None], 3, axis=0)
    case_R, case.R = case.R, by_run[:, :, None] * np.eye(9) if full else by_run
    x = case.updates().x()
    case.R = case_R
    np.testing.assert_array_equal(x, case.updates().x())


def test_bad_input_is_refused_with_what_would_be_right():
    case = Case(14, THREE)
    with pytest.raises(ValueError, match="have 9 rows in all, but y has 8"):
        tf.subset_updates(case.prior, case.y[:, :8], case.H, case.R, THREE)
    with pytest.raises(ValueError, match="smallest, accepted, not 'largest'"):
        tf.fuse(case.updates(), case.beta, case.q, "largest")
    for names, sizes in itertools.product([("a",), ()], [(), (0,), (1, 2)]):
        with pytest.raises(ValueError, match="one positive number of rows"):
            Layout(names, sizes)
