"""Who watches an experiment, and whether a page that flew it has gone away for good."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import Protocol

EXPECTED = 10.0
"""How long a new experiment counts as watched by its maker, who is about to open a stream [s]."""
PATIENCE = 30.0
"""How long a run flies on after the last page that watched it has gone [s]; a reload or a short break in the network
takes less."""


class Subscriber(Protocol):
    """Someone who watches an experiment. Called on the event loop; must not block."""

    def changed(self, at_once: bool) -> None:
        """There is something new; ``at_once`` if someone did it, rather than time went by."""

    def rewound(self, to: float) -> None:
        """Everything after ``to`` is history that never happened."""


class Attendance:
    """Counts the streams of one experiment.

    A run is abandoned when pages watched it and the last of them left :data:`PATIENCE` ago. A run that was started or
    re-timed while nobody watched is flown by a program, over REST, and is never abandoned.

    Args:
        clock: seconds of a monotonic clock; a test's own, if given.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._streams = 0
        self._expected_until = clock() + EXPECTED
        self._left_at: float | None = None

    @property
    def watchers(self) -> int:
        """Streams now; one for a new experiment whose maker is expected to watch it."""
        return self._streams or int(self._clock() < self._expected_until)

    @property
    def abandoned(self) -> bool:
        """Whether the pages that watched have gone, and long enough ago."""
        return self._left_at is not None and self._clock() - self._left_at >= PATIENCE

    @contextlib.contextmanager
    def watched(self) -> Iterator[None]:
        """Count someone who watches, for as long as it lasts."""
        self._streams, self._expected_until, self._left_at = self._streams + 1, 0.0, None
        try:
            yield
        finally:
            self._streams -= 1
            if not self._streams:
                self._left_at = self._clock()

    def commanded(self) -> None:
        """Somebody sets the clock: with no page there it is a program that wants the run to go on."""
        if not self._streams:
            self._left_at = None
