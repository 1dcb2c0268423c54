"""Randomness is addressed, not drawn.

Every random number of a simulation is a pure function of (seed, run, channel, epoch). Injecting a fault, switching a
subsystem or forking a branch cannot shift another channel's noise, so two branches differ only by what was done.

The generator is numpy's counter-based Philox: the key is (seed, hash of the channel's name), the counter's high words
are (block of epochs, run). A block holds :data:`BLOCK` epochs, so that the cost of setting a generator up is shared by
them; which epoch was asked for first makes no difference.

Of many runs a whole block would take more memory than all else. Then a piece of it is held at a time; its generators
wait where the piece ends, for the next one.
"""

from __future__ import annotations

import hashlib
import math
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCK = 64
"""Epochs drawn from one generator."""

_KEPT_BLOCKS = 2

LARGE = 2**19
"""Numbers of a block that are held at once; of a larger one it is a piece."""


def channel_key(channel: str) -> int:
    """64-bit key of a channel's name; the same on every machine and in every Python process."""
    return int.from_bytes(hashlib.blake2b(channel.encode(), digest_size=8).digest(), "little")


@dataclass(frozen=True)
class _Piece:
    """Epochs of a block from ``first`` on, ``(epochs, runs, *shape)``, and the generators that go on after them."""

    first: int
    values: Array
    generators: list[np.random.Generator]

    @property
    def end(self) -> int:
        return self.first + len(self.values)


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
        self._memo: OrderedDict[tuple[str, tuple[int, ...], int], _Piece] = OrderedDict()
        self._memo_limit: dict[tuple[str, tuple[int, ...]], int] = {}

    def normal(self, channel: str, epoch: int, shape: tuple[int, ...] = ()) -> Array:
        """Standard normal numbers of one channel at one epoch, ``(runs, *shape)``."""
        block, offset = divmod(epoch, BLOCK)
        key = (channel, shape, block)
        piece = self._memo.get(key)
        if piece is None or not piece.first <= offset < piece.end:
            # Taken out meanwhile: a draw that fails half-way leaves generators that nobody may go on with.
            before = self._memo.pop(key, None)
            piece = self._memo[key] = self._piece(channel, shape, block, offset, before)
            streams = self._memo_limit
            streams.setdefault((channel, shape), 0)
            while len(self._memo) > _KEPT_BLOCKS * len(streams):
                self._memo.popitem(last=False)
        values: Array = piece.values[offset - piece.first]
        return values

    def uniform(self, channel: str, epoch: int, shape: tuple[int, ...] = ()) -> Array:
        """Uniform numbers in (0, 1) of one channel at one epoch, ``(runs, *shape)``."""
        from scipy.special import ndtr  # the only use; keeps one kind of block

        result: Array = ndtr(self.normal(channel, epoch, shape))
        return result

    def _piece(self, channel: str, shape: tuple[int, ...], block: int, offset: int, before: _Piece | None) -> _Piece:
        """The piece of a block with an epoch in it; ``before`` is another one of the same block, if there is one."""
        runs = len(self.runs)
        epochs = max(1, min(BLOCK, LARGE // max(1, runs * math.prod(shape))))
        if before is None or before.end > offset:
            key = (channel_key(channel) << 64) | self.seed
            generators = [
                np.random.Generator(np.random.Philox(key=key, counter=(run << 192) | (block << 128)))
                for run in self.runs
            ]
            piece = _Piece(0, _drawn(generators, epochs, shape), generators)
        else:
            piece = before
        while piece.end <= offset:
            more = min(epochs, BLOCK - piece.end)
            piece = _Piece(piece.end, _drawn(piece.generators, more, shape), piece.generators)
        return piece if piece.end < BLOCK else _Piece(piece.first, piece.values, [])


def _drawn(generators: list[np.random.Generator], epochs: int, shape: tuple[int, ...]) -> Array:
    out = np.empty((epochs, len(generators), *shape))
    for i, generator in enumerate(generators):
        out[:, i] = generator.standard_normal((epochs, *shape))
    out.flags.writeable = False
    return out
