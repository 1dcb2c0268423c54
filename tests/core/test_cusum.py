"""The cumulative sum: its scores, its threshold against simulation and theory, and what it finds and forgets."""

import numpy as np
import pytest
from scipy.stats import binom, chi2, kstest, ncx2

from ftcore.detection import cusum
from ftcore.detection.chi_square import threshold
from ftcore.detection.cusum import Rules

FALSE_FAILURE = 1e-6


@pytest.mark.parametrize("dof", [1, 2, 7, 20])
def test_scores_are_standard_normal_whatever_the_degrees_of_freedom(dof):
    statistic = np.random.default_rng(dof).chisquare(dof, size=20_000)
    assert kstest(cusum.score(statistic, np.full(20_000, dof)), "norm").pvalue > FALSE_FAILURE


def test_scores_keep_the_upper_tail_and_are_held_at_the_ends():
    dof = np.array([3, 3, 3, 3, 0])
    z = cusum.score(np.array([0.0, chi2.isf(1e-12, 3), 200.0, np.inf, 0.0]), dof)
    assert z[0] == -cusum.SCORE_LIMIT
    assert z[1] == pytest.approx(7.0345, abs=1e-3)  # normal quantile of 1e-12
    np.testing.assert_array_equal(z[2:4], cusum.SCORE_LIMIT)
    assert z[4] == 0.0


@pytest.mark.parametrize("reference", [0.25, 0.5])
@pytest.mark.parametrize("p_fa", [1e-2, 1e-3, 1e-6])
def test_threshold_agrees_with_the_renewal_theorem(p_fa, reference):
    """Siegmund (1985): in the long run P(g >= h) -> exp(-2 k (h + 0.583)) for small k."""
    h = cusum.stationary_threshold(p_fa, reference)
    assert h == pytest.approx(-np.log(p_fa) / (2 * reference) - 0.583, abs=0.015)


@pytest.mark.parametrize(("reference", "p_fa"), [(0.25, 0.01), (0.5, 0.01), (0.5, 1e-3), (1.5, 0.01)])
def test_in_the_long_run_a_fraction_p_fa_of_epochs_alarms(reference, p_fa):
    """200 000 independent runs, judged once, after 150 epochs; 2 per cent are left to the grid."""
    rng, runs = np.random.default_rng(1), 200_000
    rules, g = Rules(p_fa, reference), cusum.start(runs)
    h = rules.threshold
    for _ in range(150):
        g = np.clip(g + rng.standard_normal(runs) - reference, 0.0, 2.0 * h)
    low = binom.ppf(FALSE_FAILURE / 2, runs, 0.98 * p_fa)
    high = binom.ppf(1 - FALSE_FAILURE / 2, runs, 1.02 * p_fa)
    assert low <= np.count_nonzero(g >= h) <= high


def fly(statistics, dof, rules):
    """Alarms (epochs, runs)."""
    g, alarms = cusum.start(statistics.shape[1]), []
    for k in range(len(statistics)):
        before = g.copy()
        g.flags.writeable = False
        new, result = cusum.step(g, statistics[k], dof[k], rules, "gps")
        np.testing.assert_array_equal(g, before)
        g = new
        alarms.append(result.alarm)
    return np.array(alarms)


def test_the_whole_test_keeps_its_rate_when_rows_come_and_go():
    """Statistics on changing degrees of freedom; 40 000 runs judged once."""
    rng, runs = np.random.default_rng(2), 40_000
    dof = rng.integers(1, 12, size=(60, runs))
    alarms = fly(rng.chisquare(dof), dof, Rules(p_fa=0.01))[-1]
    low, high = binom.ppf([FALSE_FAILURE / 2, 1 - FALSE_FAILURE / 2], runs, 0.01)
    assert 0.97 * low <= alarms.sum() <= 1.03 * high


def test_a_small_fault_that_lasts_is_found_where_single_epochs_do_not_show_it():
    rng, runs, m, noncentrality = np.random.default_rng(3), 2000, 4, 4.0
    assert ncx2.sf(threshold(1e-3, m), m, noncentrality) < 0.1
    statistic = ncx2.rvs(m, noncentrality, size=(40, runs), random_state=rng)
    alarms = fly(statistic, np.full((40, runs), m), Rules())
    assert alarms[-1].mean() > 0.98
    delay = alarms.argmax(axis=0)
    assert np.median(delay) < 15


def test_a_large_fault_alarms_at_once_and_is_soon_forgotten():
    rng, runs = np.random.default_rng(4), 2000
    statistic = rng.chisquare(3, size=(200, runs))
    statistic[20:120] += 1e4
    alarms = fly(statistic, np.full((200, runs), 3), Rules())
    assert alarms[20].mean() > 0.7
    assert alarms[21:120].all()
    # From twice the threshold down at k = 0.5 an epoch: 13 epochs on average, hardly ever 60.
    assert np.median(alarms[120:].argmin(axis=0)) < 20
    assert alarms[180:].mean() < 0.01


def test_without_a_measurement_the_sum_stays():
    g, result = cusum.step(np.array([3.0, 9.0]), np.zeros(2), np.array([0]), Rules(), "gps")
    np.testing.assert_array_equal(g, [3.0, 9.0])
    assert result.dof.tolist() == [0, 0]
    assert result.alarm.tolist() == [False, True]


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ({"p_fa": 0.0}, "1e-12 to 0.1, not 0.0"),
        ({"p_fa": 0.5}, "1e-12 to 0.1, not 0.5"),
        ({"reference": 0.0}, "0.05 to 4 standard deviations, not 0.0"),
        ({"ceiling": 0.5}, "at least one threshold, not 0.5"),
    ],
)
def test_rules_that_cannot_work_are_refused(rules, message):
    with pytest.raises(ValueError, match=message):
        Rules(**rules)
