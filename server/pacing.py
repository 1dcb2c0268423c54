"""Keeping pace: which epoch is due at which moment of the monotonic clock."""

from __future__ import annotations

import asyncio
import time
from typing import Literal

SLIP = 1.0
"""An experiment further behind than this [s] gives up what it missed instead of racing after it."""

Speed = float | Literal["max"]


class Clock:
    """The machine's monotonic clock, and waiting by it. Tests of pace bring one that they move by hand."""

    def now(self) -> float:
        """Seconds since some fixed moment [s]."""
        return time.monotonic()

    async def happens_within(self, event: asyncio.Event, seconds: float) -> bool:
        """Wait for ``event``, at most ``seconds`` [s]; whether it happened."""
        try:
            await asyncio.wait_for(event.wait(), seconds)
        except TimeoutError:
            return False
        return True


class Pacer:
    """Turns elapsed time into due epochs. Due times are counted from an anchor, so errors do not add up.

    Args:
        period: seconds of flight an epoch.
        speed: seconds of flight a second, or ``"max"``.
        epoch: where the flight is.
        now: the monotonic clock [s].
    """

    def __init__(self, period: float, speed: Speed, epoch: int, now: float) -> None:
        self.speed: Speed = speed
        self._seconds = 0.0 if speed == "max" else period / speed
        self._anchor, self._anchored_at, self._expected = epoch, now, epoch

    def due(self, epoch: int, now: float) -> int | None:
        """Epoch that should be reached at ``now`` by a flight that is at ``epoch``; None: as far as it goes.

        A flight that is not where it was left (rewound, advanced by hand) is paced from where it is.
        """
        if self.speed == "max":
            return None
        if epoch != self._expected:
            self._anchor, self._anchored_at, self._expected = epoch, now, epoch
        due = self._anchor + int((now - self._anchored_at) / self._seconds + 1e-6)
        late = now - self._anchored_at - (epoch + 1 - self._anchor) * self._seconds
        if late > SLIP:
            due = epoch + max(1, int(SLIP / self._seconds))
            self._anchor, self._anchored_at = due, now
        return due

    def flown(self, epoch: int) -> None:
        """Say where the flight is after its turn."""
        self._expected = epoch

    def wait(self, epoch: int, now: float) -> float:
        """Seconds until the epoch after ``epoch`` is due."""
        return max(0.0, self._anchored_at + (epoch + 1 - self._anchor) * self._seconds - now)
