"""Where fault planes meet, what cannot be placed there, and the test along the optimal parity vector."""

import numpy as np
import pytest
from scipy.stats import binom, kstest

from ftcore.detection import ambiguity, geometry, parity
from ftcore.detection.geometry import cluster, three_two_dof

SIGMA = 0.01
SET = ("gyros", "gyro 1", "gyro 2", "gyro 3")
FALSE_FAILURE = 1e-6


def reference(instruments=None):
    return parity.uncalibrated(instruments or three_two_dof(), SIGMA, 0.0)


def test_fault_planes_meet_on_the_body_axes():
    found = {s.instruments: s for s in geometry.singular_faults(three_two_dof())}
    assert set(found) == {(0, 1), (0, 2), (1, 2)}
    signs = {pair: [np.sign(f[0] * f[1]) for f in s.faults] for pair, s in found.items()}
    assert signs == {(0, 1): [-1, -1], (0, 2): [1, -1], (1, 2): [1, 1]}  # systems.md, D
    V, H = three_two_dof().V, three_two_dof().H
    for (a, b), s in found.items():
        for k, fault in zip((a, b), s.faults, strict=True):
            p = V[:, 2 * k : 2 * k + 2] @ fault
            np.testing.assert_allclose(p / np.linalg.norm(p), s.line, atol=1e-12)
            rate = H[2 * k : 2 * k + 2].T @ fault
            assert np.count_nonzero(np.abs(rate) > 1e-12) == 1


@pytest.mark.parametrize("angles", [(0.3, 1.1, 0.7), (0.1, 0.2, 1.4)])
def test_other_mountings_have_singular_directions_too(angles):
    instruments = three_two_dof(*angles)
    found = geometry.singular_faults(instruments)
    assert len(found) == 3
    for s in found:
        FI = parity.fault_angles(reference(instruments), s.line[None])[0]
        np.testing.assert_allclose(FI[list(s.instruments)], 0.0, atol=1e-7)


def test_with_four_instruments_planes_need_not_meet():
    rng = np.random.default_rng(2)
    pairs = [np.linalg.qr(rng.normal(size=(3, 2)))[0].T for _ in range(4)]
    assert geometry.singular_faults(cluster(pairs)) == ()


def test_a_third_of_all_fault_directions_is_ambiguous_at_15_degrees():
    angle, FI, ambiguous = ambiguity.ambiguity_map(reference(), directions=720)
    assert FI.shape == (3, 720, 3)
    for k in range(3):
        np.testing.assert_allclose(FI[k, :, k], 0.0, atol=1e-7)  # a fault lies in its own plane
        # Two lines of 90 degrees apart, 15 degrees to either side: 60 of 180 degrees.
        assert ambiguous[k].mean() == pytest.approx(1 / 3, abs=0.005)
        assert ambiguous[k, np.abs(np.rad2deg(angle) - 45.0).argmin()]
        assert not ambiguous[k, 0]  # a single axis has no ambiguity
    assert not ambiguity.ambiguity_map(reference(), np.deg2rad(1e-3), 359)[2].any()


def test_the_map_leaves_out_what_has_no_plane():
    tetrad = cluster([[1, 0, 0.7], [-1, 0, 0.7], [0, 1, 0.7], [0, -1, 0.7], [[1, 0, 0], [0, 1, 0]]])
    _, FI, ambiguous = ambiguity.ambiguity_map(reference(tetrad), directions=8)
    assert np.isnan(FI[:4]).all()
    assert not ambiguous[:4].any()
    assert np.isfinite(FI[4]).all()


def test_optimal_parity_statistics_are_chi_square_without_a_fault():
    m = SIGMA * np.random.default_rng(3).normal(size=(20000, 6))
    found = parity.optimal_parity_test(reference(), m, 1e-2, SET)
    for result in found[1:]:
        assert (result.dof == 2).all()
        assert kstest(result.statistic, "chi2", args=(2,)).pvalue > FALSE_FAILURE
        low, high = binom.ppf([FALSE_FAILURE / 2, 1 - FALSE_FAILURE / 2], len(m), 1e-2)
        assert low <= result.extra["candidate"].sum() <= high


def test_optimal_parity_is_what_the_best_combination_of_parity_equations_shows():
    rng = np.random.default_rng(4)
    instruments = three_two_dof(0.4, 0.9, 1.2)
    m = rng.normal(size=(6, 6))
    seen = parity.optimal_parity_test(reference(instruments), m, 1e-3, SET)
    p = m @ instruments.V.T
    a = np.linspace(0.0, np.pi, 20001)
    for k in range(3):
        V = instruments.V[:, 2 * k : 2 * k + 2]
        v = V @ np.stack([np.cos(a), np.sin(a)])
        shown = np.square(p @ v) / (SIGMA**2 * (v * v).sum(axis=0))
        np.testing.assert_allclose(seen[k + 1].statistic, shown.max(axis=1), rtol=1e-6)


def test_optimal_parity_names_a_fault_off_the_singular_directions_and_tosses_a_coin_on_them():
    rng = np.random.default_rng(5)
    noise = SIGMA * rng.normal(size=(2000, 6))
    single = parity.optimal_parity_test(reference(), noise + [0, 0, 0.15, 0, 0, 0], 1e-3, SET)
    assert single[2].alarm.mean() > 0.999
    tied = parity.optimal_parity_test(reference(), noise + [0.1, 0.1, 0, 0, 0, 0], 1e-3, SET)
    assert 0.4 < tied[1].alarm.mean() < 0.6
    assert 0.4 < tied[3].alarm.mean() < 0.6
    assert tied[1].extra["candidate"].all()
    assert tied[3].extra["candidate"].all()


def test_with_one_of_three_out_nobody_is_named():
    m = np.full((3, 6), 0.1) + SIGMA * np.random.default_rng(6).normal(size=(3, 6))
    used = np.array([[True, False, True]])
    found = parity.optimal_parity_test(reference(), m * [5, 1, 1, 1, 1, 1], 1e-3, SET, used)
    assert found[0].alarm.all()
    assert not any(result.alarm.any() for result in found[1:])
