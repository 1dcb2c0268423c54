"""The GLR test against brute-force least squares over everything measured, and its rates against theory."""

import numpy as np
import pytest
from scipy.stats import binom, chi2

from ftcore.detection import likelihood_ratio as glr
from ftcore.estimation import kalman

FALSE_FAILURE = 1e-6


def band(n, p):
    return binom.ppf([FALSE_FAILURE / 2, 1 - FALSE_FAILURE / 2], n, p)


def spd(rng, n):
    A = rng.normal(size=(n, n))
    return A @ A.T + np.eye(n)


class Linear:
    """A stable system and its filter."""

    def __init__(self, seed, n=4, m=2, radius=0.95):
        self.rng = rng = np.random.default_rng(seed)
        self.n, self.m = n, m
        Phi = rng.normal(size=(n, n))
        self.Phi = Phi * radius / np.abs(np.linalg.eigvals(Phi)).max()
        self.Q, self.P0 = 0.1 * spd(rng, n), spd(rng, n)
        self.H, self.R = rng.normal(size=(m, n)), rng.uniform(0.5, 2.0, size=m)

    def readings(self, epochs, runs, step=(0, 0.0), onset=0, jump=None):
        """(epochs, runs, m): a step (column, size) from the onset on, or a jump of the state at it."""
        x = self.rng.normal(size=(runs, self.n)) @ np.linalg.cholesky(self.P0).T
        for k in range(epochs):
            x = x @ self.Phi.T + self.rng.normal(size=x.shape) @ np.linalg.cholesky(self.Q).T
            if jump is not None and k == onset:
                x = x + jump
            y = x @ self.H.T + self.rng.normal(size=(runs, self.m)) * np.sqrt(self.R)
            y[:, step[0]] += step[1] * (k >= onset)
            yield y

    def watch(self, readings, window, directions=None, valid=None, per_run=False, columns=None):
        """Filter the readings and yield the state of the test after each; columns(k) chooses and orders them."""
        state = glr.start(self.n, window, directions)
        x, P = np.zeros((1, self.n)), self.P0[None]
        Phi, Q = self.Phi[None], self.Q[None]
        for k, y in enumerate(readings):
            ids = np.arange(self.m) if columns is None else np.array(columns(k))
            H, R = self.H[ids][None], self.R[ids][None]
            y = y[:, ids]
            if per_run:
                P, Phi, Q, H, R = (np.repeat(a, len(y), axis=0) if len(a) == 1 else a for a in (P, Phi, Q, H, R))
            ok = None if valid is None else valid(k, len(y))
            x, P = kalman.predict(x, P, Phi, Q)
            u = kalman.update(x, P, y, H, R, ok)
            x, P = u.x, u.P
            for a in (state.F, state.d, state.C, state.ids):
                a.flags.writeable = False
            state = glr.step(state, u, Phi, H, ids, ok)
            yield state


def last(states):
    *_, state = states
    return state


def test_evidence_is_that_of_joint_least_squares_over_all_measurements():
    """Brute force: the joint covariance of all measurements, the signature of a step in them, and Gauss-Markov."""
    system = Linear(1)
    n, m, epochs, window = 4, 2, 9, 5
    f = np.array([[1.0], [-2.0], [0.5], [0.0]])
    readings = list(system.readings(epochs, 3))
    # Y = A s with s = (x0, w_0 ... w_8, v_0 ... v_8); rows of A by simulation of every unit input.
    effect = np.zeros((epochs, n, n + epochs * n))  # x_k from x0 and w
    x = np.eye(n, n + epochs * n)
    for k in range(epochs):
        x = system.Phi @ x + np.eye(n, n + epochs * n, n + k * n)
        effect[k] = x
    A = (system.H @ effect).reshape(epochs * m, -1)
    prior = np.zeros((n + epochs * n,) * 2)
    prior[:n, :n] = system.P0
    for k in range(epochs):
        at = slice(n + k * n, 2 * n + k * n)
        prior[at, at] = system.Q
    inverse = np.linalg.inv(A @ prior @ A.T + np.diag(np.tile(system.R, epochs)))
    state = last(system.watch(readings, window, f))
    Y = np.stack(readings).transpose(1, 0, 2).reshape(3, -1)
    best = np.zeros(3)
    for onset in range(epochs - window, epochs):
        for c in range(m + 1):
            s = np.zeros((epochs, m))
            if c < m:
                s[onset:, c] = 1.0
            else:
                jump = f[:, 0]
                for k in range(onset, epochs):
                    s[k] = system.H @ jump
                    jump = system.Phi @ jump
            s = s.ravel()
            d, C = Y @ inverse @ s, s @ inverse @ s
            np.testing.assert_allclose(state.d[:, onset % window, c], d, rtol=1e-8, atol=1e-10)
            np.testing.assert_allclose(state.C[:, onset % window, c], C, rtol=1e-8)
            best = np.maximum(best, d**2 / C)
    result = glr.glr_test(state, 1e-3, "gps")
    np.testing.assert_allclose(result.statistic, best, rtol=1e-8)
    np.testing.assert_allclose(result.threshold, chi2.isf(1 - (1 - 1e-3) ** (1 / 15), 1), rtol=1e-9)


def test_culprit_onset_and_size_of_a_step_are_named():
    """Given 12 sigma on column 1 since 6 epochs; the size is unbiased and has the stated deviation."""
    system, runs = Linear(2, n=3, m=3), 2000
    states = list(system.watch(system.readings(16, runs, step=(1, 12.0), onset=10), 10))
    assert glr.glr_test(states[9], 1e-3, "gps").alarm.mean() < 0.01
    result = glr.glr_test(states[-1], 1e-3, "gps")
    assert result.alarm.all()
    right = (result.extra["column"] == 1) & (result.extra["age"] == 5)
    assert right.mean() > 0.99
    error = (result.extra["size"] - 12.0) / result.extra["sigma"]
    assert abs(error[right].mean()) * np.sqrt(right.sum()) < 5.0
    assert error[right].std() == pytest.approx(1.0, abs=0.08)  # five deviations of a standard deviation of 2000


def test_an_onset_in_the_first_epoch_is_dated_there():
    system = Linear(13, n=3, m=3)
    for k, state in enumerate(system.watch(system.readings(4, 50, step=(2, 80.0)), 10)):
        assert (glr.glr_test(state, 1e-3, "gps").extra["age"] == k).all()


def test_a_jump_of_the_state_is_told_from_a_step_of_a_sensor():
    system, runs = Linear(3, n=3, m=3), 1000
    f = np.array([[1.0], [0.0], [0.0]])
    readings = system.readings(12, runs, onset=6, jump=25.0 * f[:, 0])
    result = glr.glr_test(last(system.watch(readings, 8, f)), 1e-3, "gps")
    assert (result.extra["column"] == -1).mean() > 0.99
    assert (result.extra["age"] == 5).mean() > 0.99
    error = (result.extra["size"] - 25.0) / result.extra["sigma"]
    assert abs(error.mean()) * np.sqrt(runs) < 6.0


def test_small_steps_are_found_that_the_residual_does_not_show():
    """1.5 sigma for 15 epochs: the test gathers what no single innovation shows."""
    system, runs = Linear(4, n=3, m=3, radius=0.7), 1000
    size = 1.5 * np.sqrt(system.R[0])
    result = glr.glr_test(last(system.watch(system.readings(35, runs, (0, size), 20), 20)), 1e-3, "gps")
    assert result.alarm.mean() > 0.5
    assert (result.extra["column"][result.alarm] == 0).mean() > 0.9


# False alarms


def test_with_independent_hypotheses_the_rate_is_exactly_p_fa():
    """A filter that learns nothing (H = 0) and a window of one: five independent chi-squares."""
    runs, m = 100_000, 5
    rng = np.random.default_rng(5)
    u = kalman.update(
        np.zeros((1, 1)), np.eye(1)[None], rng.normal(size=(runs, m)), np.zeros((1, m, 1)), np.ones((1, m))
    )
    state = glr.step(glr.start(1, 1), u, np.eye(1)[None], np.zeros((1, m, 1)), np.arange(m))
    low, high = band(runs, 0.02)
    assert low <= glr.glr_test(state, 0.02, "gps").alarm.sum() <= high


def gps_like(q):
    system = Linear(6, n=8, m=16)
    rng = np.random.default_rng(6)
    los = rng.normal(size=(8, 3))
    los[:, 2] = np.abs(los[:, 2])
    los /= np.linalg.norm(los, axis=1, keepdims=True)
    system.Phi, system.Q, system.H = np.eye(8), 1e-6 * np.eye(8), np.zeros((16, 8))
    for i in range(3):
        system.Phi[i, 3 + i] = 1.0
        system.Q[np.ix_([i, 3 + i], [i, 3 + i])] += q * np.array([[1 / 3, 1 / 2], [1 / 2, 1]])
    system.Phi[6, 7] = 1.0
    system.Q[6:, 6:] += [[0.1, 0.05], [0.05, 0.1]]
    system.H[:8, :3] = system.H[8:, 3:6] = los
    system.H[:8, 6] = system.H[8:, 7] = 1.0
    system.R = np.repeat([100.0, 0.01], 8)
    system.P0 = np.diag([2500.0] * 3 + [1.0] * 3 + [1e6, 100.0])
    return system


@pytest.mark.parametrize(("q", "window"), [(1e-4, 30), (1.0, 30), (1e-2, 10)])
def test_the_false_alarm_rate_is_at_most_p_fa_and_not_far_below(q, window):
    """Runs are independent, so an epoch's count is binomial with a probability in [0.3, 1] p_fa (3 epochs judged)."""
    runs, p = 4000, 0.05
    for k, state in enumerate(gps_like(q).watch(gps_like(q).readings(45, runs), window)):
        if k in (3, 20, 44):
            alarms = glr.glr_test(state, p, "gps").alarm.sum()
            assert band(runs, 0.3 * p)[0] <= alarms <= band(runs, p)[1]


# Columns that come and go


def test_a_masked_column_is_a_column_deleted():
    system = Linear(7, m=3)
    readings = list(system.readings(8, 4))
    masked = last(system.watch(readings, 5, valid=lambda k, runs: np.array([[True, False, True]])))
    deleted = last(system.watch(readings, 5, columns=lambda k: [0, 2]))
    np.testing.assert_allclose(masked.C[..., [0, 2]], deleted.C, rtol=1e-9)
    np.testing.assert_allclose(masked.d[..., [0, 2]], deleted.d, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(masked.C[..., 1], 0.0)
    a, b = (glr.glr_test(s, 1e-3, "gps") for s in (masked, deleted))
    np.testing.assert_allclose(a.statistic, b.statistic, rtol=1e-9)
    np.testing.assert_allclose(a.threshold, b.threshold)


def test_columns_may_change_places_rise_and_set():
    """Given a satellite that rises at epoch 4, and one that sets at 7; then it is as if they had been masked before."""
    system = Linear(8, m=4)
    readings = list(system.readings(11, 3))

    def columns(k):
        return [3, 1, 0] if k < 4 else ([0, 2, 1, 3] if k < 7 else [2, 3, 0])

    def valid(k, runs):
        return np.array([[True, k < 7, k >= 4, True]])

    f = np.ones((4, 1))
    moving = last(system.watch(readings, 6, f, columns=columns))
    fixed = last(system.watch(readings, 6, f, valid=valid))
    order = [2, 3, 0, 4]
    np.testing.assert_array_equal(moving.ids, [2, 3, 0])
    np.testing.assert_allclose(moving.C, fixed.C[..., order], rtol=1e-9)
    np.testing.assert_allclose(moving.d, fixed.d[..., order], rtol=1e-9, atol=1e-12)


def test_a_column_that_returns_begins_without_a_past():
    system = Linear(9, m=2)
    states = list(system.watch(system.readings(6, 1), 4, columns=lambda k: [0] if k == 3 else [0, 1]))
    assert (states[2].C[..., 1] > 0.0).all()
    once = states[4].C[..., 1]
    np.testing.assert_allclose(once, once[0, 0])  # every onset has seen this one epoch only


def test_ids_must_name():
    system = Linear(10)
    with pytest.raises(ValueError, match=r"an id of its own; got \[0, 0\]"):
        last(system.watch(system.readings(1, 1), 4, columns=lambda k: [0, 0]))
    state = last(system.watch(system.readings(1, 1), 4))
    u = kalman.update(np.zeros((1, 4)), np.eye(4)[None], np.zeros((1, 2)), system.H[None], system.R[None])
    with pytest.raises(ValueError, match="negative ones name state jumps"):
        glr.step(state, u, system.Phi[None], system.H[None], np.array([0, -1]))


# Runs


def test_what_is_common_to_all_runs_gives_the_same_as_each_run_alone():
    system = Linear(11)
    readings = list(system.readings(8, 5))
    common, each = (last(system.watch(readings, 4, per_run=p)) for p in (False, True))
    assert common.F.shape[0] == common.C.shape[0] == 1
    assert each.F.shape[0] == 5
    alone = last(system.watch([y[2:3] for y in readings], 4))
    for other, run in ((each, slice(None)), (alone, slice(2, 3))):
        a, b = glr.glr_test(common, 0.5, "gps"), glr.glr_test(other, 0.5, "gps")
        np.testing.assert_allclose(a.statistic[run], b.statistic, rtol=1e-9)
        np.testing.assert_array_equal(a.alarm[run], b.alarm)
        for key in ("column", "age", "size", "sigma"):
            np.testing.assert_allclose(a.extra[key][run], b.extra[key], rtol=1e-9)


def test_reset_forgets_in_its_own_runs_only():
    system = Linear(12)
    state = last(system.watch(system.readings(8, 3), 4))
    cleared = glr.reset(state, np.array([False, True, False]))
    before, after = glr.glr_test(state, 0.5, "gps"), glr.glr_test(cleared, 0.5, "gps")
    np.testing.assert_allclose(after.statistic, np.where([0, 1, 0], 0.0, before.statistic))
    assert after.dof.tolist() == [1, 0, 1]
    assert not after.alarm[1]
    assert state.d[1].any()  # the older value is still what it was


def test_nothing_seen_means_nothing_to_say():
    result = glr.glr_test(glr.start(3, 5), 1e-3, "gps")
    assert result.dof.tolist() == [0]
    assert not result.alarm.any()
    assert not glr.glr_test(glr.start(3, 5, np.ones((3, 2))), 1e-3, "gps").alarm.any()


def test_windows_and_directions_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="at least one epoch, not 0"):
        glr.start(3, 0)
    with pytest.raises(ValueError, match=r"\(3, jumps\); got shape \(2, 1\)"):
        glr.start(3, 5, np.ones((2, 1)))
    with pytest.raises(ValueError, match="between 0 and 1, not 2"):
        glr.sidak_threshold(2.0, np.array([3]))
    np.testing.assert_allclose(
        glr.sidak_threshold(1e-3, np.array([1, 10_000])), chi2.isf([1e-3, 1.0005e-7], 1), rtol=1e-4
    )
