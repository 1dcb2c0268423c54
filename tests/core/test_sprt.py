"""The sequential probability ratio test against Wald's theory."""

import numpy as np
import pytest
from scipy.special import log_ndtr

from ftcore.detection import sprt

RUNS = 10_000


def decisions(rules, mean, seed):
    """Number of readings to the first decision of each run, and whether it was an alarm; scores have this mean."""
    rng = np.random.default_rng(seed)
    ratio, number, alarm = sprt.start(RUNS), np.zeros(RUNS, int), np.zeros(RUNS, bool)
    for n in range(1, 2000):
        z = np.clip(rng.normal(mean, 1.0, RUNS), -7.5, 7.5)
        # On two degrees of freedom the statistic with this score is known in closed form.
        ratio, test = sprt.step(ratio, -2.0 * log_ndtr(-z), np.full(RUNS, 2), rules, "gps")
        first = (number == 0) & test.extra["decided"]
        number[first], alarm[first] = n, test.alarm[first]
        if number.all():
            return number, alarm
    raise AssertionError("some runs decide nothing")


@pytest.mark.parametrize(("shift", "false", "missed"), [(0.4, 1e-2, 1e-2), (0.4, 1e-3, 1e-2), (0.25, 0.05, 0.1)])
@pytest.mark.parametrize("fault", [False, True])
def test_given_the_shift_then_the_mean_sample_number_is_walds(shift, false, missed, fault):
    """10 % holds the overshoot of the bounds, about 0.58 shift each (Siegmund 1985), and six standard errors."""
    rules = sprt.Rules(shift, false, missed)
    number, _ = decisions(rules, shift if fault else 0.0, seed=int(100 * shift) + fault)
    assert number.mean() == pytest.approx(rules.sample_number(fault), rel=0.1)


def test_given_decisions_then_the_errors_are_as_rare_as_stated():
    """Wald: false / (1 - missed) and missed / (1 - false) at most; five standard errors of 1e4 runs above that."""
    rules = sprt.Rules(shift=1.0, false=0.02, missed=0.05)
    _, alarm = decisions(rules, 0.0, seed=5)
    bound = 0.02 / 0.95
    assert 0.0 < alarm.mean() <= bound + 5.0 * np.sqrt(bound * (1.0 - bound) / RUNS)
    _, alarm = decisions(rules, 1.0, seed=6)
    bound = 0.05 / 0.98
    assert 0.0 < 1.0 - alarm.mean() <= bound + 5.0 * np.sqrt(bound * (1.0 - bound) / RUNS)


def test_given_an_alarm_then_it_stays_while_readings_speak_for_the_fault_and_ends_when_one_does_not():
    rules = sprt.Rules()
    ratio = sprt.start(1)
    seen = []
    for statistic in (100.0, 100.0, 60.0, 0.1, 0.1):
        ratio, test = sprt.step(ratio, np.array([statistic]), np.array([3]), rules, "gps")
        seen.append(bool(test.alarm[0]))
    assert seen == [True, True, True, False, False]


def test_given_no_measurement_then_nothing_is_judged_and_the_ratio_stays():
    ratio, test = sprt.step(np.array([1.5]), np.array([99.0]), np.array([0]), sprt.Rules(), "gps")
    assert ratio[0] == 1.5
    assert test.dof[0] == 0
    assert not test.alarm[0]


@pytest.mark.parametrize("rules", [{"shift": 0.0}, {"false": 0.0}, {"missed": 1.0}, {"false": 0.6, "missed": 0.5}])
def test_given_rules_that_cannot_work_then_they_are_refused(rules):
    with pytest.raises(ValueError, match="not"):
        sprt.Rules(**rules)
