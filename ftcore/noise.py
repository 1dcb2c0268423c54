"""Randomness is addressed, not drawn.

Every random number of a simulation is a pure function of (seed, run, channel, epoch). Injecting a fault, switching a
subsystem or forking a branch cannot shift another channel's noise, so two branches differ only by what was done.

The generator is numpy's counter-based Philox: the key is (seed, hash of the channel's name), the counter's high words
are (block of epochs, run). A block holds :data:`BLOCK` epochs, so that the cost of setting a generator up is shared by
them; which epoch was asked for first makes no difference.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCK = 64
"""Epochs drawn from one generator."""

_KEPT_BLOCKS = 2


def channel_key(channel: str) -> int:
    """64-bit key of a channel's name; the same on every machine and in every Python process."""
    return int.from_bytes(hashlib.blake2b(channel.encode(), digest_size=8).digest(), "little")


class NoiseSource:
    """Standard normal numbers by address, for a batch of runs.

    Args:
        seed: of the experiment, 0 <= seed < 2**63.
        runs: which runs of the experiment this batch holds; run k of a batch sees what run k alone sees.

    The only state is a memo of the last blocks; it never changes a value.
    """

    def __init__(self, seed: int, runs: range) -> None:
        if not 0 <= seed < 2**63:
            raise ValueError(f"seed is {seed}; it must be a whole number from 0 to 2**63 - 1")
        self.seed = seed
        self.runs = runs
        self._memo: OrderedDict[tuple[str, tuple[int, ...], int], Array] = OrderedDict()
        self._memo_limit: dict[tuple[str, tuple[int, ...]], int] = {}

    def normal(self, channel: str, epoch: int, shape: tuple[int, ...] = ()) -> Array:
        """Standard normal numbers of one channel at one epoch, ``(runs, *shape)``."""
        block, offset = divmod(epoch, BLOCK)
        key = (channel, shape, block)
        drawn = self._memo.get(key)
        if drawn is None:
            drawn = self._memo[key] = self._draw(channel, shape, block)
            streams = self._memo_limit
            streams.setdefault((channel, shape), 0)
            while len(self._memo) > _KEPT_BLOCKS * len(streams):
                self._memo.popitem(last=False)
        values: Array = drawn[offset]
        return values

    def uniform(self, channel: str, epoch: int, shape: tuple[int, ...] = ()) -> Array:
        """Uniform numbers in (0, 1) of one channel at one epoch, ``(runs, *shape)``."""
        from scipy.special import ndtr  # the only use; keeps one kind of block

        result: Array = ndtr(self.normal(channel, epoch, shape))
        return result

    def _draw(self, channel: str, shape: tuple[int, ...], block: int) -> Array:
        key = (channel_key(channel) << 64) | self.seed
        out = np.empty((BLOCK, len(self.runs), *shape))
        for i, run in enumerate(self.runs):
            generator = np.random.Generator(np.random.Philox(key=key, counter=(run << 192) | (block << 128)))
            out[:, i] = generator.standard_normal((BLOCK, *shape))
        out.flags.writeable = False
        return out
