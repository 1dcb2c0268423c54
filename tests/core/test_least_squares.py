"""Weighted least squares on pseudoranges, and the corrections that go with it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from ftcore import earth
from ftcore.estimation import atmosphere, least_squares
from ftcore.estimation.first_fix import cold_start, first_fix
from ftcore.estimation.least_squares import geometry, hdop, solve
from ftcore.world import constellation

SEOUL = np.array([math.radians(37.5665), math.radians(126.978), 50.0])
POSITION_E = earth.geodetic_to_ecef(SEOUL)
C_EN = earth.enu_to_ecef_matrix(SEOUL[0], SEOUL[1])


def sky(time=1800.0, mask=5.0):
    """Satellites in view, Earth-fixed (n, 3)."""
    position, _ = constellation.satellite_states(time)
    return position[constellation.visible(SEOUL, position, mask)]


def seen(satellites):
    return geometry(POSITION_E[None], C_EN[None], satellites)


def some(n, runs=3, seed=0):
    rng = np.random.default_rng(seed)
    e = rng.normal(size=(n, 3))
    e[:, 2] = np.abs(e[:, 2]) + 0.1
    H = np.concatenate([-e / np.linalg.norm(e, axis=1)[:, None], np.ones((n, 1))], axis=1)
    return np.broadcast_to(H, (runs, n, 4)), rng.normal(size=(runs, n)) * 10.0, rng.uniform(1.0, 9.0, (runs, n))


def test_given_weights_then_the_solution_is_that_of_lstsq():
    H, y, sigma = some(9)
    fix = solve(H, y, sigma, np.ones((3, 9), bool))
    for k in range(3):
        x, rest, _, _ = np.linalg.lstsq(H[k] / sigma[k][:, None], y[k] / sigma[k], rcond=None)
        np.testing.assert_allclose(fix.x[k], x, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(fix.statistic[k], rest[0], rtol=1e-10)
        np.testing.assert_allclose(
            fix.covariance[k], np.linalg.inv((H[k] / sigma[k][:, None]).T @ (H[k] / sigma[k][:, None])), rtol=1e-9
        )
        np.testing.assert_allclose(fix.projector[k] @ (y[k] / sigma[k]), fix.residual[k], atol=1e-10)
        np.testing.assert_allclose(fix.gain[k] @ (y[k] / sigma[k]), fix.x[k], atol=1e-9)
    assert (fix.dof == 5).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.lists(st.booleans(), min_size=10, max_size=10).filter(lambda v: sum(v) >= 5))
def test_given_invalid_satellites_then_they_drop_out_as_if_deleted(seed, valid):
    H, y, sigma = some(10, seed=seed)
    mask = np.array(valid)
    dirty = np.where(mask, y, np.nan)
    whole = solve(H, dirty, sigma, np.broadcast_to(mask, y.shape))
    small = solve(H[:, mask], y[:, mask], sigma[:, mask], np.ones((3, mask.sum()), bool))
    np.testing.assert_allclose(whole.x, small.x, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(whole.statistic, small.statistic, rtol=1e-6, atol=1e-6)
    assert (whole.residual[:, ~mask] == 0.0).all()
    np.testing.assert_array_equal(whole.dof, small.dof)


@pytest.mark.parametrize("n", [0, 1, 3])
def test_given_too_few_satellites_then_there_is_no_solution_and_no_crash(n):
    H, y, sigma = some(8)
    fix = solve(H, y, sigma, np.broadcast_to(np.arange(8) < n, y.shape))
    assert not fix.solved.any()
    assert (fix.dof == 0).all()
    assert np.isfinite(fix.x).all()
    assert np.isnan(hdop(H, fix.valid, fix.solved)).all()


def test_given_satellites_in_one_direction_then_there_is_no_solution():
    H = np.ones((1, 6, 4))
    H[..., :3] = [0.0, 0.6, -0.8]
    assert not solve(H, np.zeros((1, 6)), np.ones((1, 6)), np.ones((1, 6), bool)).solved.any()


def test_given_noise_then_errors_are_what_the_covariance_says():
    runs, sigma = 4000, 10.0
    H = np.broadcast_to(seen(sky()).H, (runs, 8, 4))
    x = np.array([3.0, -2.0, 5.0, 100.0])
    y = H @ x + sigma * np.random.default_rng(1).normal(size=(runs, 8))
    fix = solve(H, y, np.full((1, 8), sigma), np.ones((runs, 8), bool))
    error = fix.x - x
    nees = np.vecdot(error, np.linalg.solve(fix.covariance, error[..., None])[..., 0])
    # Sums of chi-square variables: two-sided 1e-6 bands.
    for total, dof in ((nees.sum(), 4 * runs), (fix.statistic.sum(), 4 * runs)):
        assert chi2.ppf(5e-7, dof) < total < chi2.isf(5e-7, dof)


def test_given_the_turn_of_the_earth_then_the_correction_is_that_of_turning_the_satellite():
    satellites = sky()
    rho = np.linalg.norm(satellites - POSITION_E, axis=1)
    for _ in range(3):
        angle = earth.RATE * rho / earth.SPEED_OF_LIGHT
        c, s = np.cos(angle), np.sin(angle)
        x, y, z = satellites.T
        turned = np.stack([c * x + s * y, -s * x + c * y, z], axis=1)
        rho = np.linalg.norm(turned - POSITION_E, axis=1)
    np.testing.assert_allclose(seen(satellites).range[0], rho, atol=1e-3)
    assert np.ptp(least_squares.sagnac(POSITION_E, satellites)) > 20.0, "it matters"


def test_given_nothing_but_pseudoranges_then_a_cold_start_finds_the_receiver():
    satellites = sky()
    runs = 5
    clock = np.linspace(-3e5, 3e5, runs)[:, None]
    measured = seen(satellites).range + clock
    start = cold_start(measured, satellites, np.ones((runs, 8), bool))
    assert start.checked.all()
    np.testing.assert_allclose(start.position, np.broadcast_to(POSITION_E, start.position.shape), atol=1e-4)


def test_given_a_gross_fault_or_three_satellites_then_a_cold_start_says_so():
    satellites = sky()
    measured = np.repeat(seen(satellites).range, 2, axis=0)
    measured[0, 2] += 1e9
    valid = np.ones((2, 8), bool)
    valid[1, 3:] = False
    assert not cold_start(measured, satellites, valid).found.any()


@pytest.mark.parametrize("size", [1e3, 3e4, 1e5, 299792.458, -299792.458, 1e7, -1e9, 1e12])
def test_given_any_one_or_two_wrong_satellites_then_the_first_fix_is_right(size):
    """One of eight in turn, then every two of them, by the size and by half of it: 36 runs side by side."""
    satellites = sky()
    wrong = [(i, j) for i in range(8) for j in range(i, 8)]
    measured = np.repeat(seen(satellites).range + 1e4, len(wrong), axis=0)
    for run, (i, j) in enumerate(wrong):
        measured[run, i] += size
        measured[run, j] += 0.5 * size if i != j else 0.0
    start = first_fix(measured, satellites, np.ones((len(wrong), 8), bool))
    assert start.checked.all()
    # What the atmosphere could be is not gross: then it is a place to work from, and the tests find the culprit there.
    assert np.linalg.norm(start.position - POSITION_E, axis=-1).max() < (2.0 * size if size == 1e3 else 1e-3)


def test_given_too_few_satellites_to_tell_then_the_first_fix_is_not_called_checked():
    satellites = sky()
    measured = np.repeat(seen(satellites).range, 2, axis=0)
    measured[:, 2] += 3e5
    valid = np.zeros((2, 8), bool)
    valid[0, :5], valid[1, :4] = True, True
    start = first_fix(measured, satellites, valid)
    assert not start.checked.any()


def test_given_seoul_at_the_first_epoch_with_eight_then_hdop_is_as_known():
    H = seen(sky()).H
    assert H.shape == (1, 8, 4)
    assert hdop(H, np.ones((1, 8), bool), np.ones(1, bool))[0] == pytest.approx(0.98, abs=0.005)


# ---- atmosphere


def test_klobuchar_against_a_published_value():
    """The value of Orekit's test, from a navigation message of 2000-01-01."""
    coefficients = np.array([0.3820e-07, 0.1490e-07, -0.1790e-06, 0.0, 0.1430e06, 0.0, -0.3280e06, 0.1130e06])
    delay = atmosphere.klobuchar(
        math.radians(40.0), math.radians(-100.0), np.radians([20.0]), np.radians([210.0]), 20.75 * 3600.0, coefficients
    )
    assert delay[0] == pytest.approx(23.784, abs=0.001)


def test_given_night_then_klobuchar_is_the_constant_floor():
    coefficients = np.array([1e-8, 0.0, 0.0, 0.0, 9e4, 0.0, 0.0, 0.0])
    zenith = atmosphere.klobuchar(0.6, 0.0, np.array([math.pi / 2]), np.array([0.0]), 2.0 * 3600.0, coefficients)
    assert zenith[0] == pytest.approx(5e-9 * earth.SPEED_OF_LIGHT, rel=1e-3)


def test_troposphere_is_that_of_the_textbooks():
    """2.3 m dry and 0.1 m wet at the zenith at sea level (Kouba; Hofmann-Wellenhof), less on a mountain, none below."""
    up, low = np.array([math.pi / 2]), np.radians([30.0])
    zenith = atmosphere.saastamoinen(math.radians(45.0), 0.0, up)
    assert zenith[0] == pytest.approx(2.42, abs=0.03)
    np.testing.assert_allclose(atmosphere.saastamoinen(math.radians(45.0), 0.0, low), 2.0 * zenith, rtol=1e-6)
    assert atmosphere.saastamoinen(math.radians(45.0), 3000.0, up)[0] < 0.75 * zenith[0]
    assert atmosphere.saastamoinen(0.7, 0.0, np.array([-0.1]))[0] == 0.0
