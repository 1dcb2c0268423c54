"""Arrays that grow by one epoch at a time, bounded if asked: what recordings are kept in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROOM = 64
"""Epochs for which there is room at first."""


class Growing:
    """Several arrays ``(epochs, ...)`` with a common column of times.

    Args:
        shapes: shape of one epoch's row and type, of each array.
        max_epochs: when so many are in, every second epoch of the older half is dropped. None: unbounded.

    Raises:
        ValueError: a bound of fewer than 16 epochs.
    """

    def __init__(self, shapes: Sequence[tuple[tuple[int, ...], np.dtype[Any]]], max_epochs: int | None = None) -> None:
        if max_epochs is not None and max_epochs < 16:
            raise ValueError(f"a recording of {max_epochs} epochs is too short; 16 is the least")
        self.max_epochs = max_epochs
        self._length = 0
        self._time = np.empty(ROOM)
        self._arrays = [np.empty((ROOM, *shape), dtype) for shape, dtype in shapes]

    def append(self, time: float, *rows: NDArray[Any]) -> None:
        """Add one epoch: one row per array."""
        if self.max_epochs is not None and self._length >= self.max_epochs:
            self._thin()
        if self._length == len(self._time):
            self._make_room(2 * self._length)
        self._time[self._length] = time
        for array, row in zip(self._arrays, rows, strict=True):
            array[self._length] = row
        self._length += 1

    def _make_room(self, epochs: int) -> None:
        # Only what is filled is touched, so that the rest takes no memory yet.
        self._time = _enlarged(self._time, epochs, self._length)
        for i in range(len(self._arrays)):
            self._arrays[i] = _enlarged(self._arrays[i], epochs, self._length)

    def _thin(self) -> None:
        half = self._length // 2
        kept = np.r_[np.arange(0, half, 2), np.arange(half, self._length)]
        self._time[: len(kept)] = self._time[kept]
        for array in self._arrays:
            array[: len(kept)] = array[kept]
        self._length = len(kept)

    def truncate(self, length: int) -> None:
        """Forget all but the first ``length`` epochs."""
        self._length = min(length, self._length)

    def copy(self, length: int) -> Growing:
        """Independent arrays with the first ``length`` epochs."""
        return self._with([array[:length] for array in self._arrays], length)

    def narrowed(self, runs: NDArray[np.intp]) -> Growing:
        """Independent arrays with some of the places along their second axis."""
        return self._with([array[: self._length, runs] for array in self._arrays], self._length)

    def _with(self, filled: list[NDArray[Any]], length: int) -> Growing:
        twin = object.__new__(Growing)
        twin.max_epochs, twin._length = self.max_epochs, length
        room = max(ROOM, length)
        twin._time = _enlarged(self._time[:length], room, length)
        twin._arrays = [_enlarged(array, room, length) for array in filled]
        return twin

    def __len__(self) -> int:
        """Epochs in it."""
        return self._length

    @property
    def time(self) -> NDArray[np.float64]:
        """Times of the epochs ``(epochs,)``."""
        return self._time[: self._length]

    def array(self, i: int) -> NDArray[Any]:
        """One array ``(epochs, ...)``; not to be written to."""
        return self._arrays[i][: self._length]


def _enlarged(array: NDArray[Any], epochs: int, filled: int) -> NDArray[Any]:
    new = np.empty((epochs, *array.shape[1:]), array.dtype)
    new[:filled] = array[:filled]
    return new
