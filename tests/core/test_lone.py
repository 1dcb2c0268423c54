"""A subsystem without a peer: who is wrong is read off how it parted from the reference."""

import numpy as np

from ftcore.detection import lone

RUNS, ROWS = 200, 3


def heard(residual, beta=0.0, seed=1, present=None):
    """Epoch of the first belief of each run, inf where there is none; `residual (epochs,)` on all rows, in sigmas."""
    noise = np.random.default_rng(seed).standard_normal((len(residual), RUNS, ROWS))
    state = lone.start(RUNS, ROWS)
    found = np.full(RUNS, np.inf)
    for k, mean in enumerate(residual):
        there = np.ones(RUNS, bool) if present is None else np.full(RUNS, present[k])
        state, believed = lone.step(state, mean + noise[k], np.ones(ROWS), np.full(RUNS, beta), there)
        found = np.where(believed & np.isinf(found), k, found)
    return found


def test_a_reference_that_drifts_away_is_wrong_and_the_subsystem_is_believed():
    """A jump by chance happens in 1e-5 of the epochs, or thrice that as the slope is an estimate: 1 of 200 runs."""
    found = heard(5.0 + 0.5 * np.arange(60.0))
    assert (found < 35).mean() > 0.95


def test_a_bias_that_came_with_one_jump_stays_out_until_patience_is_over():
    found = heard(np.r_[np.zeros(10), np.full(200, 8.0)])
    assert (found > lone.STEADY + 15).mean() > 0.9
    assert np.isfinite(found).mean() > 0.9, "but not for ever"


def test_noise_that_is_over_is_forgiven_although_the_reference_has_gone_meanwhile():
    rough = 30.0 * np.random.default_rng(7).standard_normal(60)
    found = heard(np.r_[rough, 100.0 + 6.0 * np.arange(90.0)])
    assert (found > 60).all()
    assert (found < 60 + 60).mean() > 0.95


def test_one_that_is_trusted_or_has_no_reading_has_nothing_to_be_forgiven():
    assert np.isinf(heard(np.zeros(60), beta=1.0)).all()
    assert np.isinf(heard(np.zeros(60), present=np.zeros(60, bool))).all()


def test_a_correction_of_the_sins_is_no_jump():
    state = lone.start(1, ROWS)
    state, _ = lone.step(state, np.zeros((1, ROWS)), np.ones(ROWS), np.zeros(1), np.ones(1, bool))
    after, _ = lone.step(lone.moved(state), np.full((1, ROWS), 50.0), np.ones(ROWS), np.zeros(1), np.ones(1, bool))
    assert after.jumps[0] == 0
    after, _ = lone.step(state, np.full((1, ROWS), 50.0), np.ones(ROWS), np.zeros(1), np.ones(1, bool))
    assert after.jumps[0] == 1
