"""Redundant instruments: the papers' geometry, and tests that detect and place faults as often as theory says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, chi2, kstest, ncx2

from ftcore.detection import geometry, parity
from ftcore.detection.chi_square import threshold
from ftcore.detection.geometry import cluster, three_two_dof

FALSE_FAILURE = 1e-6
SET = ("gyros", "gyro 1", "gyro 2", "gyro 3")
SIGMA = 0.01
ALL = np.ones((1, 3), dtype=bool)


def assert_rate(alarms, p):
    low, high = binom.ppf([FALSE_FAILURE / 2, 1 - FALSE_FAILURE / 2], alarms.size, p)
    assert low <= np.count_nonzero(alarms) <= high, f"{alarms.mean():.5f}, expected {p:.5f}"


def fly(instruments, rng, runs, sigma=SIGMA, fault=0.0):
    """Readings of a moving cluster."""
    x = rng.normal(size=(runs, 3))
    return np.matvec(instruments.H, x) + sigma * rng.normal(size=(runs, instruments.axes)) + fault


def a_tetrad():
    """Four one-axis instruments on a cone, and a two-axis one: other numbers of axes than the papers'."""
    cone = [[np.cos(a), np.sin(a), 0.7] for a in np.arange(4) * np.pi / 2]
    return cluster([*cone, [[1, 0, 0], [0, 1, 0]]])


# The geometry of Kim et al.


def test_optimal_geometry_has_the_indices_of_the_paper():
    H = three_two_dof().H
    np.testing.assert_allclose(H.T @ H, 2.0 * np.eye(3), atol=1e-15)  # (24)
    assert np.linalg.det(H.T @ H) == pytest.approx(8.0)
    assert geometry.gnc_index(H) == pytest.approx(1 / np.sqrt(8.0))  # (7)
    np.testing.assert_allclose(geometry.isolability(H), 4.0)  # (15)
    assert geometry.fdi_index(H) == pytest.approx(4.0)  # (16)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0.05, 1.5), min_size=3, max_size=3))
def test_isolability_is_that_of_the_leave_one_out_parity_equations_10_to_15(angles):
    H = geometry.input_axes(*angles)
    F = np.empty(6)
    for i in range(6):
        rest = np.delete(H, i, axis=0)
        v = np.insert(-rest @ np.linalg.inv(rest.T @ rest) @ H[i], i, 1.0)  # (12)
        np.testing.assert_allclose(v @ H, 0.0, atol=1e-12)  # (10)
        J = v**2 / (v @ v)  # (14)
        F[i] = J[i] / np.delete(J, i).max()
    np.testing.assert_allclose(geometry.isolability(H), F, rtol=1e-9)


def test_there_are_eight_equal_optima_at_odd_multiples_of_45_degrees_and_none_as_good():
    a = np.deg2rad(np.arange(0.0, 180.0, 3.0))
    phi, theta, psi = np.meshgrid(a, a, a, indexing="ij")
    index = geometry.fdi_index(geometry.input_axes(phi, theta, psi))
    best = np.argwhere(index > 4.0 - 1e-9) * 3
    assert sorted(map(tuple, best.tolist())) == [(p, t, s) for p in (45, 135) for t in (45, 135) for s in (45, 135)]
    assert np.sort(index.ravel())[-9] == pytest.approx(3.62, abs=5e-3)


def test_the_optimiser_finds_45_degrees_from_a_grid_that_misses_it():
    angles, index = geometry.best_angles(step=np.deg2rad(7.0))
    assert index > 3.99
    np.testing.assert_allclose(np.rad2deg(angles), 45.0, atol=0.1)
    with pytest.raises(ValueError, match="first grid's step"):
        geometry.best_angles(step=0.0)


@pytest.mark.parametrize("instruments", [three_two_dof(), three_two_dof(0.3, 1.1, 0.7), a_tetrad()])
def test_parity_matrix_is_orthonormal_and_canonical(instruments):
    V = instruments.V
    np.testing.assert_allclose(V @ instruments.H, 0.0, atol=1e-14)  # (29)
    np.testing.assert_allclose(V @ V.T, np.eye(len(V)), atol=1e-14)
    np.testing.assert_array_equal(np.tril(V[:, : len(V)], -1), 0.0)
    assert (np.diagonal(V) > 0.0).all()


def planes():
    return [np.linalg.qr(three_two_dof().V[:, 2 * k : 2 * k + 2])[0] for k in range(3)]


def normals():
    return [np.linalg.svd(b)[0][:, 2] for b in planes()]


def test_fault_planes_are_mutually_orthogonal():
    N = np.stack(normals())
    np.testing.assert_allclose(np.abs(N @ N.T), np.eye(3), atol=1e-14)


@pytest.mark.parametrize(
    ("sensor", "fault", "shared_with"),
    [(1, [1, 1], 3), (1, [1, -1], 2), (2, [1, 1], 3), (2, [1, -1], 1), (3, [1, 1], 2), (3, [1, -1], 1)],
)
def test_singular_directions_are_the_body_axes(sensor, fault, shared_with):
    instruments = three_two_dof()
    f = np.zeros(6)
    f[2 * sensor - 2 : 2 * sensor] = fault
    angles = parity.fault_angles(parity.uncalibrated(instruments, SIGMA, 0.0), (instruments.V @ f)[None])[0]
    third = ({1, 2, 3} - {sensor, shared_with}).pop()
    np.testing.assert_allclose(np.rad2deg(angles[[sensor - 1, shared_with - 1, third - 1]]), [0, 0, 90], atol=1e-5)
    seen = instruments.H[2 * sensor - 2 : 2 * sensor].T @ fault
    assert np.count_nonzero(np.abs(seen) > 1e-12) == 1  # the fault looks like a rate about one body axis


def test_the_fault_of_the_paper_lies_on_two_planes():
    instruments = three_two_dof()
    p = instruments.V @ np.array([0.1, 0.1, 0, 0, 0, 0])
    assert np.linalg.norm(p) == pytest.approx(0.1)
    angles = parity.fault_angles(parity.uncalibrated(instruments, SIGMA, 0.0), p[None])
    np.testing.assert_allclose(np.rad2deg(angles), [[0, 90, 0]], atol=1e-5)


def test_no_parity_vector_points_nowhere():
    angles = parity.fault_angles(parity.uncalibrated(three_two_dof(), SIGMA, 0.0), np.zeros((2, 3)))
    np.testing.assert_allclose(angles, np.pi / 2)


@pytest.mark.parametrize(
    ("instruments", "message"),
    [
        ([[[1, 0, 0], [0, 1, 0]], [0, 0, 1]], "3 axes measure three directions without redundancy"),
        ([[1, 0, 0], [0, 1, 0], [1, 1, 0], [1, -1, 0]], "lie in one plane"),
        ([[[1, 0, 0], [1, 1, 0]], [0, 0, 1], [1, 1, 1]], "axes of instrument 1 must be perpendicular"),
        ([[0, 0, 0], [1, 0, 0]], "instrument 1 has an axis without a direction"),
        ([[1, 0], [1, 0, 0]], "instrument 1 needs one to three axes"),
        ([], "0 axes"),
    ],
)
def test_a_cluster_that_cannot_be_is_refused(instruments, message):
    with pytest.raises(ValueError, match=message):
        cluster(instruments)


# Least squares over the instruments that are used


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_least_squares_over_any_choice_of_instruments(data):
    instruments = data.draw(st.sampled_from([three_two_dof(), a_tetrad()]))
    used = np.array(data.draw(st.lists(st.booleans(), min_size=instruments.count, max_size=instruments.count)))
    rng = np.random.default_rng(0)
    m = rng.normal(size=(2, 4, instruments.axes))
    solution = geometry.solve(instruments, m, used[None])
    keep = used[instruments.instrument]
    H = instruments.H[keep]
    expected = np.linalg.lstsq(H, m.reshape(-1, instruments.axes)[:, keep].T, rcond=1e-9)[0].T if keep.any() else 0.0
    np.testing.assert_allclose(solution.reshape(-1, 3), expected + np.zeros((8, 3)), atol=1e-12)
    np.testing.assert_array_equal(geometry.solve(instruments, m[:, 0], used[None]), solution[:, 0])
    seen = instruments.observable[geometry.mask_index(used)]
    assert seen == (keep.any() and np.linalg.matrix_rank(H) == 3)
    if seen:
        C = geometry.solution_covariance(instruments, used[None], 2.0)
        np.testing.assert_allclose(C[0], 4.0 * np.linalg.inv(H.T @ H), atol=1e-12)


def test_each_run_may_use_its_own_instruments_and_the_error_has_the_stated_covariance():
    instruments, rng, runs = three_two_dof(), np.random.default_rng(1), 40_000
    x = rng.normal(size=(runs, 3))
    m = np.matvec(instruments.H, x) + SIGMA * rng.normal(size=(runs, 6))
    used = np.repeat([[True, True, True], [False, True, True]], runs // 2, axis=0)
    m[runs // 2 :, :2] += 1e3
    error = geometry.solve(instruments, m, used) - x
    C = geometry.solution_covariance(instruments, used, SIGMA)
    whitened = np.vecdot(error, np.linalg.solve(C, error[..., None])[..., 0])
    for half in (whitened[: runs // 2], whitened[runs // 2 :]):
        assert kstest(half, chi2(3).cdf).pvalue > FALSE_FAILURE


# Detection


@pytest.mark.parametrize("instruments", [three_two_dof(), a_tetrad()])
def test_a_moving_healthy_cluster_alarms_at_the_stated_rate(instruments):
    rng = np.random.default_rng(2)
    subjects = ["set", *(f"gyro {k}" for k in range(instruments.count))]
    reference = parity.uncalibrated(instruments, SIGMA, 0.0)
    result, *_ = parity.parity_test(reference, fly(instruments, rng, 100_000), 0.01, subjects)
    assert_rate(result.alarm, 0.01)
    assert (result.dof == instruments.axes - 3).all()
    assert kstest(result.statistic, chi2(instruments.axes - 3).cdf).pvalue > FALSE_FAILURE


def test_the_printed_threshold_is_that_of_the_paper():
    """T_D = 0.00163 on p'p at sigma 0.01; the same decision, divided by sigma^2."""
    reference = parity.uncalibrated(three_two_dof(), SIGMA, 0.0)
    readings = fly(reference.cluster, np.random.default_rng(3), 2000)
    result = parity.parity_test(reference, readings, 1e-3, SET)[0]
    p = parity.parity_vector(reference, readings)
    np.testing.assert_allclose(result.statistic * SIGMA**2, np.vecdot(p, p))
    assert result.threshold[0] * SIGMA**2 == pytest.approx(0.00163, abs=5e-6)


@pytest.mark.parametrize("size", [0.02, 0.04])
def test_a_fault_is_detected_with_the_noncentral_probability(size):
    reference = parity.uncalibrated(three_two_dof(), SIGMA, 0.005)
    rng = np.random.default_rng(4)
    bias = 0.005 * rng.normal(size=(20_000, 6))
    f = size * np.array([0, 0, 1.0, 0, 0, 0])
    result = parity.parity_test(reference, fly(reference.cluster, rng, 20_000, fault=f + bias), 1e-3, SET)[0]
    v = reference.cluster.V @ f
    assert_rate(result.alarm, ncx2.sf(threshold(1e-3, 3), 3, v @ np.linalg.solve(reference.covariance, v)))


def test_without_bias_in_the_covariance_a_healthy_cluster_alarms_forever_and_with_it_not():
    rng = np.random.default_rng(5)
    instruments, runs = three_two_dof(), 20_000
    bias = 0.05 * rng.normal(size=(runs, 6))
    readings = fly(instruments, rng, runs, fault=bias)
    naive = parity.parity_test(parity.uncalibrated(instruments, SIGMA, 0.0), readings, 1e-3, SET)[0]
    assert naive.alarm.mean() > 0.7
    honest = parity.parity_test(parity.uncalibrated(instruments, SIGMA, 0.05), readings, 1e-3, SET)[0]
    assert_rate(honest.alarm, 1e-3)
    before = np.stack([fly(instruments, rng, runs, fault=bias) for _ in range(5)], axis=1)
    calibrated = parity.calibrate(instruments, before, SIGMA, SIGMA)
    # Five samples: the calibration's own error is a fifth of the variance, and it is in the threshold.
    assert_rate(parity.parity_test(calibrated, readings, 1e-3, SET)[0].alarm, 1e-3)
    np.testing.assert_allclose(calibrated.covariance, 1.2 * SIGMA**2 * np.eye(3), atol=1e-18)
    wandering = parity.calibrate(instruments, before, SIGMA, SIGMA, stability=2 * SIGMA)
    np.testing.assert_allclose(wandering.covariance, 5.2 * SIGMA**2 * np.eye(3), atol=1e-18)


def test_axes_of_different_noise_are_weighted():
    rng = np.random.default_rng(6)
    sigma = np.array([1, 1, 1, 1, 5, 5]) * SIGMA
    reference = parity.uncalibrated(three_two_dof(), sigma, 0.0)
    result, *_ = parity.parity_test(reference, fly(reference.cluster, rng, 50_000, sigma), 0.01, SET)
    assert_rate(result.alarm, 0.01)


# Isolation


@pytest.mark.parametrize("axis", range(6))
def test_a_single_axis_fault_is_placed_by_every_test(axis):
    reference = parity.uncalibrated(three_two_dof(), SIGMA, 0.0)
    f = np.zeros(6)
    f[axis] = 0.3
    readings = fly(reference.cluster, np.random.default_rng(7), 2000, fault=f)
    for results in (
        parity.parity_test(reference, readings, 1e-3, SET),
        parity.angle_test(reference, readings, 1e-3, SET),
        parity.glt_test(reference, readings, 1e-3, SET),
    ):
        named = np.stack([r.alarm for r in results[1:]], axis=1)
        assert results[0].alarm.all()
        assert named[:, axis // 2].mean() > 0.99
        assert (named.sum(axis=1) <= 1).all()
    glt = parity.glt_test(reference, readings, 1e-3, SET)[1 + axis // 2]
    assert (glt.extra["axis"] == axis).mean() > 0.99
    # Size over its standard deviation is normal: mean of 2000 within 5.
    s = reference.sensitivity[0, axis]
    right = glt.extra["axis"] == axis
    assert abs((glt.extra["size"][right] - 0.3).mean()) * s * np.sqrt(2000) < 5.0


def test_the_statistic_of_the_culprit_is_chi_square_outside_its_plane():
    """So the culprit is lost from the candidates with probability p_fa, whatever its two axes do."""
    reference = parity.uncalibrated(three_two_dof(), SIGMA, 0.0)
    rng = np.random.default_rng(8)
    fault = np.zeros((50_000, 6))
    fault[:, 2:4] = 0.2 + rng.random((50_000, 2))
    results = parity.parity_test(reference, fly(reference.cluster, rng, 50_000, fault=fault), 1e-3, SET)
    assert results[0].alarm.all()
    culprit = results[2]
    assert (culprit.dof == 1).all()
    assert kstest(culprit.statistic, chi2(1).cdf).pvalue > FALSE_FAILURE
    assert_rate(~culprit.extra["candidate"], 1e-3)
    n = normals()[1]
    p = parity.parity_vector(reference, fly(reference.cluster, np.random.default_rng(9), 10))
    again = parity.parity_test(reference, fly(reference.cluster, np.random.default_rng(9), 10), 1e-3, SET)[2]
    np.testing.assert_allclose(again.statistic, (p @ n / SIGMA) ** 2)  # (n.p / sigma)^2


def test_the_fault_of_the_paper_is_reported_as_ambiguous():
    reference = parity.uncalibrated(three_two_dof(), SIGMA, 0.0)
    f = np.array([0.1, 0.1, 0, 0, 0, 0])
    readings = fly(reference.cluster, np.random.default_rng(10), 5000, fault=f)
    results = parity.parity_test(reference, readings, 1e-3, SET)
    assert results[1].extra["ambiguous"].mean() > 0.99
    named = np.stack([r.alarm for r in results[1:]], axis=1)
    assert (named.sum(axis=1) == 1).mean() > 0.99  # one is named all the same: the nearer
    assert 0.4 < named[:, 0].mean() < 0.6
    candidates = np.stack([r.extra["candidate"] for r in results[1:]], axis=1)
    assert candidates[:, [0, 2]].mean() > 0.99
    assert not candidates[:, 1].any()
    angles = parity.angle_test(reference, readings, 1e-3, SET)
    both = angles[1].extra["candidate"] & angles[3].extra["candidate"]
    assert both.mean() > 0.95  # T_i = 15 degrees
    narrow = parity.angle_test(reference, readings, 1e-3, SET, limit=np.deg2rad(10.0))
    assert (narrow[1].extra["candidate"] & narrow[3].extra["candidate"]).mean() == pytest.approx(0.86, abs=0.03)


def test_glt_explains_by_instrument_what_its_plane_holds():
    reference = parity.uncalibrated(three_two_dof(), SIGMA, 0.0)
    readings = fly(reference.cluster, np.random.default_rng(11), 50, fault=np.array([0, 0, 0.2, 0.1, 0, 0]))
    glt, planar = (t(reference, readings, 1e-3, SET) for t in (parity.glt_test, parity.parity_test))
    for a, b in zip(glt[1:], planar[1:], strict=True):
        np.testing.assert_allclose(a.extra["explained"] + b.statistic, glt[0].statistic)
    V, p = reference.cluster.V, parity.parity_vector(reference, readings)
    DF = (p @ V) ** 2 / (V * V).sum(axis=0) / SIGMA**2
    np.testing.assert_allclose(np.stack([r.statistic for r in glt[1:]], 1), DF.reshape(-1, 3, 2).max(axis=-1))
    sizes = parity.fault_sizes(reference, p)
    np.testing.assert_allclose((sizes * reference.sensitivity[0]) ** 2, DF)


# Instruments left out


def test_with_an_instrument_out_the_rest_is_judged_on_what_is_left():
    rng = np.random.default_rng(12)
    reference = parity.uncalibrated(three_two_dof(), SIGMA, 0.0)
    used = np.array([[True, False, True]])
    readings = fly(reference.cluster, rng, 100_000)
    readings[:, 2:4] = np.nan
    for test in (parity.parity_test, parity.angle_test, parity.glt_test):
        results = test(reference, readings, 0.01, SET, used)
        assert (results[0].dof == 1).all()
        assert_rate(results[0].alarm, 0.01)
        assert not any(r.alarm.any() for r in results[1:])  # one dof: a fault cannot be placed
        # The parity vector that is shown knows neither the motion nor the instrument that is out.
        np.testing.assert_allclose(results[0].innovation[:9] @ planes()[1], 0.0, atol=1e-15)
        assert np.abs(results[0].innovation).max() < 6 * SIGMA
    # It is the statistic outside that instrument's plane, by any other way of asking.
    whole = parity.parity_test(reference, fly(reference.cluster, np.random.default_rng(13), 9), 0.01, SET)
    left = parity.parity_test(reference, fly(reference.cluster, np.random.default_rng(13), 9), 0.01, SET, used)
    np.testing.assert_allclose(left[0].statistic, whole[2].statistic)
    np.testing.assert_array_equal(left[2].statistic, 0.0)


def test_a_second_fault_is_still_placed_when_redundancy_allows():
    """Six one-axis instruments on a dodecahedron: with one out, five still place a fault."""
    g = (1 + np.sqrt(5)) / 2
    instruments = cluster([[g, 1, 0], [g, -1, 0], [0, g, 1], [0, g, -1], [1, 0, g], [-1, 0, g]])
    reference = parity.uncalibrated(instruments, SIGMA, 0.0)
    subjects = ["set", *"abcdef"]
    used = np.array([[False, True, True, True, True, True]])
    readings = fly(instruments, np.random.default_rng(14), 3000, fault=np.array([5.0, 0, 0.5, 0, 0, 0]))
    for test in (parity.parity_test, parity.angle_test, parity.glt_test):
        results = test(reference, readings, 1e-3, subjects, used)
        assert (results[0].dof == 2).all()
        assert results[0].alarm.all()
        assert results[3].alarm.mean() > 0.99


def test_masks_may_differ_between_runs():
    reference = parity.uncalibrated(three_two_dof(), SIGMA, 0.01)
    readings = fly(reference.cluster, np.random.default_rng(15), 8, fault=np.array([0, 0.2, 0, 0, 0, 0]))
    used = np.array([[k & 1, k & 2, k & 4] for k in range(8)], dtype=bool)
    for test in (parity.parity_test, parity.angle_test, parity.glt_test):
        together = test(reference, readings, 0.01, SET, used)
        for k in range(8):
            alone = test(reference, readings[k : k + 1], 0.01, SET, used[k : k + 1])
            for a, b in zip(together, alone, strict=True):
                for field in ("statistic", "dof", "threshold", "alarm"):
                    np.testing.assert_allclose(getattr(a, field)[k], getattr(b, field)[0], atol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda c: parity.uncalibrated(c, -1.0, 0.0), "noise must be a standard deviation"),
        (lambda c: parity.uncalibrated(c, 0.0, 0.0), "nothing to test against"),
        (lambda c: parity.calibrate(c, np.zeros((1, 3)), 1.0, 1.0), r"\(runs, samples, 6 axes\)"),
        (lambda c: parity.parity_test(parity.uncalibrated(c, 1.0, 0.0), np.zeros((1, 6)), 1e-3, ("a",)), "got 1 names"),
    ],
)
def test_what_makes_no_sense_is_explained(make, message):
    with pytest.raises(ValueError, match=message):
        make(three_two_dof())


def test_an_axis_without_redundancy_is_named():
    lonely = cluster([[1, 0, 0], [[0, 1, 0], [0, 0, 1]], [0, 1, 1]])
    with pytest.raises(ValueError, match=r"axes \[1\] have no redundancy"):
        parity.uncalibrated(lonely, 1.0, 0.0)
