"""Randomness is addressed: a number depends on (seed, run, channel, epoch) and on nothing else."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from ftcore import noise
from ftcore.noise import BLOCK, NoiseSource


@given(epochs=st.permutations(range(0, 3 * BLOCK, 7)))
def test_given_any_order_of_asking_then_the_numbers_are_the_same(epochs):
    source, straight = NoiseSource(3, range(2)), NoiseSource(3, range(2))
    reference = {e: straight.normal("gps", e, (3,)) for e in sorted(epochs)}
    for epoch in epochs:
        np.testing.assert_array_equal(source.normal("gps", epoch, (3,)), reference[epoch])


def test_given_other_channels_are_read_in_between_then_a_channel_does_not_move():
    quiet, busy = NoiseSource(1, range(1)), NoiseSource(1, range(1))
    for epoch in range(200):
        busy.normal("fault/f1", epoch, (40,))
        busy.uniform("fault/f2", epoch)
        np.testing.assert_array_equal(quiet.normal("imu", epoch, (6, 4)), busy.normal("imu", epoch, (6, 4)))


def test_given_a_batch_then_run_k_sees_what_it_sees_alone():
    batch = NoiseSource(5, range(10))
    alone = NoiseSource(5, range(7, 8))
    np.testing.assert_array_equal(batch.normal("a", 100, (5,))[7:8], alone.normal("a", 100, (5,)))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ((1, 0, "a", 0), (2, 0, "a", 0)),
        ((1, 0, "a", 0), (1, 1, "a", 0)),
        ((1, 0, "a", 0), (1, 0, "b", 0)),
        ((1, 0, "a", 0), (1, 0, "a", 1)),
        ((1, 0, "a", 0), (1, 0, "a", BLOCK)),
    ],
)
def test_given_addresses_that_differ_then_the_numbers_are_uncorrelated(one, other):
    def draw(seed, run, channel, epoch):
        return NoiseSource(seed, range(run, run + 1)).normal(channel, epoch, (20000,)).ravel()

    # |correlation| of 20000 independent pairs exceeds 4.5 / sqrt(20000) with probability 7e-6.
    assert abs(np.corrcoef(draw(*one), draw(*other))[0, 1]) < 4.5 / np.sqrt(20000)


def test_given_many_addresses_then_the_numbers_are_standard_normal():
    source = NoiseSource(9, range(4))
    drawn = np.concatenate([source.normal("x", e, (50,)).ravel() for e in range(500)])
    # Kolmogorov-Smirnov at 1e-5.
    assert stats.kstest(drawn, "norm").pvalue > 1e-5


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_given_an_impossible_seed_then_the_message_says_what_would_be_right(seed):
    with pytest.raises(ValueError, match=r"0 to 2\*\*63"):
        NoiseSource(seed, range(1))


@given(epochs=st.lists(st.integers(0, 3 * BLOCK), min_size=1, max_size=30), held=st.sampled_from([1, 5, 43, 63]))
def test_given_blocks_that_are_drawn_in_pieces_then_the_numbers_are_the_same(epochs, held):
    runs, numbers = 4, 3
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(noise, "LARGE", held * runs * numbers)
        pieces, whole = NoiseSource(3, range(runs)), NoiseSource(3, range(2, 3))
        drawn = [pieces.normal("imu", epoch, (numbers,))[2:3] for epoch in epochs]
    for epoch, values in zip(epochs, drawn, strict=True):
        np.testing.assert_array_equal(values, whole.normal("imu", epoch, (numbers,)))
