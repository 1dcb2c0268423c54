"""The supervisor's promises, for given stories and for any story."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom

from ftcore.detection import supervisor
from ftcore.detection.supervisor import HEALTHY, ISOLATED, OFF, SUSPECT, Rules


def story(alarms, admission=None, enabled=None, rules=None):
    """Run (epochs, runs, S) stories; returns the decisions. A one-dimensional story is one run of one subject."""
    alarms = np.asarray(alarms, dtype=bool)
    if alarms.ndim == 1:
        alarms = alarms[:, None, None]
    epochs = alarms.shape[0]
    admission = np.ones_like(alarms) if admission is None else np.asarray(admission, bool).reshape(alarms.shape)
    enabled = (
        np.ones_like(alarms) if enabled is None else np.asarray(enabled, bool).reshape(epochs, -1, alarms.shape[2])
    )
    state = supervisor.start(*alarms.shape[1:])
    decisions = []
    for k in range(epochs):
        for a in (state.health, state.history, state.streak):
            a.flags.writeable = False
        state, decision = supervisor.step(state, alarms[k], admission[k], enabled[k], rules or Rules())
        decisions.append(decision)
    return decisions


def health(decisions):
    return [int(d.health[0, 0]) for d in decisions]


def used(decisions):
    return [bool(d.use[0, 0]) for d in decisions]


def test_a_single_alarm_withholds_one_measurement_and_does_not_stick():
    told = story([0, 1, 0, 0])
    assert health(told) == [HEALTHY, SUSPECT, HEALTHY, HEALTHY]
    assert used(told) == [True, False, True, True]
    assert [bool(d.just_suspected.item()) for d in told] == [False, True, False, False]


def test_m_alarms_in_n_epochs_isolate_and_fewer_do_not():
    rules = Rules(confirm=3, window=5, hold_off=4)
    assert health(story([1, 0, 1, 0, 1], rules=rules))[-1] == ISOLATED
    assert health(story([1, 0, 1, 0, 0, 1, 0], rules=rules)) == [
        SUSPECT,
        HEALTHY,
        SUSPECT,
        HEALTHY,
        HEALTHY,
        SUSPECT,
        HEALTHY,
    ]
    told = story([1, 1, 1], rules=rules)
    assert [bool(d.just_isolated.item()) for d in told] == [False, False, True]
    assert [int(d.alarms_in_window.item()) for d in told] == [1, 2, 3]
    assert not any(used(told))


def test_a_suspect_stays_withheld_until_it_was_quiet_for_long_enough():
    told = story([1, 0, 0, 0, 0], rules=Rules(confirm=3, window=5, clear=3))
    assert health(told) == [SUSPECT, SUSPECT, SUSPECT, HEALTHY, HEALTHY]


def test_an_isolated_subject_returns_after_an_unbroken_hold_off_and_starts_afresh():
    rules = Rules(confirm=2, window=3, hold_off=3)
    admission = [0, 0, 1, 1, 0, 1, 1, 1, 1, 1]
    told = story([1, 1, 1, 1, 1, 1, 1, 1, 0, 1], admission, rules=rules)
    assert health(told) == [SUSPECT, *[ISOLATED] * 6, HEALTHY, HEALTHY, SUSPECT]
    # In the epoch of its return its filter is still contaminated: re-initialised after the fusion, used from the next.
    assert [bool(d.just_readmitted.item()) for d in told] == [False] * 7 + [True, False, False]
    assert used(told) == [False] * 8 + [True, False]
    assert told[7].members.item()


def test_alarms_from_before_the_isolation_do_not_count_after_the_return():
    rules = Rules(confirm=2, window=20, hold_off=2)
    told = story([1, 1, 0, 0, 1, 0], rules=rules)
    assert health(told) == [SUSPECT, ISOLATED, ISOLATED, HEALTHY, SUSPECT, HEALTHY]
    assert told[4].alarms_in_window.item() == 1


def test_switching_off_is_not_isolation_and_switching_on_takes_one_passed_admission():
    rules = Rules(hold_off=5)
    enabled = [1, 0, 0, 1, 1, 0, 1, 1, 1, 1, 1, 1, 1]
    admission = [1, 1, 1, 1, 1, 1, 0, 1, 1, 1, 1, 1, 1]
    told = story([0] * 13, admission, enabled, rules)
    assert health(told) == [HEALTHY, OFF, OFF, HEALTHY, HEALTHY, OFF, *[ISOLATED] * 5, HEALTHY, HEALTHY]
    assert [bool(d.just_readmitted.item()) for d in told][3]
    assert used(told)[3:5] == [False, True]
    assert not any(d.just_isolated.any() for d in told)


@pytest.mark.parametrize(("isolate_last", "expected"), [(True, [False, False]), (False, [False, True])])
def test_whether_the_last_one_standing_may_be_isolated(isolate_last, expected):
    """Two subjects: the first fails for good, later the second does too."""
    alarms = np.zeros((12, 1, 2), dtype=bool)
    alarms[2:, 0, 0] = True
    alarms[6:, 0, 1] = True
    told = story(alarms, ~alarms, rules=Rules(isolate_last=isolate_last))
    assert told[-1].use[0].tolist() == expected
    assert told[-1].health[0].tolist() == [ISOLATED, ISOLATED if isolate_last else SUSPECT]


def test_of_two_that_would_go_together_the_one_with_fewer_alarms_stays():
    alarms = np.array([[[1, 0]], [[1, 1]], [[1, 1]], [[1, 1]]], dtype=bool)
    told = story(alarms, ~alarms, rules=Rules(confirm=3, window=4, isolate_last=False))
    assert told[-1].health[0].tolist() == [ISOLATED, SUSPECT]
    assert told[-1].use[0].tolist() == [False, True]


def test_false_isolations_under_random_alarms_have_the_binomial_probability():
    """Given independent false alarms, isolation at the epoch the window fills first follows the binomial law."""
    runs, p = 100_000, 0.1
    alarms = np.random.default_rng(1).random((3, runs, 1)) < p
    isolated = np.zeros((runs, 1), dtype=bool)
    for d in story(alarms, ~alarms, rules=Rules(confirm=2, window=3, hold_off=50)):
        isolated |= d.just_isolated
    expected = binom.sf(1, 3, p)
    low, high = binom.ppf([5e-7, 1 - 5e-7], runs, expected)
    assert low <= isolated.sum() <= high


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ({"confirm": 4, "window": 3}, "4 alarms in 3 epochs"),
        ({"confirm": 0}, "1 at least, the window at most"),
        ({"window": 64}, "1 to 63 epochs, not 64"),
        ({"clear": 0}, "at least 1 epoch without an alarm, not 0"),
        ({"hold_off": 0}, "at least 1 epoch of passed admission, not 0"),
    ],
)
def test_rules_that_cannot_be_are_refused(rules, message):
    with pytest.raises(ValueError, match=message):
        Rules(**rules)


RULES = st.builds(
    lambda window, confirm, clear, hold_off, isolate_last: Rules(
        min(confirm, window), window, clear, hold_off, isolate_last
    ),
    st.integers(1, 6),
    st.integers(1, 6),
    st.integers(1, 4),
    st.integers(1, 6),
    st.booleans(),
)


def random_story(seed, epochs=40, runs=4, subjects=3):
    rng = np.random.default_rng(seed)
    shape = (epochs, runs, subjects)
    rate = rng.random((runs, subjects))
    return rng.random(shape) < rate, rng.random(shape) < 0.8, rng.random((epochs, 1, subjects)) < 0.95


@settings(max_examples=150, deadline=None)
@given(RULES, st.integers(0, 10_000))
def test_whatever_happens(rules, seed):
    alarms, admission, enabled = random_story(seed)
    told = story(alarms, admission, enabled, rules)
    for k, d in enumerate(told):
        on = np.broadcast_to(enabled[k], d.use.shape)
        assert not (d.use & (d.isolated | ~on)).any()  # what is used is neither isolated nor off
        np.testing.assert_array_equal(d.health == OFF, ~on)
        np.testing.assert_array_equal(d.members, on & ~d.isolated)
        assert not (d.use & d.just_readmitted).any()
        assert (d.use[(d.health == HEALTHY) & ~d.just_readmitted]).all()
        assert (alarms[k] | ~d.just_isolated).all()  # nobody is isolated without an alarm in that epoch
        assert (d.alarms_in_window[d.just_isolated] >= rules.confirm).all()
        if rules.isolate_last:
            assert not (d.use & alarms[k]).any()  # whoever alarms is withheld at once
            assert not (d.use & d.suspect).any()
        else:
            lost = ~d.members.any(axis=1) & on.any(axis=1)
            before = told[k - 1].members if k else np.ones_like(d.members)
            assert not (lost & (before & on).any(axis=1)).any()  # isolation never takes the last one
        if k:
            previous = told[k - 1]
            back = previous.isolated & on & ~d.isolated
            np.testing.assert_array_equal(back & ~d.just_readmitted, False)  # no way back but readmission
            np.testing.assert_array_equal(d.isolated & (previous.health < ISOLATED), d.just_isolated)


@settings(max_examples=60, deadline=None)
@given(RULES, st.integers(0, 10_000))
def test_runs_and_subjects_do_not_influence_each_other(rules, seed):
    rules = Rules(rules.confirm, rules.window, rules.clear, rules.hold_off)
    alarms, admission, enabled = random_story(seed)
    together = story(alarms, admission, enabled, rules)
    alone = story(alarms[:, 2:3, 1:2], admission[:, 2:3, 1:2], enabled[:, :, 1:2], rules)
    for a, b in zip(together, alone, strict=True):
        assert a.health[2, 1] == b.health[0, 0]
        assert a.use[2, 1] == b.use[0, 0]


@settings(max_examples=100, deadline=None)
@given(RULES, st.integers(0, 30))
def test_a_single_alarm_never_isolates_when_two_are_asked_for(rules, when):
    alarms = np.zeros(40, dtype=bool)
    alarms[when] = True
    told = story(alarms, rules=rules)
    isolates = rules.confirm == 1 and rules.isolate_last
    assert any(d.isolated.any() for d in told) == isolates
    if not isolates:
        assert used(told)[when + rules.clear :] == [True] * (40 - when - rules.clear)


@settings(max_examples=100, deadline=None)
@given(RULES, st.integers(0, 10_000))
def test_a_subject_that_is_clean_for_good_is_back_within_the_hold_off(rules, seed):
    alarms, admission, enabled = random_story(seed)
    alarms[20:], admission[20:], enabled[20:] = False, True, True
    told = story(alarms, admission, enabled, rules)
    for d in told[20 + max(rules.hold_off, rules.clear) :]:
        assert (d.health == HEALTHY).all()
        assert d.use.all()


@settings(max_examples=60, deadline=None)
@given(RULES)
def test_a_fault_that_stays_is_isolated_after_m_epochs_and_never_used_again(rules):
    rules = Rules(rules.confirm, rules.window, rules.clear, rules.hold_off)
    alarms = np.arange(40) >= 7
    told = story(alarms, ~alarms, rules=rules)
    assert health(told)[7 + rules.confirm - 1 :] == [ISOLATED] * (40 - 7 - rules.confirm + 1)
    assert used(told) == [True] * 7 + [False] * 33
