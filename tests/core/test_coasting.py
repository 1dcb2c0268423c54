"""Believing a subsystem without a peer: what sounds like gyros that drift is heard, what sounds like a fault is not.

A star tracker of 3 arcsec beside gyros of 1 deg/h (1 arcsec a second) and 300 ppm, in straight flight or in a turn of
2 deg/s. Units are arcseconds and seconds. Validities are given by hand: 1 while trusted, 0 while rejected.
"""

import numpy as np
import pytest
from scipy.stats import binom, ncx2

from ftcore.detection import coasting

SIGMA, BIAS, SCALE = 3.0, 1.0, 300e-6
TURN = 2.0 * 3600.0
TRUSTED = 200
RUNS = 200


def flight(epochs, turning, seed=0, runs=RUNS):
    """Raw motion less a sound star tracker (epochs, runs, 3), and its reach (epochs, runs, 3, 6)."""
    rng = np.random.default_rng(seed)
    rate = np.zeros((epochs, 3))
    rate[turning, 2] = TURN
    t = np.arange(epochs)[:, None, None] * np.ones(3)
    reach = np.concatenate([BIAS * np.eye(3) * t[:, :, :1], SCALE * np.cumsum(rate, axis=0)[:, None] * np.eye(3)], -1)
    datasheet = rng.normal(size=(runs, 6))
    raw = np.einsum("tij,rj->tri", reach, datasheet) + SIGMA * rng.normal(size=(epochs, runs, 3))
    return raw, np.broadcast_to(reach[:, None], (epochs, runs, 3, 6))


def heard(raw, reach, beta):
    """Where the subsystem is believed, (epochs, runs); beta (epochs,) or (epochs, runs)."""
    beta = np.broadcast_to(np.reshape(beta, (len(raw), -1)), raw.shape[:2])
    state = coasting.start(raw.shape[1], 3, 6, 1)
    said = []
    for k in range(len(raw)):
        state, believed, _ = coasting.coast(state, raw[k], reach[k], SIGMA**2, beta[k], np.full((raw.shape[1], 1), k))
        said.append(believed)
    return np.array(said)


def rejected_from(onset, epochs):
    return (np.arange(epochs) < onset).astype(float)


@pytest.mark.parametrize("turning", [slice(0, 0), slice(TRUSTED - 5, TRUSTED + 30)], ids=["straight", "in a turn"])
def test_given_a_reference_that_drifted_away_then_the_sound_subsystem_is_soon_believed_for_a_while(turning):
    """It is rejected without a fault. Averaged validities fall below one half after five epochs."""
    epochs = TRUSTED + 40
    said = heard(*flight(epochs, turning), rejected_from(TRUSTED, epochs))
    first = said.argmax(axis=0)
    # Each question is answered wrongly by a sound one with 1e-3: of 200 runs more than 6 late ones have 1e-4.
    assert (first - TRUSTED <= coasting.MEMORY).sum() >= RUNS - 6
    assert not said[:TRUSTED].any()
    assert (said[:, first - TRUSTED <= 10].sum(axis=0) >= coasting.HEARING).all()


@pytest.mark.parametrize("jump", [15.0, 30.0, 100.0])
def test_given_a_jump_out_of_good_standing_then_it_is_not_believed_until_it_has_jumped_back(jump):
    """A step is that of two readings, and what the data sheet allows in a second; the least jump is missed at times."""
    spread = 2.0 * SIGMA**2 + BIAS**2
    missed = ncx2.cdf(coasting.threshold(coasting.P_JUMP, 3), 3, 3.0 * jump**2 / spread)
    most = binom.isf(1e-4, RUNS, missed)
    back, epochs = TRUSTED + 120, TRUSTED + 160
    raw, reach = flight(epochs, slice(0, 0))
    raw[TRUSTED:back] += jump
    said = heard(raw, reach, rejected_from(TRUSTED, epochs))
    assert said[:back].any(axis=0).sum() <= most
    late = ~said[back : back + coasting.WINDOW + 2].any(axis=0)
    assert late.sum() <= most + 6


def test_given_a_fault_that_was_taken_for_drift_when_it_ends_then_the_subsystem_is_believed_at_once():
    """A ramp of 1.5 arcsec a second drags everybody along; trusted again only lately, it jumps back by its end."""
    start, end, epochs = 220, 340, 400
    raw, reach = flight(epochs, slice(0, 0))
    raw[start:end] += 1.5 * np.arange(end - start)[:, None, None]
    beta = np.ones(epochs)
    beta[300:312] = 0.0
    beta[end:] = 0.0
    said = heard(raw, reach, beta)
    assert (~said[end : end + coasting.WINDOW + 2].any(axis=0)).sum() <= 6


@pytest.mark.parametrize("fault", ["stuck in a turn", "noise", "spikes", "fast ramp", "fast sine"])
def test_given_a_reading_that_moves_as_no_gyro_drifts_then_it_is_never_believed(fault):
    epochs = TRUSTED + 100
    raw, reach = flight(epochs, slice(TRUSTED, epochs))
    k, rng = np.arange(100.0)[:, None, None], np.random.default_rng(1)
    raw[TRUSTED:] += {
        "stuck in a turn": TURN * k * [0.0, 0.0, 1.0],
        "noise": rng.normal(scale=25.0, size=(100, RUNS, 3)),
        "spikes": 100.0 * (rng.random((100, RUNS, 1)) < 0.6),
        "fast ramp": 8.0 * k,
        "fast sine": 60.0 * np.sin(0.15 * k),
    }[fault]
    assert not heard(raw, reach, rejected_from(TRUSTED, epochs)).any()


def test_given_a_reading_stuck_through_a_turn_when_flight_is_straight_again_then_it_is_out_of_reach():
    """It stands still as a good one would, 60 degrees off."""
    epochs, over = TRUSTED + 100, TRUSTED + 30
    raw, reach = flight(epochs, slice(TRUSTED, over))
    raw[TRUSTED:over, :, 2] += TURN * np.arange(30)[:, None]
    raw[over:, :, 2] += TURN * 30
    assert not heard(raw, reach, rejected_from(TRUSTED, epochs)).any()


def test_given_missing_readings_then_it_is_not_believed_before_a_whole_window_without_gaps():
    epochs, gap = TRUSTED + 60, TRUSTED + 25
    raw, reach = flight(epochs, slice(0, 0))
    raw[TRUSTED:gap] = np.nan
    said = heard(raw, reach, rejected_from(TRUSTED, epochs))
    assert not said[: gap + coasting.WINDOW - 1].any()
    assert said[gap + coasting.WINDOW + 1].mean() > 0.95


def test_given_a_batch_then_every_run_is_what_it_is_alone():
    epochs = TRUSTED + 60
    raw, reach = flight(epochs, slice(TRUSTED, TRUSTED + 20), runs=5)
    raw[TRUSTED + 10 :, 1] += 40.0
    raw[TRUSTED + 5, 2] = np.nan
    beta = rejected_from(TRUSTED, epochs)
    together = heard(raw, reach, beta)
    for k in range(5):
        np.testing.assert_array_equal(together[:, [k]], heard(raw[:, [k]], reach[:, [k]], beta))
