"""Consistency tests of satellites, isolation with a margin, protection levels: against deletion, ncx2 and sampling."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, chi2, ncx2, norm

from ftcore import earth
from ftcore.detection import protection, raim
from ftcore.detection.raim import CANNOT_DETECT, CANNOT_ISOLATE, CONSISTENT, EXCLUDED
from ftcore.estimation import kalman, least_squares
from ftcore.world import constellation

SEOUL = np.array([math.radians(37.5665), math.radians(126.978), 50.0])
SIGMA, P_FA = 10.0, 1e-3
SURE = raim.margin(1e-3)


def seoul(n=8):
    """H (n, 4) at the first epoch with eight in view."""
    position, _ = constellation.satellite_states(1800.0)
    position = position[constellation.visible(SEOUL, position)]
    C_en = earth.enu_to_ecef_matrix(SEOUL[0], SEOUL[1])
    return least_squares.geometry(earth.geodetic_to_ecef(SEOUL)[None], C_en[None], position).H[0, :n]


def measured(H, runs, bias=0.0, seed=0, sigma=SIGMA):
    """y (runs, n) of a receiver at x with ``bias`` (n,) on the pseudoranges."""
    rng = np.random.default_rng(seed)
    return H @ np.array([4.0, -7.0, 2.0, 5000.0]) + bias + sigma * rng.normal(size=(runs, len(H)))


def on(n, i, size):
    """A bias of ``size`` on satellite ``i`` of ``n``."""
    bias = np.zeros(n)
    bias[i] = size
    return bias


def snapshot(H, y, sigma=SIGMA, valid=None):
    valid = np.ones(y.shape, bool) if valid is None else valid
    s = np.broadcast_to(sigma, y.shape)
    fix = least_squares.solve(np.broadcast_to(H, (*y.shape, 4)), y, s, valid)
    return fix, raim.from_projector(fix.projector, y / s, fix.residual, fix.dof, fix.valid)


def rate_is(count, trials, p, alpha=1e-6):
    """Whether a count is inside the binomial band; the chance to be wrongly outside is ``alpha``."""
    return binom.ppf(alpha / 2, trials, p) <= count <= binom.isf(alpha / 2, trials, p)


# ---- one form, three ways


def test_given_any_weights_then_least_squares_and_parity_say_the_same_to_1e_9():
    rng = np.random.default_rng(3)
    H, runs = seoul(), 200
    sigma = rng.uniform(1.0, 20.0, (runs, 8))
    valid = rng.random((runs, 8)) < 0.9
    y = measured(H, runs, rng.normal(size=8) * 50.0) + 3e5
    _, form = snapshot(H, y, sigma, valid)
    Hs = np.broadcast_to(H, (runs, 8, 4))
    twin = raim.parity_statistic(Hs, y, sigma, valid & form.valid)
    some = form.dof > 0
    np.testing.assert_allclose(twin[some], form.statistic[some], rtol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32))
def test_given_a_form_then_leaving_one_out_is_what_deleting_it_says(seed):
    rng = np.random.default_rng(seed)
    H, sigma = seoul(), rng.uniform(3.0, 20.0, (1, 8))
    y = measured(H, 1, rng.normal(size=8) * 40.0, seed)
    _, form = snapshot(H, y, sigma)
    for i in range(8):
        keep = np.arange(8) != i
        _, without = snapshot(H[keep], y[:, keep], sigma[:, keep])
        np.testing.assert_allclose(form.statistic - form.squared[:, i], without.statistic, rtol=1e-6, atol=1e-6)


def test_given_a_filter_then_leaving_one_out_is_what_deleting_its_row_says():
    rng = np.random.default_rng(5)
    A = rng.normal(size=(4, 4))
    x, P, H = np.zeros((1, 4)), (A @ A.T)[None] * 30.0, seoul()
    y, R, valid = rng.normal(size=(1, 8)) * 60.0, np.full((1, 8), 100.0), np.ones((1, 8), bool)
    valid[0, 3] = False
    inn = kalman.innovation(x, P, y, H[None], R, valid)
    form = raim.from_whitened(inn.whitener, inn.whitened, inn.innovation, valid)
    assert form.dof[0] == 7
    assert np.isnan(form.normalised[0, 3])
    for i in np.flatnonzero(valid[0]):
        keep = valid.copy()
        keep[0, i] = False
        less = kalman.innovation(x, P, y, H[None], R, keep)
        np.testing.assert_allclose(form.statistic - form.squared[:, i], less.statistic, rtol=1e-8)


def test_given_repeated_exclusion_then_the_rest_is_the_form_of_the_rest():
    H = seoul()
    y = measured(H, 50, on(8, 2, 400.0) + on(8, 6, -300.0))
    _, form = snapshot(H, y)
    found = raim.isolate(form, P_FA)
    for k in range(50):
        keep = ~found.excluded[k]
        _, rest = snapshot(H[keep], y[k : k + 1, keep])
        np.testing.assert_allclose(found.remaining.statistic[k], rest.statistic[0], rtol=1e-7, atol=1e-7)
        assert found.remaining.dof[k] == rest.dof[0]


# ---- theory and measurement agree


def test_given_no_fault_then_false_alarms_lie_in_their_binomial_band():
    runs = 50_000
    for n, dof in ((8, 4), (7, 3), (6, 2), (5, 1)):
        H = seoul(n)
        _, form = snapshot(H, measured(H, runs, seed=n))
        result = raim.isolate(form, P_FA, 1, SURE)
        assert (form.dof == dof).all()
        assert rate_is(result.alarm.sum(), runs, P_FA)


def test_given_eight_satellites_then_threshold_and_dof_are_as_known():
    _, form = snapshot(seoul(), measured(seoul(), 1))
    result = raim.isolate(form, P_FA)
    assert form.dof[0] == 4
    assert result.threshold[0] == pytest.approx(18.47, abs=0.005)


@pytest.mark.parametrize("i", range(8))
def test_given_a_bias_then_detection_is_that_of_the_noncentral_chi_square(i):
    H, runs = seoul(), 20_000
    for size in (50.0, 100.0):
        fix, form = snapshot(H, measured(H, runs, on(8, i, size), seed=i))
        power = ncx2.sf(chi2.isf(P_FA, 4), 4, (size / SIGMA) ** 2 * fix.projector[0, i, i])
        assert rate_is(raim.isolate(form, P_FA).alarm.sum(), runs, power)
    assert 0.96 <= round(power, 2) <= 1.0


def test_given_the_minimal_detectable_bias_then_it_is_missed_as_often_as_allowed():
    H, runs, p_md = seoul(), 40_000, 1e-3
    fix, _ = snapshot(H, measured(H, 1))
    lam = protection.noncentralities(fix.dof, P_FA, p_md)
    mdb = protection.minimal_detectable_bias(fix.projector, np.full((1, 8), SIGMA), fix.valid, lam)[0]
    assert mdb.min() == pytest.approx(85.0, abs=0.5)
    assert mdb.max() == pytest.approx(124.0, abs=0.5)
    for i in (0, 1, 7):
        _, form = snapshot(H, measured(H, runs, on(8, i, mdb[i]), seed=10 + i))
        assert rate_is((~raim.isolate(form, P_FA).alarm).sum(), runs, p_md)


@pytest.mark.parametrize(("dof", "p_md"), [(1, 1e-3), (4, 1e-3), (4, 0.1), (9, 1e-6)])
def test_noncentrality_is_the_root_it_claims_to_be(dof, p_md):
    lam = protection.noncentrality(dof, P_FA, p_md)
    assert ncx2.cdf(chi2.isf(P_FA, dof), dof, lam) == pytest.approx(p_md, rel=1e-6)


def test_given_impossible_probabilities_then_noncentrality_refuses_and_says_why():
    with pytest.raises(ValueError, match=r"0\.6 and 0\.5"):
        protection.noncentrality(4, 0.6, 0.5)


# ---- isolation


@pytest.mark.parametrize("margin", [0.0, SURE])
@pytest.mark.parametrize("i", range(8))
def test_given_a_large_bias_then_its_satellite_is_named(i, margin):
    H = seoul()
    _, form = snapshot(H, measured(H, 500, on(8, i, 400.0), seed=i))
    found = raim.isolate(form, P_FA, 1, margin)
    named = found.excluded == on(8, i, 1).astype(bool)
    # The rest alarms once in a thousand: at most 6 of 500 with a probability above 1 - 1e-6.
    assert named.all(axis=1).sum() >= 494
    assert found.excluded[found.state == EXCLUDED, i].all()
    if margin:
        assert named[found.state == EXCLUDED].all()


def test_given_two_faults_then_both_are_named():
    H = seoul()
    _, form = snapshot(H, measured(H, 300, on(8, 3, 500.0) + on(8, 7, -400.0)))
    found = raim.isolate(form, P_FA, 1, SURE)
    right = found.excluded[:, 3] & found.excluded[:, 7] & (found.excluded.sum(axis=1) == 2)
    assert right.sum() >= 290
    assert not (found.excluded.any(axis=1) & ~right).any()


def test_given_five_satellites_then_it_says_cannot_isolate_and_accuses_nobody():
    H = seoul(5)
    _, form = snapshot(H, measured(H, 50, on(5, 2, 1000.0)))
    found = raim.isolate(form, P_FA, 1, SURE)
    assert (found.state == CANNOT_ISOLATE).all()
    assert not found.excluded.any()
    np.testing.assert_array_equal(found.remaining.statistic, form.statistic)


@pytest.mark.parametrize("n", [0, 3, 4])
def test_given_four_satellites_or_fewer_then_it_says_cannot_detect(n):
    y = measured(seoul(), 20, on(8, 1, 1000.0))
    _, form = snapshot(seoul(), y, valid=np.broadcast_to(np.arange(8) < n, y.shape))
    found = raim.isolate(form, P_FA, 1, SURE)
    assert (found.state == CANNOT_DETECT).all()
    assert not found.alarm.any()


def alike(degrees):
    """Six satellites of which 0 and 1 leave nearly the same trace in the residual."""
    rng = np.random.default_rng(2)
    z = np.array([0.3, 0.35, 0.9, 0.6, 0.5, 0.15])
    az = rng.uniform(0.0, 2 * np.pi, 6)
    e = np.stack([np.sqrt(1 - z**2) * np.sin(az), np.sqrt(1 - z**2) * np.cos(az), z], axis=1)
    H = np.concatenate([-e, np.ones((6, 1))], axis=1)
    # Choose the sixth so that the parity columns of 0 and 1 come close: scan its azimuth.
    best, kept = 2.0, H
    for a in np.linspace(0.0, 2 * np.pi, 720):
        H[5, :2] = -math.sqrt(1 - z[5] ** 2) * np.array([math.sin(a), math.cos(a)])
        S = least_squares.solve(H[None], np.zeros((1, 6)), np.ones((1, 6)), np.ones((1, 6), bool)).projector[0]
        gap = abs(abs(S[0, 1]) / math.sqrt(S[0, 0] * S[1, 1]) - math.cos(math.radians(degrees)))
        if gap < best:
            best, kept = gap, H.copy()
    assert best < 1e-2
    return kept


@pytest.mark.parametrize("degrees", [3.0, 10.0])
def test_given_satellites_that_look_alike_then_the_margin_keeps_the_innocent_from_being_accused(degrees):
    """P(b accused in place of a) <= Q(sqrt(margin)), whatever the fault; the least residual has no bound."""
    H, runs = alike(degrees), 10_000
    guessed = []
    for size in (40.0, 100.0, 200.0, 400.0, 1000.0, 4000.0):
        _, form = snapshot(H, measured(H, runs, on(6, 0, size)))
        least, sure = raim.isolate(form, P_FA, 1, 0.0), raim.isolate(form, P_FA, 1, SURE)
        wrong = (sure.excluded & ~on(6, 0, 1).astype(bool)).any(axis=1)
        # Five others, each at most Q(3.29) = 5e-4.
        assert wrong.sum() <= binom.isf(1e-6, runs, 5 * norm.sf(math.sqrt(SURE)))
        assert (sure.state[(least.state == EXCLUDED) & (sure.state != EXCLUDED)] == CANNOT_ISOLATE).all()
        guessed.append((least.excluded & ~on(6, 0, 1).astype(bool)).any(axis=1).mean())
    assert max(guessed) > 0.05, "the example is a hard one"


# ---- two faults at once


def without(H, y, pair):
    """Statistic of least squares without two satellites, solved anew, (runs,)."""
    keep = ~np.isin(np.arange(len(H)), pair)
    rest = y[:, keep].T - H[keep] @ np.linalg.lstsq(H[keep], y[:, keep].T, rcond=None)[0]
    return (rest**2).sum(axis=0) / SIGMA**2


def test_given_any_two_of_seven_grossly_wrong_then_both_are_named():
    H, runs = seoul(7), 60
    right = []
    for a, b in combinations(range(7), 2):
        faults = on(7, a, 299_792.458) + on(7, b, -1.7e5)
        _, form = snapshot(H, measured(H, runs, faults, seed=7 * a + b))
        found = raim.isolate(form, P_FA, 1, SURE)
        named = (found.excluded == (faults != 0.0)).all(axis=1)
        assert not (found.excluded.any(axis=1) & ~named).any()
        right.append(named)
        rest = without(H, measured(H, runs, faults, seed=7 * a + b), (a, b))
        np.testing.assert_allclose(found.remaining.statistic[named], rest[named], rtol=1e-4, atol=1e-4)
    # Each rest alarms once in a thousand; all else is told at this size.
    assert np.count_nonzero(~np.array(right)) <= binom.isf(1e-6, 21 * runs, P_FA)


def test_given_two_faults_of_any_size_then_the_pair_is_who_deleting_every_pair_says():
    H, runs, alone = seoul(7), 400, chi2.isf(P_FA, 2)
    rng = np.random.default_rng(8)
    pairs = list(combinations(range(7), 2))
    faults = np.zeros((runs, 7))
    for run, pair in enumerate(rng.integers(21, size=runs)):
        faults[run, list(pairs[pair])] = rng.normal(size=2) * 1500.0
    y = measured(H, runs, faults, seed=9)
    _, form = snapshot(H, y)
    found = raim.isolate(form, P_FA, 1, SURE)
    q = np.array([without(H, y, pair) for pair in pairs])
    one = np.array([without(H, y, (i, i)) for i in range(7)]).min(axis=0) < alone
    alike = disjoint = 0
    for run in np.flatnonzero(~one):
        best = int(q[:, run].argmin())
        margins = [SURE if set(pair) & set(pairs[best]) else chi2.isf(1e-3, 2) for pair in pairs]
        rivals = [k for k in range(21) if k != best and q[k, run] - q[best, run] < margins[k]]
        disjoint += any(not set(pairs[k]) & set(pairs[best]) for k in rivals)
        named = q[best, run] < chi2.isf(P_FA, 1) and not rivals
        alike += not named
        assert set(np.flatnonzero(found.excluded[run])) == (set(pairs[best]) if named else set()), run
        assert found.state[run] == (EXCLUDED if named else CANNOT_ISOLATE)
    assert 0 < alike < 200
    assert disjoint, "the example has pairs that share none"


def test_given_two_pairs_that_explain_the_same_residual_then_nobody_is_excluded():
    """A residual in the planes of (0, 1) and of (2, 3): both pairs leave nothing of it, whatever its size."""
    H = seoul(7)
    parity = np.linalg.qr(H, mode="complete")[0][:, 4:]
    normal = np.cross(parity[2], parity[3])
    for size in (500.0, 5000.0, 5e5):
        first = size / (parity[0] @ normal)
        faults = on(7, 0, first) + on(7, 1, -first * (parity[0] @ normal) / (parity[1] @ normal))
        _, form = snapshot(H, measured(H, 50, faults))
        found = raim.isolate(form, P_FA, 1, SURE)
        assert found.alarm.all()
        assert (found.state == CANNOT_ISOLATE).all()
        assert not found.excluded.any()
        np.testing.assert_array_equal(found.remaining.statistic, form.statistic)


def test_given_two_of_six_wrong_then_no_pair_is_named_for_nothing_would_check_it():
    H = seoul(6)
    _, form = snapshot(H, measured(H, 50, on(6, 1, 4e3) + on(6, 4, -3e3)))
    found = raim.isolate(form, P_FA, 1, SURE)
    assert (found.state == CANNOT_ISOLATE).all()
    assert not found.excluded.any()


def test_given_the_faults_on_one_pair_then_another_wins_no_more_often_than_the_margin_allows():
    """P(any other pair is named) for a fault in the worst direction: along the line where two planes meet."""
    H, runs = seoul(8), 4000
    parity = np.linalg.qr(H, mode="complete")[0][:, 4:]
    wrong = trials = 0
    for size in (150.0, 400.0, 2000.0):
        for a, b in ((0, 1), (2, 5)):
            faults = on(8, a, size) + on(8, b, -size * (parity[a] @ parity[6]) / (parity[b] @ parity[6]))
            _, form = snapshot(H, measured(H, runs, faults, seed=int(size) + a))
            found = raim.isolate(form, P_FA, 1, SURE)
            two = found.excluded.sum(axis=1) == 2
            wrong += np.count_nonzero(two & ~(found.excluded == (faults != 0.0)).all(axis=1))
            trials += runs
    # 27 other pairs, each at most 1e-3.
    assert wrong <= binom.isf(1e-6, trials, 27e-3)


def test_given_one_run_or_many_then_the_answer_is_the_same():
    H = seoul()
    two = measured(H, 20, on(8, 2, 1e6) + on(8, 5, 700.0))
    y = np.concatenate([measured(H, 20), measured(H, 20, on(8, 4, 90.0)), two])
    _, form = snapshot(H, y)
    together = raim.isolate(form, P_FA, 1, SURE)
    for k in range(60):
        alone = raim.isolate(snapshot(H, y[k : k + 1])[1], P_FA, 1, SURE)
        assert alone.state[0] == together.state[k]
        np.testing.assert_array_equal(alone.excluded[0], together.excluded[k])
        np.testing.assert_allclose(alone.remaining.statistic[0], together.remaining.statistic[k], rtol=1e-6, atol=1e-9)


def test_given_a_fault_of_a_million_kilometres_then_the_rest_is_still_judged_rightly():
    H = seoul()
    clean, gross = measured(H, 30, seed=4), measured(H, 30, on(8, 5, 1e9), seed=4)
    found = raim.isolate(snapshot(H, gross)[1], P_FA, 1, SURE)
    keep = np.arange(8) != 5
    _, rest = snapshot(H[keep], clean[:, keep])
    assert found.excluded[:, 5].all()
    np.testing.assert_allclose(found.remaining.statistic, rest.statistic, atol=0.05)


# ---- protection


def test_given_seoul_then_the_protection_level_is_as_known_by_both_ways():
    fix, _ = snapshot(seoul(), measured(seoul(), 1))
    lam = protection.noncentralities(fix.dof, P_FA, 1e-3)
    steep = protection.slopes(fix.gain, fix.projector, fix.valid)
    slope = protection.slope_level(steep, lam)[0]
    separation = protection.separation_level(steep, fix.gain, fix.covariance, fix.valid, P_FA, 1e-3)[0]
    assert slope == pytest.approx(54.0, abs=0.5)
    assert 0.8 < separation / slope < 1.4


def test_given_a_slope_then_it_is_the_error_a_bias_makes_over_the_root_of_its_noncentrality():
    H = seoul()
    fix, _ = snapshot(H, measured(H, 1))
    steep = protection.slopes(fix.gain, fix.projector, fix.valid)[0]
    for i in range(8):
        bias = on(8, i, 100.0)
        error = np.linalg.lstsq(H, bias, rcond=None)[0]
        noncentrality = np.sum((bias - H @ error) ** 2) / SIGMA**2
        assert steep[i] == pytest.approx(np.hypot(*error[:2]) / math.sqrt(noncentrality), rel=1e-9)


def test_given_solution_separation_then_it_is_that_of_solutions_with_one_deleted():
    H = seoul()
    fix, _ = snapshot(H, measured(H, 1))
    steep = protection.slopes(fix.gain, fix.projector, fix.valid)
    level = protection.separation_level(steep, fix.gain, fix.covariance, fix.valid, P_FA, 1e-3)[0]
    expected = []
    whole = SIGMA**2 * np.linalg.inv(H.T @ H)[:2, :2]
    for i in range(8):
        Hi = H[np.arange(8) != i]
        part = SIGMA**2 * np.linalg.inv(Hi.T @ Hi)[:2, :2]
        # The covariance of the difference is the difference of the covariances.
        difference = math.sqrt(np.linalg.eigvalsh(part - whole)[-1])
        deviation = math.sqrt(np.linalg.eigvalsh(part)[-1])
        expected.append(norm.isf(P_FA / 16) * difference + norm.isf(1e-3) * deviation)
    assert level == pytest.approx(max(expected), rel=1e-9)


def test_given_no_redundancy_then_there_is_no_protection():
    H = seoul(4)
    fix, _ = snapshot(H, measured(H, 1))
    lam = protection.noncentralities(fix.dof, P_FA, 1e-3)
    steep = protection.slopes(fix.gain, fix.projector, fix.valid)
    assert np.isnan(protection.slope_level(steep, lam)).all()
    assert np.isnan(protection.separation_level(steep, fix.gain, fix.covariance, fix.valid, P_FA, 1e-3)).all()
    assert np.isnan(protection.minimal_detectable_bias(fix.projector, np.ones((1, 4)), fix.valid, lam)).all()


def test_given_a_bias_that_escapes_then_the_error_is_within_the_protection_level():
    """Undetected and beyond the level in at most p_md of any bias on the worst satellite.

    By separation of solutions it holds as stated; the slope leaves the position's own noise out, which costs a factor.
    """
    H, runs, p_md = seoul(), 20_000, 1e-3
    fix, _ = snapshot(H, measured(H, 1))
    lam = protection.noncentralities(fix.dof, P_FA, p_md)
    steep = protection.slopes(fix.gain, fix.projector, fix.valid)
    slope = protection.slope_level(steep, lam)[0]
    separation = protection.separation_level(steep, fix.gain, fix.covariance, fix.valid, P_FA, p_md)[0]
    i = int(steep[0].argmax())
    for size in (60.0, 75.0, 90.0, 110.0):
        fix, form = snapshot(H, measured(H, runs, on(8, i, size), seed=int(size)))
        missed = ~raim.isolate(form, P_FA).alarm
        error = np.hypot(fix.x[:, 0] - 4.0, fix.x[:, 1] + 7.0)
        assert (missed & (error > separation)).sum() <= binom.isf(1e-6, runs, p_md)
        assert (missed & (error > slope)).mean() < 10 * p_md


def test_the_stanford_diagram_has_four_classes():
    error = np.array([5.0, 30.0, 60.0, 60.0, 5.0, 5.0, np.nan])
    level = np.array([20.0, 20.0, 20.0, 50.0, 60.0, np.nan, 20.0])
    good = np.array([True, True, True, False, True, True, True])
    classes = protection.stanford(error, level, 50.0, good)
    expected = [protection.NOMINAL, protection.MISLEADING, protection.HAZARDOUS] + [protection.UNAVAILABLE] * 4
    np.testing.assert_array_equal(classes, expected)


def test_consistent_is_the_usual_state():
    _, form = snapshot(seoul(), measured(seoul(), 200))
    assert (raim.isolate(form, P_FA, 1, SURE).state == CONSISTENT).mean() > 0.97
