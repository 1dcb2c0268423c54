"""What a score is made from: a few numbers and flags per run and epoch, whatever else is recorded.

Kept while a flight flies, so that the score does not depend on which signals are recorded. Flags take a bit each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftcore.description import SystemDescription
from ftcore.growing import Growing
from ftcore.recording import Recording

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

QUANTITIES = ("position", "velocity", "attitude")


class Book:
    """Per run and epoch: who was tested, in alarm and used; the headline's errors; squared errors and their NEES.

    Args:
        description: of the system; its signals are the columns of the rows that are appended.
        runs: how many.
        max_epochs: as of the recording; both are thinned at the same epochs. None: unbounded.
    """

    def __init__(self, description: SystemDescription, runs: int, max_epochs: int | None = None) -> None:
        column = {signal.name: i for i, signal in enumerate(description.signals)}
        self.runs = runs
        self.tests = [
            (test.name, subject)
            for test in description.tests
            for subject in test.subjects
            if f"test.{test.name}.{subject}.alarm" in column
        ]
        self.used = [name.removeprefix("used.") for name in column if name.startswith("used.")]
        self._statistic = [column[f"test.{test}.{subject}.statistic"] for test, subject in self.tests]
        self._alarm = [column[f"test.{test}.{subject}.alarm"] for test, subject in self.tests]
        self._use = [column[f"used.{name}"] for name in self.used]
        flags = 2 * len(self.tests) + len(self.used)

        plain = [name for name in description.score_headline if name in column]
        nees = [f"{name}.nees" for name in description.estimators if f"{name}.nees" in column]
        self._plain = [column[name] for name in (*plain, *nees)]
        self._parts: list[int] = []
        starts: list[int] = []
        squares: list[str] = []
        for estimator in description.estimators:
            for quantity in QUANTITIES:
                prefix = f"{estimator}.error.{quantity}."
                parts = [i for n, i in column.items() if n.startswith(prefix) and not n.endswith(".horizontal")]
                if parts:
                    squares.append(f"{estimator}.{quantity}")
                    starts.append(len(self._parts))
                    self._parts += parts
        self._starts = np.array(starts, dtype=np.intp)
        names = [*plain, *nees, *squares]
        self._number = {name: i for i, name in enumerate(names)}
        self._track = Growing(
            [((runs, (flags + 7) // 8), np.dtype(np.uint8)), ((runs, len(names)), np.dtype(np.float64))], max_epochs
        )

    @classmethod
    def of(cls, recording: Recording, description: SystemDescription) -> Book:
        """From a recording of all signals."""
        book = cls(description, recording.rows.shape[1])
        for time, row in zip(recording.time, recording.rows, strict=True):
            book.append(float(time), row)
        return book

    def append(self, time: float, row: Array) -> None:
        """Add one epoch: ``row`` is ``(runs, signals)``, all signals of the description."""
        tested = ~np.isnan(row[:, self._statistic])
        alarm = (row[:, self._alarm] > 0.5) & tested
        flags = np.concatenate([tested, alarm, row[:, self._use] > 0.5], axis=-1)
        squares = np.empty((len(row), 0))
        if self._parts:
            squares = np.add.reduceat(row[:, self._parts] ** 2, self._starts, axis=-1)
        self._track.append(time, np.packbits(flags, axis=-1), np.concatenate([row[:, self._plain], squares], axis=-1))

    def truncate(self, length: int) -> None:
        """Forget all but the first ``length`` epochs."""
        self._track.truncate(length)

    def copy(self, length: int) -> Book:
        """An independent book of the first ``length`` epochs."""
        twin = object.__new__(Book)
        twin.__dict__.update(self.__dict__)
        twin._track = self._track.copy(length)
        return twin

    def of_runs(self, runs: NDArray[np.intp]) -> Book:
        """The book of some of the runs, by their places in it."""
        twin = object.__new__(Book)
        twin.__dict__.update(self.__dict__)
        twin.runs = len(runs)
        twin._track = self._track.narrowed(runs)
        return twin

    def __len__(self) -> int:
        """Epochs in it."""
        return len(self._track)

    @property
    def time(self) -> Array:
        """Times of the epochs ``(epochs,)``."""
        return self._track.time

    def tested(self, test: str, subject: str) -> Flags:
        """In which epochs and runs a test was made ``(epochs, runs)``."""
        return self._flag(self.tests.index((test, subject)))

    def alarm(self, test: str, subject: str) -> Flags:
        """In which of them it was in alarm ``(epochs, runs)``."""
        return self._flag(len(self.tests) + self.tests.index((test, subject)))

    def in_use(self, subject: str) -> Flags:
        """Where the master uses a subject ``(epochs, runs)``; all along where that is not recorded."""
        if subject not in self.used:
            return np.ones((len(self), self.runs), bool)
        return self._flag(2 * len(self.tests) + self.used.index(subject))

    def numbers(self, name: str) -> Array | None:
        """A signal of the headline, ``<estimator>.nees`` or ``<estimator>.<quantity>`` squared, ``(epochs, runs)``.

        None where the system does not have it.
        """
        i = self._number.get(name)
        return None if i is None else self._track.array(1)[:, :, i]

    def _flag(self, i: int) -> Flags:
        flag: Flags = (self._track.array(0)[:, :, i // 8] >> (7 - i % 8)) & 1 == 1
        return flag
